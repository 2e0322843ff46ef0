"""Sphinx configuration."""

import sys
from importlib.metadata import version as _version
from pathlib import Path as _Path

sys.path.insert(0, str(_Path(__file__).parent))  # for _gallery

project = "granphon"
author = "The granphon developers"
copyright = "2026, the granphon developers"
release = _version("granphon")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax", "sphinx_gallery.gen_gallery"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "granphon"
autodoc_typehints = "none"
autodoc_member_order = "bysource"
exclude_patterns = ["_build"]
nitpicky = False
# what a parameter is stands where napoleon expects its type, so that words of ours are looked up as names
suppress_warnings = ["ref.python"]
# every script is run; one that has not changed since the last build on this machine is not run again
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "_gallery.order",
    "image_scrapers": ("_gallery.scraper", "matplotlib"),
    "matplotlib_animations": True,
    "write_computation_times": False,
}
