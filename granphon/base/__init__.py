"""What everything stands on: errors, results, units, validation, files."""
