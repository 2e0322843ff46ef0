"""Fits to measured velocities."""
