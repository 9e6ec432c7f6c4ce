"""Address of the touch-screen page: local, or in the network with a QR code."""

from __future__ import annotations

import io
import socket

from graspfx.errors import InputError, MissingPackageError
from graspfx.screen.gate import TOKEN, Gate
from graspfx.screen.own_page import NAMES, listen_at

FIRST = 8765  # first port to try
ELSEWHERE = "192.0.2.1", 9  # unused address (RFC 5737); the route to it reveals this machine's address


def listen(host: str, port: int | None = None) -> socket.socket:
    """Bind a port of an address, and listen.

    Args:
        host: Address of this machine.
        port: Port to bind, 0 for any free one; None for the first free one from 8765.

    Raises:
        InputError: If the port is in use or not permitted.
    """
    return listen_at(host, port, FIRST)


def network_address() -> str:
    """Return the address of this machine's interface with the default route; no packet is sent.

    Raises:
        InputError: If the machine is not in a network.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(ELSEWHERE)
            address = str(probe.getsockname()[0])
        except OSError as error:
            raise InputError("lan", True, "a machine in a network", str(error.strerror)) from error
    return address


def gate_for(line: socket.socket, *, lan: bool) -> Gate:
    """Make the access control for a listening socket; on loopback the port is not checked, because of tunnels."""
    host, port = line.getsockname()[:2]
    return Gate({host}, port, locked=True) if lan else Gate(NAMES, 0, locked=False)


def url(line: socket.socket, token: str = "") -> str:
    """Return the address of the page."""
    host, port = line.getsockname()[:2]
    return f"http://{host}:{port}/{f'?{TOKEN}={token}' if token else ''}"


def code(text: str) -> str:
    """Return a text as a QR code of terminal characters.

    Raises:
        MissingPackageError: If segno is not installed.
    """
    try:
        import segno
    except ImportError as error:
        raise MissingPackageError.of_extra("segno", "a QR code for a tablet", "touch") from error
    page = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(page, compact=True)
    return page.getvalue()
