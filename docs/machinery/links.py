"""Links of the pages to files in the repository, converted to links between pages of the site."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = {  # files beside docs/ that are pages of the site
    "README.md": "index.md",
    "CONTRIBUTING.md": "project/contributing.rst",
    "SECURITY.md": "project/security.rst",
    "CHANGELOG.md": "project/changelog.rst",
    "graspfx/compile/README.md": "project/compiler.rst",
}
SOURCE = "source"  # scheme of links to files that are shown as they are, and folder of the pages that show them
FENCE = r"^(?P<fence>```+|~~~+).*?^(?P=fence)\s*?$"
SPAN = r"(?<!`)(?P<tick>`+)(?!`).+?(?<!`)(?P=tick)(?!`)"
CODE = re.compile(f"{FENCE}|{SPAN}", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(?<=\]\()(?P<path>[^()\s#:]+)(?P<anchor>#[^()\s]*)?(?=[)\s])")


def resolve(text: str, file: Path, page: Path) -> str:
    """Rewrite the links of a Markdown text.

    Args:
        text: Text of the file.
        file: File that contains the text; its links are relative to its folder.
        page: Page of the site that shows the text; differs from `file` for files outside of docs/.
    """
    code = [match.span() for match in CODE.finditer(text)]

    def one(match: re.Match[str]) -> str:
        if any(begin <= match.start() < end for begin, end in code):
            return match[0]
        return _place(match["path"], file, page) + (match["anchor"] or "")

    return LINK.sub(one, text)


def _place(link: str, file: Path, page: Path) -> str:
    """Return the target of a link of a file on the site, relative to a page."""
    target = Path(os.path.normpath(file.parent / link))
    if target.is_dir() and (target / "README.md").is_file():
        target /= "README.md"
    within = target.relative_to(ROOT).as_posix() if target.is_relative_to(ROOT) else ""
    if within in PAGES:
        target = DOCS / PAGES[within]
    elif not target.is_relative_to(DOCS) or target.suffix not in (".md", ".rst", ".png", ".svg"):
        return f"{SOURCE}:{within}" if target.is_file() else link
    return Path(os.path.relpath(target, page.parent)).as_posix()


def _read(app: Sphinx, name: str, content: list[str]) -> None:
    page = Path(app.env.doc2path(name))
    if page.suffix == ".md":
        content[0] = resolve(content[0], page, page)


def _sources(tree: nodes.document) -> list[tuple[nodes.reference, str]]:
    """List the links of a page to files that are shown as source text."""
    from docutils import nodes

    links = ((link, str(link.get("refuri", ""))) for link in tree.findall(nodes.reference))
    return [(link, uri.removeprefix(f"{SOURCE}:")) for link, uri in links if uri.startswith(f"{SOURCE}:")]


def _note(app: Sphinx, tree: nodes.document) -> None:
    """Record the files to which a page links."""
    app.env.metadata[app.env.docname]["sources"] = " ".join(sorted({file for _, file in _sources(tree)}))


def _link(app: Sphinx, tree: nodes.document, name: str) -> None:
    for link, file in _sources(tree):
        link["refuri"] = app.builder.get_relative_uri(name, f"{SOURCE}/{file}")


def _pages(app: Sphinx):  # type: ignore[no-untyped-def]
    """Show each file to which a page links."""
    files = {file for data in app.env.metadata.values() for file in str(data.get("sources", "")).split()}
    for file in sorted(files):
        text = (ROOT / file).read_text("utf-8")
        lexer = {".toml": "toml", ".py": "python", ".json": "json", ".md": "markdown"}.get(Path(file).suffix, "text")
        body = app.builder.highlighter.highlight_block(text, lexer)  # type: ignore[attr-defined]
        yield f"{SOURCE}/{file}", {"title": file, "body": f"<h1>{file}</h1>{body}"}, "page.html"


def setup(app: Sphinx) -> dict[str, bool]:
    """Rewrite links when pages are read, and show their target files."""
    app.connect("source-read", _read)
    app.connect("doctree-read", _note)
    app.connect("doctree-resolved", _link)
    app.connect("html-collect-pages", _pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
