"""Many states as one data set: tasks, workers, files."""

__all__ = ["MOST_WORKERS"]

#: the greatest number of worker processes on this machine: each takes some 100 MB
MOST_WORKERS = 1024
