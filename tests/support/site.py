"""The documentation site's own parts, which stand beside its pages: docs/machinery."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from tests.support.optional import require

DOCS = Path(__file__).parents[2] / "docs"
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```", re.MULTILINE | re.DOTALL)


def part(name: str) -> Any:
    """Load a module of docs/machinery."""
    spec = require(spec_from_file_location(f"machinery_{name}", DOCS / "machinery" / f"{name}.py"))
    module = module_from_spec(spec)
    require(spec.loader).exec_module(module)
    return module


def pages() -> set[str]:
    """List the pages of the site, by their paths in docs/ without suffixes."""
    files = (path for path in DOCS.rglob("*") if path.suffix in (".md", ".rst"))
    return {path.relative_to(DOCS).with_suffix("").as_posix() for path in files}


def entries(page: str) -> Iterator[str]:
    """List the pages that the contents of a page lead to."""
    path = DOCS / f"{page}.md"
    if not path.is_file():
        return
    for body in TOCTREE.findall(path.read_text("utf-8")):
        lines = [line.strip() for line in body.splitlines() if line.strip() and not line.startswith(":")]
        for line in lines:
            within = path.parent.relative_to(DOCS) / line
            yield from (
                found.relative_to(DOCS).with_suffix("").as_posix()
                for found in sorted(DOCS.glob(f"{within.as_posix()}.*"))
                if found.suffix in (".md", ".rst")
            )
