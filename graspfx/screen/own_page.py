"""A page's own address: a port that a program listens at, and the checks of Host and Origin of every request to it.

A browser names the site that it believes to talk to (Host), and the site whose page asks (Origin). A page of another
site has its own Origin, and one whose name was made to lead to 127.0.0.1 (DNS rebinding) its own Host. Through a tunnel
(`ssh -L`) the port may be another.
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
MOST = 100  # ports to try
ADDRESS = re.compile(r"([A-Za-z0-9.-]+)(?::([0-9]{1,5}))?")  # nothing else comes into a page's policy
IDENTITY = ("Host", "Origin", "Cookie")  # headers that say who asks


def listen_at(host: str, port: int | None, first: int, name: str = "port") -> socket.socket:
    """Bind a port of an address.

    Args:
        host: address of this machine.
        port: to bind, 0 for any that is free; None for the first that is free from `first` on.
        first: port to try.
        name: of the setting, for errors.

    Raises:
        InputError: it is in use, or not a program's to have.
    """
    if port is not None and not 0 <= port < 1 << 16:
        raise InputError(name, port, "a port from 0 (any that is free) to 65535")
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
            raise InputError(name, number, "a port that is free", reason) from error
        return line
    raise InputError(name, f"{first} to {first + MOST - 1}", "a port that is free", "all are in use")


def single(headers: Any) -> Mapping[str, str] | None:
    """Read the headers that say who asks; None where one of them stands twice.

    Args:
        headers: of a request, whose names are of any case, with `get_all`.
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
    """Say why a request does not come from a page's own address; an empty text if it does.

    Args:
        headers: of the request, as of `single`.
        is_socket: whether it opens a WebSocket, for which every browser tells the Origin.
        names: that the host may have, in small letters.
        port: of the address; 0 for any, as behind a tunnel.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    match = ADDRESS.fullmatch(host)
    if match is None or match[1].lower() not in names or port not in (0, int(match[2] or 80)):
        return "this page is served under its own address only, such as 127.0.0.1 or localhost"
    if (origin is None and is_socket) or (origin is not None and origin != f"http://{host}"):
        return "orders are taken from this server's own page only"
    return ""
