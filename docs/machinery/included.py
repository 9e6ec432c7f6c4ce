"""Markdown from outside of docs/ as a page of the site, with links relative to its own folder."""

from __future__ import annotations

from pathlib import Path

from docutils import nodes
from myst_parser.parsers.sphinx_ import MystParser

from machinery.links import resolve


class Parser(MystParser):
    """The parser of `.. include:: FILE` with `:parser: machinery.included`."""

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse a file's text, with its links rewritten for the page that includes it."""
        env = document.settings.env
        file, page = Path(document["source"]).resolve(), Path(env.doc2path(env.docname))
        super().parse(resolve(inputstring, file, page), document)
