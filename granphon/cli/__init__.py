"""The command ``granphon``."""

from granphon.cli.commands import main

__all__ = ["main"]
