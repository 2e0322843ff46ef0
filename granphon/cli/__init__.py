"""The command ``granphon``."""
