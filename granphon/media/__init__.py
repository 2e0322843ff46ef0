"""Media: from a packing and a load to the state of its contacts."""
