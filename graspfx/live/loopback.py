"""A port of 127.0.0.1 for the page of a view, which only this machine reaches."""

from __future__ import annotations

from socket import socket

from graspfx.screen.own_page import HOST, listen_at

FIRST = 8080  # port to try


def listen(port: int | None = None) -> socket:
    """Bind a port of 127.0.0.1.

    Args:
        port: to bind; by default the first that is free from 8080 on.

    Raises:
        InputError: it is in use, or not a program's to have.
    """
    return listen_at(HOST, port, FIRST, "--port")
