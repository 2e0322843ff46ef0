"""Pages for a browser: the bands of a packing in one file, and files for other viewers."""
