"""A gate before a page: who may have it, and from where; in a network only who has scanned its code.

On this machine a request is let in by its Host and its Origin: a page of another site has its own Origin, and a name
that was made to lead to 127.0.0.1 (DNS rebinding) is its own Host. In a network a token is asked for besides. It is in
the address that is printed, is good for one request within ten minutes, and is changed for a cookie, which the page's
socket and every later request must bring.
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

LIFE = 600.0  # of a token [s]
COOKIE = "graspfx-touch"
TOKEN = "token"
TRIES, PER = 5, 60.0  # wrong tokens of a peer, and the time in which they are forgotten [s]
MOST_PEERS = 1000  # whose wrong tokens are counted
MOST_SESSIONS = 32


class Bucket:
    """A budget of events: so many at once, and so many a second.

    Args:
        rate: a second.
        burst: at once.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self.rate, self.burst = rate, burst
        self._level, self._time = burst, -float("inf")

    def take(self, now: float) -> bool:
        """Spend one at a time [s]; tell whether it was there."""
        self._level = min(self.burst, self._level + self.rate * max(0.0, now - self._time))
        self._time = now
        if self._level < 1.0:
            return False
        self._level -= 1.0
        return True

    def is_empty(self, now: float) -> bool:
        """Tell whether nothing is left at a time [s]."""
        return min(self.burst, self._level + self.rate * max(0.0, now - self._time)) < 1.0


class Admission(NamedTuple):
    """The answer of a gate: a status other than 200 with its reason, or a cookie to be set."""

    status: HTTPStatus
    reason: str = ""
    cookie: str = ""


BARRED = Admission(HTTPStatus.TOO_MANY_REQUESTS, "too many wrong tokens: wait a minute")


class Gate:
    """A gate for requests to one address.

    Args:
        names: that the host may have.
        port: of the address; 0 for any, as behind a tunnel (`ssh -L`).
        locked: whether a token is asked for.
        clock: of the gate and of the server behind it [s].
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
        """Make a token, in place of the last; give it."""
        self._token, self._ends = secrets.token_urlsafe(24), self.clock() + LIFE
        return self._token

    def admit(self, target: str, headers: Mapping[str, str], peer: str, *, is_socket: bool) -> Admission:
        """Answer a request.

        Args:
            target: path and query.
            headers: of the request; one that stands twice must not be read as the first of them.
            peer: address from which it comes.
            is_socket: whether it opens a WebSocket, for which every browser tells the Origin.
        """
        if reason := refusal(headers, is_socket=is_socket, names=self.names, port=self.port):
            return Admission(HTTPStatus.FORBIDDEN, reason)
        if not self.locked or self._has_session(headers.get("Cookie", "")):
            return Admission(HTTPStatus.OK)
        token = "" if is_socket else token_in(target)
        if token and self._redeem(token, self.clock()):
            return Admission(HTTPStatus.OK, cookie=self._begin_session())
        return self._refused(peer, "scan the code that the terminal shows; each is good for one screen")

    def _refused(self, peer: str, reason: str) -> Admission:
        """Answer a wrong token, and count it; after too many of them the address is told to wait.

        Tokens are compared before: requests of others from the same address, as of any page that a browser there
        shows, keep nobody out who has the right one.
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
        """Take a token for good if it is the one; whether it has expired is looked at after it was compared."""
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
    """Compare in a time that does not tell how much is equal."""
    return hmac.compare_digest(one.encode(errors="replace"), other.encode())


def token_in(target: str) -> str:
    """Read the token in the path and query of a request; an empty text for none."""
    try:
        return parse_qs(urlsplit(target).query, max_num_fields=4).get(TOKEN, [""])[0]
    except ValueError:
        return ""


SHORTEST = 16  # letters of a token that a user chooses
TOKEN_FORM = re.compile(r"[A-Za-z0-9_-]+")
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
        if token is not None and (len(token) < SHORTEST or TOKEN_FORM.fullmatch(token) is None):
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
