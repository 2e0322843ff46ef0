"""Many states as one data set: tasks, workers, files."""
