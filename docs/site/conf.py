"""Configuration of Sphinx.  build.py beside it stages the sources and calls Sphinx with this folder as ``-c``."""

import os
import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TUTORIALS = [f"docs/tutorials/made/{path.stem}" for path in ROOT.glob("docs/tutorials/plot_*.py")]
sys.path.insert(0, str(HERE))  # the extensions beside this file
os.environ.setdefault("MPLBACKEND", "Agg")

import ps_fmu  # noqa: E402  # after the path

project = "ps_fmu"
author = "The ps_fmu developers"
project_copyright = author
release = version = ps_fmu.__version__
smartquotes = False  # names and options of commands stay as they are typed
html_title = f"ps_fmu {version}"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "house_docstrings",
    "python_names",
]
exclude_patterns = ["docs/tutorials/*.rst", "docs/paper"]  # parts of other pages
suppress_warnings = ["config.cache"]  # sphinx-gallery's settings hold classes

# --- Markdown --------------------------------------------------------------------------------

source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_dmath_allow_space = False
myst_dmath_allow_digits = False
myst_heading_anchors = 3

# --- Python API ------------------------------------------------------------------------------

autosummary_generate = False  # api_pages.py writes the pages
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True

autodoc_type_aliases = {name: name for name in ("Array", "ArrayLike", "Complex", "Lags", "Counts", "Value", "Places")}
add_module_names = False
toc_object_entries_show_parents = "hide"
python_maximum_signature_line_length = 100

# --- Tutorials: executed at each build ------------------------------------------------------------

sphinx_gallery_conf = {
    "examples_dirs": ["docs/tutorials"],
    "gallery_dirs": ["docs/tutorials/made"],
    "filename_pattern": r"plot_",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "only_warn_on_example_error": False,
    "show_memory": False,
    "show_signature": False,
    "show_api_usage": False,
    "min_reported_time": 1e9,  # times are those of the machine that built the site
    "download_all_examples": False,
    "remove_config_comments": True,
    "matplotlib_animations": False,
    "image_scrapers": ("matplotlib", "shown_figures.save_figures"),
    "capture_repr": (),  # what is printed is enough
    "reset_modules": ("matplotlib",),
    "write_computation_times": False,
}

# --- Pages: they open without a network ---------------------------------------------------------------

html_theme = "pydata_sphinx_theme"
html_math_renderer = "mathml"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_search_scorer = str(HERE / "static" / "scorer.js")
html_sidebars = {"**": ["groups"]}
templates_path = ["templates"]
html_show_sourcelink = False
html_copy_source = False
html_last_updated_fmt = None
html_context = {"default_mode": "auto"}
html_theme_options = {
    "logo": {"text": html_title},
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "navigation_depth": 3,
    "navbar_center": [],
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": {"**": ["page-toc"], **{page: [] for page in TUTORIALS}},  # code wants the width
    "back_to_top_button": True,
}

# --- Links ---------------------------------------------------------------------------------

nitpicky = True
linkcheck_timeout = 20
linkcheck_anchors = False
linkcheck_ignore = [re.escape("https://doi.org/") + ".*"]  # publishers refuse programs
