"""The scene file, its run, and the files of a result."""
