"""How Sphinx builds the book. Everything is served from the build itself: no page asks a network for anything."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # chapters.py, our extension

project = "Grasp viewpoint planning"
author = "the gvp_lib contributors"
copyright = "2026, the gvp_lib contributors. Text CC BY 4.0, code MIT"
language = "en"

extensions = [
    "myst_nb",
    "sphinx.ext.mathjax",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinx_proof",
    "sphinx_exercise",
    "sphinxcontrib.bibtex",
    "chapters",
    "pages",
    "reference",
]
exclude_patterns = ["_build", "results", "generated", "_static", "_templates", "**.ipynb_checkpoints"]
nitpicky = True

# --- Markdown and notebooks ---------------------------------------------------------------------------------------
# Notebooks are executed before the build, by execute.py; Sphinx shows the outputs that are stored in them, or in the
# copies that `make book` has just run.
outputs = os.environ.get("GVP_OUTPUTS", "../notebooks")
nb_execution_mode = "off"
solutions = os.environ.get("GVP_SOLUTIONS", "show")  # of the exercises; "hide" leaves them out (chapters.py)
nb_ipywidgets_js: dict[str, dict[str, str]] = {}  # else every page with a widget asks a network for its scripts
nb_merge_streams = True
myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath", "smartquotes"]
myst_heading_anchors = 3
bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "unsrt"
numfig = True
numfig_format = {"figure": "Figure %s", "table": "Table %s", "code-block": "Listing %s"}
math_eqref_format = "Eq. {number}"

# --- HTML ------------------------------------------------------------------------------------------------------------
html_theme = "sphinx_book_theme"
html_title = "Grasp viewpoint planning"
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["book.css", "claims.css"]
html_js_files = [("book.js", {"defer": "defer"})]
html_context = {"default_mode": "auto"}  # light or dark as the reader's system has it
html_theme_options = {
    "navbar_persistent": [],  # else a second search field, above the first
    "use_download_button": True,
    "use_fullscreen_button": False,
    "home_page_in_toc": True,
    "show_navbar_depth": 1,
    "show_toc_level": 2,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
# Where the repository is public, its address brings buttons to every chapter, which open it in Colab or Binder:
# GVP_REPOSITORY=https://... make book. Without it there are none.
if repository := os.environ.get("GVP_REPOSITORY"):
    html_theme_options |= {
        "repository_url": repository,
        "repository_branch": os.environ.get("GVP_BRANCH", "main"),
        "path_to_docs": "",  # chapters lie in notebooks/, at the root; below book/ are copies
        "use_repository_button": True,
        "launch_buttons": {
            "colab_url": "https://colab.research.google.com",
            "binderhub_url": "https://mybinder.org",
            "notebook_interface": "jupyterlab",
        },
    }
html_show_sourcelink = False
html_copy_source = True
html_last_updated_fmt = None  # the same sources make the same pages
mathjax_path = "generated/mathjax/tex-chtml.js"  # under _static; chapters.py puts it there
mathjax3_config = {"chtml": {"displayAlign": "center"}, "options": {"enableAssistiveMml": True}}
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

# --- one page, to be printed (pdf.py) --------------------------------------------------------------------------------
if "tags" in globals() and globals()["tags"].has("pdf"):
    html_theme = "basic"
    html_theme_options = {}
    html_css_files = ["print.css"]
    html_js_files = []
    html_context = {}
    html_permalinks = False
    pygments_style = "friendly"
