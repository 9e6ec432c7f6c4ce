"""Flow charts, written as lists of arrows and drawn in layers: every arrow points down."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx

ARROW = re.compile(r"^\s*(\w+) --> (\w+)\s*$", re.MULTILINE)
LETTER, HEIGHT, GAP, STEP = 7.4, 26.0, 18.0, 74.0  # [px]
SWEEPS = 12  # in which nodes go to the middle of their neighbours


def drawing(text: str) -> str:
    """Draw a chart of arrows `a --> b` as SVG, in the page's own colours."""
    arrows = ARROW.findall(text)
    layers = _ordered(_layers(arrows), arrows)
    places = dict(_places(layers))
    width = max(x + _width(name) / 2 for name, (x, _) in places.items()) + GAP
    height = STEP * (len(layers) - 1) + 2 * HEIGHT
    lines = "".join(_arrow(*places[a], *places[b]) for a, b in arrows)
    boxes = "".join(_box(name, x, y) for name, (x, y) in places.items())
    head = '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
    tip = f'<defs>{head}<path d="M0 0L8 4L0 8z"/></marker></defs>'
    size = f'viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}"'
    return f'<div class="chart"><svg {size} role="img" aria-label="{len(places)} boxes">{tip}{lines}{boxes}</svg></div>'


def _layers(arrows: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Place each node below all nodes with an arrow to it."""
    names = list(dict.fromkeys(name for arrow in arrows for name in arrow))
    depth = dict.fromkeys(names, 0)
    for _ in names:
        for a, b in arrows:
            depth[b] = max(depth[b], depth[a] + 1)
    return [[name for name in names if depth[name] == each] for each in range(max(depth.values()) + 1)]


def _ordered(layers: list[list[str]], arrows: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Order the nodes of each layer by the mean position of their neighbours."""
    beside: dict[str, list[str]] = {name: [] for layer in layers for name in layer}
    for a, b in arrows:
        beside[a].append(b)
        beside[b].append(a)
    for _ in range(SWEEPS):
        places = dict(_places(layers))
        layers = [sorted(layer, key=lambda name: _mean(beside[name], places)) for layer in layers]
    return layers


def _mean(names: Sequence[str], places: Mapping[str, tuple[float, float]]) -> float:
    return sum(places[name][0] for name in names) / len(names)


def _places(layers: Sequence[Sequence[str]]) -> Iterator[tuple[str, tuple[float, float]]]:
    """Return the centre of each node, with all layers centred on one axis."""
    widths = [sum(_width(name) + GAP for name in layer) for layer in layers]
    for depth, layer in enumerate(layers):
        x = (max(widths) - widths[depth]) / 2 + GAP / 2
        for name in layer:
            yield name, (x + _width(name) / 2, HEIGHT / 2 + 2.0 + STEP * depth)
            x += _width(name) + GAP


def _width(name: str) -> float:
    return LETTER * len(name) + 18.0


def _arrow(x: float, y: float, to_x: float, to_y: float) -> str:
    y, to_y = y + HEIGHT / 2, to_y - HEIGHT / 2
    bend = STEP / 3
    path = f"M{x:.0f} {y:.0f}C{x:.0f} {y + bend:.0f} {to_x:.0f} {to_y - bend:.0f} {to_x:.0f} {to_y - 1:.0f}"
    return f'<path class="arrow" d="{path}" marker-end="url(#tip)"/>'


def _box(name: str, x: float, y: float) -> str:
    corner = f'x="{x - _width(name) / 2:.0f}" y="{y - HEIGHT / 2:.0f}"'
    box = f'<rect {corner} width="{_width(name):.0f}" height="{HEIGHT:.0f}" rx="5"/>'
    return f'{box}<text x="{x:.0f}" y="{y + 4.5:.0f}">{escape(name)}</text>'


def _draw(app: Sphinx, tree: nodes.document) -> None:
    from docutils import nodes

    for block in list(tree.findall(nodes.literal_block)):
        if block.get("language") == "mermaid":
            block.replace_self(nodes.raw("", drawing(block.astext()), format="html"))


def setup(app: Sphinx) -> dict[str, bool]:
    """Replace charts when pages are read."""
    app.connect("doctree-read", _draw)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
