"""Sphinx's settings. The pages come from `pages.py`; `script/docs` builds them."""

import re
import tomllib
from pathlib import Path

from docutils import nodes
from pages import suit
from sphinx import addnodes
from sphinx.application import Sphinx

REPOSITORY = Path(__file__).resolve().parents[2]
_project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
project = _project["name"]
release = _project["version"]
html_show_copyright = False

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
include_patterns = ["*.md", "docs/**", "api/**", "benchmarks/**"]
suppress_warnings = ["myst.header"]  # a page may begin below its first level

# Pages link to headings as GitHub does.
myst_heading_anchors = 6
myst_enable_extensions = ["dollarmath"]

# Docstrings are numpy's; single backticks are code, as in Markdown.
default_role = "code"
napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say types, shapes and units
napoleon_use_ivar = True
add_module_names = False

html_theme = "pydata_sphinx_theme"
html_title = "metamerlab"
templates_path = ["templates"]
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_align": "left",
    "header_links_before_dropdown": 8,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["made-from"],
    "footer_end": [],
    "navigation_with_keys": False,
    "show_toc_level": 2,
}
copybutton_prompt_text = "$ "


def only_names_of_ours(_app: Sphinx, doctree: nodes.document) -> None:
    """Take the links from words in the types of docstrings: `size` there is no property of ours."""
    for found in list(doctree.findall(addnodes.pending_xref)):
        if found.get("refspecific") and not re.search(r"[.A-Z]", found["reftarget"]):
            found.replace_self(found.children)


def one_name_a_line(_app: Sphinx, *words: object) -> None:
    """Write `a, b : type` under Attributes as two lines, which is all that napoleon understands."""
    lines = words[-1]
    assert isinstance(lines, list)
    lines[:] = re.sub(
        r"^((?:\w+, )+)(\w+ : (.*))$",
        lambda m: "".join(f"{name} : {m[3]}\n" for name in m[1].split(", ")[:-1]) + m[2],
        "\n".join(lines),
        flags=re.MULTILINE,
    ).split("\n")


def setup(app: Sphinx) -> None:
    app.connect("autodoc-process-docstring", one_name_a_line, priority=400)  # before napoleon
    app.connect("doctree-read", only_names_of_ours)
    app.connect("source-read", suit)
