"""Sphinx's configuration of the documentation site; `scripts/docs` builds it.

The sources are the Markdown pages of the checkout as they stand, README.md among them: the checkout is Sphinx's source
folder, so that a link that works on a forge works on the site, and needs no second spelling.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import click
from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

from clrender.version import __version__

_log = logging.getLogger(__name__)

project: Final = "clrender"
release: Final = __version__
copyright: Final = "the authors of clrender"

extensions: Final = [
    "myst_parser",
    "sphinx_external_toc",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx_click",
    "sphinx_copybutton",
]
external_toc_path: Final = "docs/_toc.yml"
include_patterns: Final = ["*.md", "docs/**", "scenes/LICENSES.md"]
exclude_patterns: Final = [".*", "build", "clrender", "kernels", "scripts", "tests", "test-artifacts", "docs/_*"]
language: Final = "en"
smartquotes: Final = False  # `--seed` stays two hyphens

# Markdown as forges read it: headings are anchors, $ marks formulas.
myst_enable_extensions: Final = ["dollarmath"]
myst_heading_anchors: Final = 4
highlight_language: Final = "none"
copybutton_prompt_text: Final = "$ "

# A single backtick in a docstring is a name of the interface, where there is such a name.
default_role: Final = "py:obj"
autodoc_member_order: Final = "bysource"
autodoc_typehints: Final = "none"  # the docstrings say more
numpydoc_class_members_toctree: Final = False
numpydoc_show_class_members: Final = False

html_theme: Final = "furo"
html_title: Final = f"clrender {__version__}"
html_static_path: Final = ["_static"]
html_css_files: Final = ["site.css"]
html_favicon: Final = "_static/favicon.svg"
# Ranks pages that answer above logs and lists
html_search_scorer: Final = str(Path(__file__).with_name("search.js"))
html_extra_path: Final = ["_root"]
html_copy_source: Final = False
html_show_sphinx: Final = False
# Formulas are MathML, which browsers show by themselves: no script, and nothing to fetch from elsewhere.
html_math_renderer: Final = "mathml"


def _formula(node: nodes.Node, block: bool) -> str:
    try:
        tree: Any = latex2mathml.tex2mathml(node.astext(), as_block=block)
    except MathError as error:
        _log.warning("this formula cannot be shown: %s", error, location=node)
        return ""
    return str(tree)


def _inline_math(self: Any, node: nodes.math) -> None:
    self.body.append(_formula(node, False))
    raise nodes.SkipNode


def _block_math(self: Any, node: nodes.math_block) -> None:
    self.body.append(f'<div class="formula">{_formula(node, True)}</div>\n')
    raise nodes.SkipNode


def _plain_help(app: Sphinx, context: click.Context, lines: list[str]) -> None:
    """Help of commands is plain text: what reStructuredText would take for marks is escaped."""
    lines[:] = [re.sub(r"([\\|]|(?<!\*)\*(?!\*))", r"\\\1", line) for line in lines]  # `**Required**` is sphinx-click's


_NAME: Final = re.compile(r"[A-Za-z_][\w.]*")


def _names_only(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """What a docstring has in single backticks and is no name, such as `.film`, is code."""

    def marked(match: re.Match[str]) -> str:
        return match[0] if _NAME.fullmatch(match[1]) else f"``{match[1]}``"

    lines[:] = [re.sub(r"(?<![`:])`([^`]+)`(?!`)", marked, line) for line in lines]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the formulas and what makes help and docstrings readable."""
    app.add_html_math_renderer("mathml", (_inline_math, None), (_block_math, None))
    app.connect("sphinx-click-process-description", _plain_help)
    app.connect("sphinx-click-process-options", _plain_help)
    app.connect("autodoc-process-docstring", _names_only)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
