"""The address of a touch screen's page: this machine's own, or in the network with a code to be scanned."""

from __future__ import annotations

import io
import socket

from graspfx.errors import InputError, MissingPackageError
from graspfx.screen.gate import TOKEN, Gate
from graspfx.screen.own_page import NAMES, listen_at

FIRST = 8765  # port to try
ELSEWHERE = "192.0.2.1", 9  # an address of no machine (RFC 5737): the way to it tells this one's own


def listen(host: str, port: int | None = None) -> socket.socket:
    """Bind a port of an address.

    Args:
        host: address of this machine.
        port: to bind, 0 for any that is free; by default the first that is free from 8765 on.

    Raises:
        InputError: it is in use, or not a program's to have.
    """
    return listen_at(host, port, FIRST)


def network_address() -> str:
    """Give this machine's address in the network, that of the interface which leads out; nothing is sent.

    Raises:
        InputError: it is in no network.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(ELSEWHERE)
            address = str(probe.getsockname()[0])
        except OSError as error:
            raise InputError("lan", True, "a machine that is in a network", str(error.strerror)) from error
    return address


def gate_for(line: socket.socket, *, lan: bool) -> Gate:
    """Make the gate of a page at a socket that listens; through a tunnel a loopback's port may be another."""
    host, port = line.getsockname()[:2]
    return Gate({host}, port, locked=True) if lan else Gate(NAMES, 0, locked=False)


def url(line: socket.socket, token: str = "") -> str:
    """Write the address of the page."""
    host, port = line.getsockname()[:2]
    return f"http://{host}:{port}/{f'?{TOKEN}={token}' if token else ''}"


def code(text: str) -> str:
    """Draw a text as a QR code in a terminal's letters.

    Raises:
        MissingPackageError: segno is not installed.
    """
    try:
        import segno
    except ImportError as error:
        raise MissingPackageError.of_extra("segno", "a code for a tablet", "touch") from error
    page = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(page, compact=True)
    return page.getvalue()
