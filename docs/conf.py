"""Sphinx configuration."""

import sys
from importlib.metadata import metadata as _metadata
from importlib.metadata import version as _version
from pathlib import Path as _Path

sys.path.insert(0, str(_Path(__file__).parent))  # for the modules of this folder

import _docstrings
import _gallery
import _links
import _repository

project = "granphon"
author = "The granphon developers"
copyright = "2026, the granphon developers"
release = _version("granphon")
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",  # brings MathJax with the pages, which then need no network
    "sphinx_gallery.gen_gallery",
]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
smartquotes_action = "qe"  # two dashes begin an option
html_theme = "furo"
html_title = "granphon"
_address = _repository.address(
    _metadata("granphon").get_all("Project-URL") or (), _Path(__file__).parent.parent
)
html_theme_options = _repository.theme_options(_address)
html_static_path = ["_static"]
html_css_files = ["granphon.css"]
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_type_aliases = _docstrings.ALIASES
# what these have is said once, where they stand themselves, or by ASE and Python
autodoc_default_options = {
    "members": True,
    "inherited-members": "Result, ContactState, Sample, Equilibrium, Calculator,"
    " GetPropertiesMixin, BaseException, OSError",
}
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
autodoc_member_order = "bysource"
exclude_patterns = ["_build"]
nitpicky = False
# every script is run; one that has not changed since the last build on this machine is not run
# again
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "_gallery.order",
    "image_scrapers": ("_gallery.scraper", "matplotlib"),
    "thumbnail_size": (400, 280),
    "matplotlib_animations": True,
    "write_computation_times": False,
}


def _link_repository(app, page, source):
    if page == "index":
        source[0] = _repository.linked(source[0], _address)


def setup(app):
    """Read docstrings and types as they are written here, and take the thumbnails once the gallery
    is made.
    """
    app.connect("builder-inited", _gallery.take_panels, priority=900)
    _docstrings.name_aliases()
    _docstrings.hide_sources()
    app.connect("autodoc-process-docstring", _docstrings.process)
    app.connect("autodoc-process-signature", _docstrings.sign)
    app.connect("autodoc-skip-member", _docstrings.skip)
    app.connect("source-read", _links.read)
    app.connect("source-read", _link_repository)
    app.connect("doctree-resolved", _links.link_terms)
