"""Settings of Sphinx. With these settings, `make docs` builds the pages into build/docs/html."""

import sys
from importlib import metadata
from pathlib import Path

from dfd.common.distribution import DISTRIBUTION

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]  # so that `tools` and `bench` can be imported

project = "dfd"
project_copyright = "the authors of dfd, MIT license"
release = metadata.version(DISTRIBUTION)

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "tools.equations",
    "tools.examples",
]
exclude_patterns = ["tools"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

# The pages show types in signatures, because docstrings contain only array shapes and units.
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "signature"
autodoc_type_aliases = {"MeshLike": "MeshLike", "ArrayLike": "ArrayLike"}
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True
add_module_names = False
default_role = "code"

html_theme = "furo"
html_title = "dfd"
html_static_path = ["tools/style.css"]
html_css_files = ["style.css"]
html_math_renderer = "mathml"
html_show_sphinx = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#1b5cc4", "color-brand-content": "#1b5cc4"},
    "dark_css_variables": {"color-brand-primary": "#7fb0ff", "color-brand-content": "#7fb0ff"},
}
copybutton_selector = "div:not(.output) > div.highlight pre"
copybutton_prompt_text = r">>> |\.\.\. "  # which the copied code of an example lacks
copybutton_prompt_is_regexp = True
