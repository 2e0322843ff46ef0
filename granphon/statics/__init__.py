"""Balls at rest: their linear response."""
