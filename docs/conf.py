"""Sphinx configuration."""

from importlib.metadata import version as _version

project = "granphon"
author = "The granphon developers"
copyright = "2026, the granphon developers"
release = _version("granphon")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
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
