"""States of a scene or a sweep as one labelled data set: cases, tasks, workers, files."""

__all__ = ["MOST_WORKERS"]

#: the greatest number of worker processes on this machine: each takes some 100 MB
MOST_WORKERS = 1024
