"""The one page of a touch screen, with a policy that lets it run nothing but itself."""

from __future__ import annotations

import secrets
from functools import cache
from pathlib import Path

PAGE = "touch_page.html"
NONCE = "@nonce@"


@cache
def _text() -> str:
    return (Path(__file__).parent / PAGE).read_text("utf-8")


def page_for(host: str) -> tuple[bytes, dict[str, str]]:
    """Write the page for a host, such as 127.0.0.1:8765; give it and its headers."""
    nonce = secrets.token_urlsafe(16)
    policy = (
        f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src ws://{host}; "
        "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return _text().replace(NONCE, nonce).encode(), {
        "Content-Type": "text/html; charset=utf-8",
        "Content-Security-Policy": policy,
    }
