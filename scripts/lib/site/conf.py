"""Settings of Sphinx for the site that scripts/site makes."""

import tomllib
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
LISTS = tomllib.loads((HERE / "contents.toml").read_text(encoding="utf-8"))["list"]

project = html_title = "dockloop"
root_doc = "README"
include_patterns = ["README.md", *(f"{page}.md" for row in LISTS for page in row["pages"])]
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_heading_anchors = 6  # named as the links of the pages name them
default_role = "code"  # of `names` in docstrings
napoleon_use_ivar = True
napoleon_use_rtype = False
autodoc_default_options = {"members": True}
html_theme = "furo"
html_static_path = [str(HERE / "static")]
html_css_files = ["site.css"]
html_copy_source = False
html_show_search_summary = False  # a page from a disk cannot read other pages
html_show_copyright = False
highlight_language = "none"  # of blocks that name none
smartquotes_action = "D"  # dashes, but no quotes


def add_contents(app: Sphinx, name: str, text: list[str]) -> None:
    """Add the lists of the pages below a page to its text."""
    for row in LISTS:
        if row["below"] == name:
            caption = [f":caption: {row['caption']}"] if "caption" in row else []
            pages = [f"/{page}" for page in row["pages"]]
            lines = ["", "```{toctree}", ":hidden:", ":glob:", *caption, "", *pages, "```", ""]
            text[0] += "\n".join(lines)


def setup(app: Sphinx) -> None:
    """Connect."""
    app.connect("source-read", add_contents)
