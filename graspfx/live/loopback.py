"""A page that only this machine reaches: a socket on 127.0.0.1, and no order from a page of another site."""

from __future__ import annotations

import errno
import socket
from collections.abc import Mapping
from urllib.parse import urlsplit

from graspfx.errors import InputError

HOST = "127.0.0.1"
NAMES = frozenset({HOST, "localhost"})
FIRST, MOST = 8080, 100  # ports to try


def listen(port: int | None = None) -> socket.socket:
    """Bind a port of 127.0.0.1.

    Args:
        port: to bind; by default the first that is free from 8080 on.

    Raises:
        InputError: it is in use, or not a program's to have.
    """
    if port is not None and not 0 <= port < 1 << 16:
        raise InputError("--port", port, "a port from 0 (any that is free) to 65535")
    ports = range(FIRST, FIRST + MOST) if port is None else (port,)
    for number in ports:
        line = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            line.bind((HOST, number))
            line.listen(16)
        except OSError as error:
            line.close()
            if error.errno not in (errno.EADDRINUSE, errno.EACCES) or port is not None:
                reason = "it is in use" if error.errno == errno.EADDRINUSE else str(error.strerror)
                raise InputError("--port", number, "a port that is free", reason) from error
            continue
        return line
    raise InputError("--port", f"{FIRST} to {FIRST + MOST - 1}", "a port that is free", "all are in use")


def refusal(headers: Mapping[str, str], *, is_socket: bool) -> str:
    """Say why a request is not one of this machine's own page; an empty text if it is.

    A browser names the site that it believes to talk to (Host), and the site whose page asks (Origin). A page of
    another site has its own Origin, and one whose name was made to lead to 127.0.0.1 (DNS rebinding) its own Host.
    Through a tunnel (`ssh -L`) the port may be another.

    Args:
        headers: of the request.
        is_socket: whether it opens a WebSocket, for which every browser tells the Origin.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    if _name(f"//{host}") not in NAMES:
        return "this page is served to 127.0.0.1 and localhost only"
    if (origin is None and is_socket) or (origin is not None and origin != f"http://{host}"):
        return "orders are taken from this machine's own page only"
    return ""


def _name(address: str) -> str | None:
    try:
        return urlsplit(address).hostname
    except ValueError:
        return None
