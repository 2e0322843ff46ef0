"""Balls at rest under a load, and their linear response."""
