"""Configuration of the site; `make docs` builds it."""

import sys
from importlib.metadata import version as installed_version
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the generators in `ext`

project = "tubelock"
author = "The tubelock founders"
project_copyright = "2026, the tubelock founders"
version = release = installed_version("tubelock")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx-mathjax-offline",
    "sphinx_copybutton",
    "sphinx_design",
    "ext.docstrings",
    "ext.names",
    "ext.pages",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "ext", "static", "joss"]

myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
myst_dmath_double_inline = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # sections of the docstrings say types and shapes
autodoc_mock_imports = [
    "gmsh",
    "pypardiso",
    "compas_cra",
    "compas",
    "compas_assembly",
    "distributed",
]
default_role = "py:obj"  # names in backticks of docstrings
napoleon_google_docstring = False
suppress_warnings = ["ref.python"]  # ambiguous names; tests/pages/test_docs.py checks full ones
toc_object_entries = False  # the sidebar names pages, not their functions

html_theme = "furo"
html_title = "tubelock"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#1f5f8b", "color-brand-content": "#1f5f8b"},
    "dark_css_variables": {"color-brand-primary": "#7fb8dc", "color-brand-content": "#7fb8dc"},
    "navigation_with_keys": True,
}
copybutton_exclude = ".linenos, .gp, .go"
