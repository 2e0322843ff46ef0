"""Contacts of balls as one list, and the compiled loops over it."""
