"""The documentation site: `make site` builds it from these pages and from the code."""

import os
import sys
from hashlib import sha256
from pathlib import Path

DOCS = Path(__file__).parent
ROOT = DOCS.parent
sys.path[:0] = [str(DOCS), str(ROOT)]

import graspfx  # noqa: E402 (of this checkout)

project = "GraspFX"
author = "GraspFX developers"
copyright = author
version = release = graspfx.__version__
language = "en"
smartquotes = False  # options of commands and values stay as they are written

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "machinery.flowchart",
    "machinery.gallery",
    "machinery.glossary",
    "machinery.links",
    "machinery.mathematics",
    "machinery.names",
]
source_suffix = {".md": "myst-nb", ".rst": "restructuredtext"}
exclude_patterns = ["pictures", "notebooks"]  # they run from a wheel: tests/promises

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 4
myst_url_schemes = {"http": None, "https": None, "mailto": None, "source": None}
myst_dmath_double_inline = True


def _program() -> str:
    """Compute a hash of all code that cells can call: pages are executed again when it changes."""
    files = sorted(path for shelf in ("graspfx", "devices", "scenes") for path in (ROOT / shelf).rglob("*"))
    sources = (path for path in files if path.is_file() and path.suffix != ".pyc")
    return sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]


# GRASPFX_SITE_CELLS=off builds without running cells; an example whose cell raises fails the build.
nb_execution_mode = os.environ.get("GRASPFX_SITE_CELLS", "cache")
nb_execution_cache_path = str(Path(os.environ.get("GRASPFX_SITE_CACHE", ROOT / "out" / "site-cells")) / _program())
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_execution_show_tb = True
nb_merge_streams = True

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_typehints_format = "short"
autodoc_member_order = "groupwise"
autodoc_type_aliases = dict.fromkeys(("FloatArray", "BoolArray", "IntArray", "Index", "Numbers"), "ndarray")
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
python_use_unqualified_type_names = True
add_module_names = True
toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = "GraspFX"
html_math_renderer = "mathml"
html_favicon = "static/favicon.svg"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
pygments_style = "friendly"
pygments_dark_style = "github-dark"
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
