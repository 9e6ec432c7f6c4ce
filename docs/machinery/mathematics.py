"""Equations as MathML, which browsers typeset without scripts, fonts or other servers."""

from __future__ import annotations

import re
from html import escape

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

LONE = re.compile(r"<mo>([+*−]</mo>\s*</msup>)")  # a sign that stands for no operation, as in G^+


def inline(translator: HTML5Translator, node: nodes.math) -> None:
    """Write an equation within a line."""
    translator.body.append(_mathml(node, as_block=False))
    raise nodes.SkipNode


def displayed(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Write a displayed equation, with its number if it has one."""
    number = ""
    if node["number"]:
        number = f'<span class="eqno">({escape(str(get_node_equation_number(translator, node)))})</span>'
    mark = f' id="{node["ids"][0]}"' if node["ids"] else ""
    translator.body.append(f'<div class="math"{mark}>{number}{_mathml(node, as_block=True)}</div>')
    raise nodes.SkipNode


def _mathml(node: nodes.math | nodes.math_block, *, as_block: bool) -> str:
    try:
        written = str(tex2mathml(node.astext(), as_block=as_block))
    except MathError as error:
        where = f"{node.source}:{node.line}" if node.line else str(node.source)
        raise ExtensionError(f"{where}: {error} in {node.astext()!r}") from error
    return LONE.sub(r'<mo lspace="0" rspace="0">\1', written)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register MathML as a renderer of equations in HTML: `html_math_renderer = "mathml"`."""
    app.add_html_math_renderer("mathml", (inline, None), (displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
