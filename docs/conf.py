"""The site of the documentation: `make docs` builds it into docs/_build/html, and a warning is an error."""

import sys
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from tools.reference_pages import write_pages

project = "hil-bridge"
author = "the authors of hil-bridge"
version = release = version_of("hil-bridge")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_class_signature = "separated"  # the fields of a value are told one by one below it
add_module_names = False
toc_object_entries_show_parents = "hide"
default_role = "py:obj"  # a name in a docstring is code, and a link where the reference has it
exclude_patterns = ["_build"]
source_suffix = {".md": "markdown"}

myst_enable_extensions = ["colon_fence", "deflist", "attrs_inline", "attrs_block"]
myst_heading_anchors = 4
suppress_warnings = [
    "myst.header",
    "toc.empty_glob",
    "toc.glob",
]  # tables of figures begin at the third level

nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]  # types that the reference does not list
html_theme = "furo"
html_title = f"hil-bridge {release}"
html_static_path = ["_static"]
html_logo = html_favicon = "_static/logo.svg"
html_css_files = ["site.css"]
html_show_copyright = False
html_copy_source = False
pygments_style = "friendly"
pygments_dark_style = "monokai"


def setup(app: Any) -> None:
    """The pages that are generated from the code are written first."""
    app.connect("builder-inited", lambda _app: write_pages())
