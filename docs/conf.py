"""The documentation site: every page of this folder, the tutorials executed, the API (`make docs`).

Built offline; warnings are errors there.
"""

from pathlib import Path

import pipeline
from bench import constants

Path(__file__).with_name("constants.md").write_text(constants.page(), encoding="utf-8")

project = "Rail stiffness"
author = "the authors of CITATION.cff"
version = release = pipeline.__version__
html_show_copyright = False

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
root_doc = "index"

html_theme = "furo"
html_title = "Rail stiffness"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True}
html_show_sphinx = False
html_copy_source = False

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]
nb_execution_mode = "force"  # what a page shows is what the code of today says
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True

autodoc_typehints = "none"  # signatures and docstrings say them, with units
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
napoleon_google_docstring = True
napoleon_use_rtype = False
napoleon_use_ivar = True
default_role = "code"  # docstrings mark code with one backtick, as Markdown does
