"""Access control of pages and streams: Host and Origin checks, tokens and cookies.

On this machine a request needs the page's own Host and Origin: another site has a different Origin, and DNS rebinding
leads to a different Host. In a network a token is required too. The token is part of the printed address, is valid for
one request within ten minutes, and is exchanged for a cookie. The page's socket and all later requests need the cookie.
"""

from __future__ import annotations

import hmac
import re
import secrets
import time
from collections.abc import Callable, Collection, Mapping
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import NamedTuple
from urllib.parse import parse_qs, urlsplit

from graspfx.errors import InputError
from graspfx.screen.own_page import refusal

LIFE = 600.0  # validity of a token [s]
COOKIE = "graspfx-touch"
TOKEN = "token"
TRIES, PER = 5, 60.0  # number of wrong tokens allowed per peer, and the time until wrong tokens are forgotten [s]
MOST_PEERS = 1000  # largest number of peers whose wrong tokens are counted
MOST_SESSIONS = 32


class Bucket:
    """Token bucket that limits the rate of events.

    Args:
        rate: Highest mean rate [1/s].
        burst: Largest number of events at once.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self.rate, self.burst = rate, burst
        self._level, self._time = burst, -float("inf")

    def take(self, now: float) -> bool:
        """Count an event at time `now` [s]; return whether the limit allows it."""
        self._level = min(self.burst, self._level + self.rate * max(0.0, now - self._time))
        self._time = now
        if self._level < 1.0:
            return False
        self._level -= 1.0
        return True

    def is_empty(self, now: float) -> bool:
        """Tell whether the limit is reached at time `now` [s]."""
        return min(self.burst, self._level + self.rate * max(0.0, now - self._time)) < 1.0


class Admission(NamedTuple):
    """Result of access control: an HTTP status with a reason if it is not 200, and a cookie to set."""

    status: HTTPStatus
    reason: str = ""
    cookie: str = ""


BARRED = Admission(HTTPStatus.TOO_MANY_REQUESTS, "too many wrong tokens: wait a minute")


class Gate:
    """Access control for requests to one address.

    Args:
        names: Allowed host names.
        port: Port of the address; 0 for any, such as behind a tunnel (`ssh -L`).
        locked: Whether a token is required.
        clock: Clock of the gate and of its server [s].
    """

    def __init__(
        self, names: Collection[str], port: int, *, locked: bool, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.names, self.port, self.locked = frozenset(names), port, locked
        self.clock = clock
        self._token, self._ends = "", 0.0
        self._sessions: list[str] = []
        self._wrong: dict[str, Bucket] = {}

    def renew(self) -> str:
        """Replace the token by a new one, and return it."""
        self._token, self._ends = secrets.token_urlsafe(24), self.clock() + LIFE
        return self._token

    def admit(self, target: str, headers: Mapping[str, str], peer: str, *, is_socket: bool) -> Admission:
        """Answer a request.

        Args:
            target: Path and query.
            headers: Headers of the request; a repeated header must not be reduced to its first value.
            peer: Address of the sender.
            is_socket: Whether the request opens a WebSocket, for which every browser sends the Origin.
        """
        if reason := refusal(headers, is_socket=is_socket, names=self.names, port=self.port):
            return Admission(HTTPStatus.FORBIDDEN, reason)
        if not self.locked or self._has_session(headers.get("Cookie", "")):
            return Admission(HTTPStatus.OK)
        token = "" if is_socket else token_in(target)
        if token and self._redeem(token, self.clock()):
            return Admission(HTTPStatus.OK, cookie=self._begin_session())
        return self._refused(peer, "scan the code in the terminal; each code is valid for one screen")

    def _refused(self, peer: str, reason: str) -> Admission:
        """Answer a wrong token and count it; after too many wrong tokens, the address must wait.

        Tokens are compared before they are counted. Wrong requests from an address, for example from another page in
        the same browser, therefore do not lock out a person with the right token.
        """
        now, wrong = self.clock(), self._wrong.get(peer)
        if wrong is not None and wrong.is_empty(now):
            return BARRED
        if wrong is None:
            wrong = self._wrong[peer] = Bucket(TRIES / PER, TRIES)
            while len(self._wrong) > MOST_PEERS:
                del self._wrong[next(iter(self._wrong))]
        wrong.take(now)
        return Admission(HTTPStatus.FORBIDDEN, reason)

    def _has_session(self, header: str) -> bool:
        try:
            cookie = SimpleCookie(header).get(COOKIE)
        except CookieError:
            return False
        value = "" if cookie is None else cookie.value
        return any([is_same(value, each) for each in self._sessions])  # noqa: C419 (all of them: in constant time)

    def _redeem(self, token: str, now: float) -> bool:
        """Use up the token if it is correct; its age is checked after the comparison."""
        if not (is_same(token, self._token) and self._token and now < self._ends):
            return False
        self._token = ""
        return True

    def _begin_session(self) -> str:
        session = secrets.token_urlsafe(24)
        self._sessions.append(session)
        del self._sessions[:-MOST_SESSIONS]
        return f"{COOKIE}={session}; HttpOnly; SameSite=Strict; Path=/"


def is_same(one: str, other: str) -> bool:
    """Compare two texts in constant time."""
    return hmac.compare_digest(one.encode(errors="replace"), other.encode())


def token_in(target: str) -> str:
    """Read the token in the path and query of a request; empty if there is none."""
    try:
        return parse_qs(urlsplit(target).query, max_num_fields=4).get(TOKEN, [""])[0]
    except ValueError:
        return ""


SHORTEST = 16  # letters of a token that a user chooses
TOKEN_FORM = re.compile(r"[A-Za-z0-9_-]+")
ORIGIN = re.compile(r"https?://[A-Za-z0-9.-]+(:[0-9]{1,5})?")


class StreamGate(Gate):
    """Access control for programs: every request needs the token. Programs, unlike browsers, send no Origin.

    Args:
        names: Allowed host names.
        port: Port of the address; 0 for any, such as behind a tunnel.
        token: Token of 16 letters or more; None for a new one.
        origins: Origins of further web pages that may open the stream, such as http://localhost:5000.
        clock: Clock of the gate and of its server [s].

    Attributes:
        token: Token that requests need.

    Raises:
        InputError: If the token is too short or has characters not allowed in addresses, or an origin is invalid.
    """

    def __init__(
        self, names: Collection[str], port: int, token: str | None = None, origins: Collection[str] = (),
        *, clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        super().__init__(names, port, locked=True, clock=clock)
        if token is not None and (len(token) < SHORTEST or TOKEN_FORM.fullmatch(token) is None):
            raise InputError("token", "*" * len(token), f"at least {SHORTEST} letters, digits, '_' or '-'")
        for origin in origins:
            if ORIGIN.fullmatch(origin) is None:
                raise InputError("origin", origin, "a page's address without the path, such as http://localhost:5000")
        self.token = secrets.token_urlsafe(24) if token is None else token
        self.origins = frozenset(origins)

    def admit(self, target: str, headers: Mapping[str, str], peer: str, *, is_socket: bool) -> Admission:
        """Answer a request.

        Args:
            target: Path and query, with the token.
            headers: Headers of the request; a repeated header must not be reduced to its first value.
            peer: Address of the sender.
            is_socket: Whether the request opens a WebSocket; programs send no Origin.
        """
        own = {name: value for name, value in headers.items() if name != "Origin" or value not in self.origins}
        if reason := refusal(own, is_socket=False, names=self.names, port=self.port):
            return Admission(HTTPStatus.FORBIDDEN, reason)
        if is_same(token_in(target), self.token):
            return Admission(HTTPStatus.OK)
        return self._refused(peer, "the address must end in ?token= followed by the token in the terminal")
