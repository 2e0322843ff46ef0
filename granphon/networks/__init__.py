"""Finite networks of contacts, ordered or not: their balls, their contacts, and the files that hold
them.
"""
