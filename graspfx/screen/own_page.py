"""Listening port of a local page, and the Host and Origin checks of every request.

A browser sends the site that it addresses (Host) and the site whose page makes the request (Origin). A page of another
site has a different Origin; with DNS rebinding it has a different Host. A tunnel (`ssh -L`) may change the port.
"""

from __future__ import annotations

import errno
import re
import socket
from collections.abc import Collection, Mapping
from typing import Any

from graspfx.errors import InputError

HOST = "127.0.0.1"
NAMES = frozenset({HOST, "localhost"})
MOST = 100  # number of ports to try
ADDRESS = re.compile(r"([A-Za-z0-9.-]+)(?::([0-9]{1,5}))?")  # only such text may enter the page's security policy
IDENTITY = ("Host", "Origin", "Cookie")  # headers that identify the sender


def listen_at(host: str, port: int | None, first: int, name: str = "port") -> socket.socket:
    """Bind a port of an address, and listen.

    Args:
        host: Address of this machine.
        port: Port to bind, 0 for any free one; None for the first free one from `first`.
        first: First port to try.
        name: Name of the setting, for errors.

    Raises:
        InputError: If the port is in use or not permitted.
    """
    if port is not None and not 0 <= port < 1 << 16:
        raise InputError(name, port, "a port from 0 (any free one) to 65535")
    for number in range(first, first + MOST) if port is None else (port,):
        line = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            line.bind((host, number))
            line.listen(16)
        except OSError as error:
            line.close()
            if port is None and error.errno in (errno.EADDRINUSE, errno.EACCES):
                continue
            reason = "it is in use" if error.errno == errno.EADDRINUSE else str(error.strerror)
            raise InputError(name, number, "a free port", reason) from error
        return line
    raise InputError(name, f"{first} to {first + MOST - 1}", "a free port", "all are in use or not permitted")


def single(headers: Any) -> Mapping[str, str] | None:
    """Read the headers that identify the sender; None if a header occurs twice.

    Args:
        headers: Headers of a request, with a case-insensitive `get_all`.
    """
    values: dict[str, str] = {}
    for name in IDENTITY:
        every = headers.get_all(name)
        if len(every) > 1:
            return None
        if every:
            values[name] = every[0]
    return values


def refusal(headers: Mapping[str, str], *, is_socket: bool, names: Collection[str] = NAMES, port: int = 0) -> str:
    """Return the reason why a request is not from the page's own address; empty if it is.

    Args:
        headers: Headers of the request, from `single`.
        is_socket: Whether the request opens a WebSocket, for which every browser sends the Origin.
        names: Allowed host names, in lower case.
        port: Port of the address; 0 for any, such as behind a tunnel.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    match = ADDRESS.fullmatch(host)
    if match is None or match[1].lower() not in names or port not in (0, int(match[2] or 80)):
        return "this page is served under its own address only, such as 127.0.0.1 or localhost"
    if (origin is None and is_socket) or (origin is not None and origin != f"http://{host}"):
        return "orders are accepted from this server's own page only"
    return ""
