"""Pages to play with: the bands of a packing in one file for a browser, and what other viewers
read.
"""
