"""The gate before a stream: programs bring a token; a browser's page only from where it is allowed."""

from __future__ import annotations

import re
import secrets
import time
from collections.abc import Callable, Collection, Mapping
from http import HTTPStatus

from graspfx.errors import InputError
from graspfx.screen.own_page import refusal
from graspfx.screen.touch_gate import Admission, Gate, is_same, token_in

SHORTEST = 16  # letters of a token that a user chooses
TOKEN = re.compile(r"[A-Za-z0-9_-]+")
ORIGIN = re.compile(r"https?://[A-Za-z0-9.-]+(:[0-9]{1,5})?")


class StreamGate(Gate):
    """A gate for programs, which tell no Origin as browsers do: each request brings the token, as often as it likes.

    Args:
        names: that the host may have.
        port: of the address; 0 for any, as behind a tunnel.
        token: 16 letters or more; by default a new one.
        origins: of pages that may open the stream besides one of this address, such as http://localhost:5000.
        clock: of the gate and of the server behind it [s].

    Attributes:
        token: as it is to be brought.

    Raises:
        InputError: a token that is short, or has letters that an address has not; an origin that is none.
    """

    def __init__(
        self, names: Collection[str], port: int, token: str | None = None, origins: Collection[str] = (),
        *, clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        super().__init__(names, port, locked=True, clock=clock)
        if token is not None and (len(token) < SHORTEST or TOKEN.fullmatch(token) is None):
            raise InputError("token", "*" * len(token), f"{SHORTEST} letters, digits, '_' and '-', or more")
        for origin in origins:
            if ORIGIN.fullmatch(origin) is None:
                raise InputError("origin", origin, "the address of a page without its path, as http://localhost:5000")
        self.token = secrets.token_urlsafe(24) if token is None else token
        self.origins = frozenset(origins)

    def admit(self, target: str, headers: Mapping[str, str], peer: str, *, is_socket: bool) -> Admission:
        """Answer a request.

        Args:
            target: path and query, with the token.
            headers: of the request; one that stands twice must not be read as the first of them.
            peer: address from which it comes.
            is_socket: whether it opens a WebSocket; a program that does tells no Origin.
        """
        own = {name: value for name, value in headers.items() if name != "Origin" or value not in self.origins}
        if reason := refusal(own, is_socket=False, names=self.names, port=self.port):
            return Admission(HTTPStatus.FORBIDDEN, reason)
        if is_same(token_in(target), self.token):
            return Admission(HTTPStatus.OK)
        return self._refused(peer, "the address ends in ?token= and the token that the terminal shows")
