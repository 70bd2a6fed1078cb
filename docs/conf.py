"""How `make docs` builds these pages: Sphinx, MyST for Markdown, furo. Needs the extra `docs`."""

import sys
from importlib import import_module
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]

__version__ = import_module("dl2c.version").__version__

project = "dl2c"
author = "dl2c contributors"
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "generated", "formulas"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_show_copyright = False
html_title = f"dl2c {__version__}"
html_static_path = ["style"]
html_css_files = ["pages.css"]
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
default_role = "code"
