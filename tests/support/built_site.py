"""The built documentation site, looked at: no page asks another host for anything, in its text or in a browser.

`python -m tests.support.built_site out/site` says what pages ask for, and ends with 1 if they ask others for anything.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from tests.support.chromium import chromium, program

LOADED = re.compile(
    r"<(?:script|img|iframe|source|video|audio|embed|object)\b[^>]*?\b(?:src|data)\s*=\s*[\"'](?P<a>(?:https?:)?//[^\"']+)"
    r"|<link\b(?=[^>]*\brel\s*=\s*[\"']?(?:stylesheet|preload|icon|preconnect|prefetch|dns-prefetch|manifest))"
    r"[^>]*?\bhref\s*=\s*[\"'](?P<b>(?:https?:)?//[^\"']+)"
    r"|\burl\(\s*[\"']?(?P<c>(?:https?:)?//[^\"')]+)|@import\s+[\"'](?P<d>(?:https?:)?//[^\"']+)",
    re.IGNORECASE,
)
LOOKED_AT = ("index.html", "scenes.html", "reference/scene.html", "reference/stability.html", "search.html?q=stiffness")


def asked_of_others(folder: Path) -> list[str]:
    """List what the pages and style sheets of a folder load from other hosts, each after its file."""
    found_in = (path for path in sorted(folder.rglob("*")) if path.suffix in (".html", ".css"))
    return [
        f"{path.relative_to(folder)}: {next(filter(None, match.groups()))}"
        for path in found_in
        for match in LOADED.finditer(path.read_text("utf-8", errors="replace"))
    ]


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve a folder on this machine, and give its address."""

    class Quiet(SimpleHTTPRequestHandler):
        def handle(self) -> None:
            with suppress(ConnectionError):  # a page that is closed before all of it has come
                super().handle()

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder))) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/"
        finally:
            server.shutdown()
            thread.join()


def requested_of_others(folder: Path) -> list[str]:
    """List what a browser asks other hosts for, and what it cannot load, as it shows some of the pages."""
    others: list[str] = []
    with served(folder) as address, chromium() as browser:
        for place in LOOKED_AT:
            if (folder / place.partition("?")[0]).is_file():
                page = browser.open(address + place)
                if "search" in place:
                    page.wait_for("document.querySelectorAll('ul.search li').length > 3")
                others += [url for url in page.requests if not url.startswith(address)] + page.console_errors
                page.close()
    return others


def main(folder: Path) -> int:
    """Look at a site, and say what is wrong with it."""
    others = asked_of_others(folder)
    if program() is not None:
        others += requested_of_others(folder)
    for line in others:
        print(line)
    return 1 if others else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
