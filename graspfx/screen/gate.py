"""Access control for pages and streams: ports and addresses, checks of Host and Origin, tokens and cookies.

A browser sends the address of the requested site (Host) and the address of the site whose page makes the request
(Origin). A request is refused if its Host is not that of the page, or if its Origin is not that of the page. A request
for a WebSocket needs an Origin; other requests may omit it. A page of another site has a different Origin, and an
attack by DNS rebinding has a different Host. On this computer any port is accepted, because a tunnel (`ssh -L`) may
change the port. In a network a page also requires a token, which is part of the printed address. The token is valid for
one request within ten minutes, and is exchanged for a cookie, which the WebSocket and all later requests need. A stream
requires its token in every request (`StreamGate`).
"""

from __future__ import annotations

import errno
import hmac
import io
import re
import secrets
import socket
import time
from collections.abc import Callable, Collection, Mapping
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Any, NamedTuple
from urllib.parse import parse_qs, urlsplit

from graspfx.errors import InputError, MissingPackageError

HOST = "127.0.0.1"
NAMES = frozenset({HOST, "localhost"})
FIRST = 8765  # first port to try
MOST = 100  # number of ports to try
ELSEWHERE = "192.0.2.1", 9  # unused address (RFC 5737); the route to it reveals this machine's address
ADDRESS = re.compile(r"([A-Za-z0-9.-]+)(?::([0-9]{1,5}))?")  # only such text may enter the page's security policy
IDENTITY = ("Host", "Origin", "Cookie")  # headers that identify the sender
LIFE = 600.0  # validity of a token [s]
COOKIE = "graspfx-touch"
TOKEN = "token"
TRIES, PER = 5, 60.0  # number of wrong tokens allowed per peer, and the time until all of them are forgotten [s]
MOST_PEERS = 1000  # largest number of peers whose wrong tokens are counted
MOST_SESSIONS = 32


def listen(host: str, port: int | None = None, first: int = FIRST, name: str = "port") -> socket.socket:
    """Bind a port of an address, and return the listening socket.

    Args:
        host: Address of this computer.
        port: Port to bind; 0 for any free port; None for the first free port from `first` on.
        first: First port to try if `port` is None.
        name: Name of the setting, for the error message.

    Raises:
        InputError: If the port is invalid, in use or not permitted, or if none of the `MOST` ports that are tried is
            free.
    """
    if port is not None and not 0 <= port < 1 << 16:
        raise InputError(name, port, "a port from 0 to 65535, where 0 is any free port")
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
    raise InputError(name, f"{first} to {first + MOST - 1}", "a free port", "all of them are in use or not permitted")


def network_address() -> str:
    """Return the address of this computer in the network of its default route; no packet is sent.

    Raises:
        InputError: If the computer is not in a network.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(ELSEWHERE)
            address = str(probe.getsockname()[0])
        except OSError as error:
            raise InputError("lan", True, "a computer in a network", str(error.strerror)) from error
    return address


def names_of(line: socket.socket, *, lan: bool) -> tuple[Collection[str], int]:
    """Return the allowed host names and port of a listening socket; without `lan`, port 0 allows any, for tunnels."""
    host, port = line.getsockname()[:2]
    return ({host}, port) if lan else (NAMES, 0)


def url(line: socket.socket, token: str = "") -> str:
    """Return the address of the page of a listening socket, with the token if there is one."""
    host, port = line.getsockname()[:2]
    return f"http://{host}:{port}/{f'?{TOKEN}={token}' if token else ''}"


def code(text: str) -> str:
    """Return a text as a QR code that consists of characters for a terminal.

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


def single(headers: Any) -> Mapping[str, str] | None:
    """Return the headers that identify the sender of a request, by name; None if one of them occurs twice.

    Args:
        headers: Headers of the request, with a case-insensitive method `get_all`.
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
    """Return the reason for which a request is refused as not from the page itself; empty if it is admitted.

    Args:
        headers: Headers of the request, as returned by `single`.
        is_socket: Whether the request opens a WebSocket, for which every browser sends the Origin.
        names: Allowed host names, in lower case.
        port: Allowed port; 0 for any port, for example behind a tunnel.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    match = ADDRESS.fullmatch(host)
    if match is None or match[1].lower() not in names or port not in (0, int(match[2] or 80)):
        return "this page is only served at its own address, such as 127.0.0.1 or localhost"
    if (origin is None and is_socket) or (origin is not None and origin != f"http://{host}"):
        return "orders are only accepted from the page of this server"
    return ""


class Bucket:
    """Token bucket, which limits the rate of events.

    Args:
        rate: Largest mean rate [1/s].
        burst: Largest number of events that may occur at once.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self.rate, self.burst = rate, burst
        self._level, self._time = burst, -float("inf")

    def take(self, now: float) -> bool:
        """Return whether the limit allows an event at time `now` [s], and count the event if so."""
        self._level = min(self.burst, self._level + self.rate * max(0.0, now - self._time))
        self._time = now
        if self._level < 1.0:
            return False
        self._level -= 1.0
        return True


class Admission(NamedTuple):
    """Result of access control: HTTP status, reason for a status other than 200, and cookie to set (may be empty)."""

    status: HTTPStatus
    reason: str = ""
    cookie: str = ""


BARRED = Admission(HTTPStatus.TOO_MANY_REQUESTS, "too many wrong tokens: wait a minute")


class Gate:
    """Access control for the requests to one address.

    Args:
        names: Allowed host names.
        port: Allowed port; 0 for any port, for example behind a tunnel (`ssh -L`).
        locked: Whether a token is required.
        clock: Clock for the validity of tokens and for rates [s].
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
        """Return a new token, which replaces the previous one."""
        self._token, self._ends = secrets.token_urlsafe(24), self.clock() + LIFE
        return self._token

    def admit(self, target: str, headers: Mapping[str, str], peer: str, *, is_socket: bool) -> Admission:
        """Return the decision on a request; the request is admitted if the status is 200.

        Args:
            target: Path and query of the request.
            headers: Headers of the request, as returned by `single`.
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
        """Count a missing or wrong token, and return the refusal; after too many, the refusal says to wait.

        A token is compared before it is counted. Therefore, wrong requests from an address, for example from another
        page in the same browser, do not exclude a person who has the right token.
        """
        wrong = self._wrong.setdefault(peer, Bucket(TRIES / PER, TRIES))
        while len(self._wrong) > MOST_PEERS:
            del self._wrong[next(iter(self._wrong))]
        return Admission(HTTPStatus.FORBIDDEN, reason) if wrong.take(self.clock()) else BARRED

    def _has_session(self, header: str) -> bool:
        try:
            cookie = SimpleCookie(header).get(COOKIE)
        except CookieError:
            return False
        value = "" if cookie is None else cookie.value
        return any([is_same(value, each) for each in self._sessions])  # noqa: C419 (all of them: in constant time)

    def _redeem(self, token: str, now: float) -> bool:
        """Return whether a token is correct and not too old; a correct token becomes invalid."""
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
    """Return whether two texts are equal; the comparison takes a time that does not depend on the texts' content."""
    return hmac.compare_digest(one.encode(errors="replace"), other.encode())


def token_in(target: str) -> str:
    """Return the token in the query of a request; empty if there is none."""
    try:
        return parse_qs(urlsplit(target).query, max_num_fields=4).get(TOKEN, [""])[0]
    except ValueError:
        return ""


SHORTEST = 16  # letters of a token that a user chooses
TOKEN_FORM = re.compile(r"[A-Za-z0-9_-]+")
ORIGIN = re.compile(r"https?://[A-Za-z0-9.-]+(:[0-9]{1,5})?")


class StreamGate(Gate):
    """Access control for programs, which need the token in every request and, unlike browsers, send no Origin.

    Args:
        names: Allowed host names.
        port: Allowed port; 0 for any port, for example behind a tunnel.
        token: Token of 16 characters or more; None for a random token.
        origins: Origins of web pages that may also open the stream, such as http://localhost:5000.
        clock: Clock for rates [s].

    Attributes:
        token: Token that every request needs.

    Raises:
            InputError: If the token is too short or contains a character other than letters, digits, "_" and "-", or if
                an origin is invalid.
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
                raise InputError("origin", origin, "the address of a site without path, such as http://localhost:5000")
        self.token = secrets.token_urlsafe(24) if token is None else token
        self.origins = frozenset(origins)

    def admit(self, target: str, headers: Mapping[str, str], peer: str, *, is_socket: bool) -> Admission:
        """Return the decision on a request; the request is admitted if the status is 200.

        Args:
            target: Path and query of the request; the query must contain the token.
            headers: Headers of the request, as returned by `single`.
            peer: Address of the sender.
            is_socket: Whether the request opens a WebSocket; an Origin is not required, because programs send none.
        """
        own = {name: value for name, value in headers.items() if name != "Origin" or value not in self.origins}
        if reason := refusal(own, is_socket=False, names=self.names, port=self.port):
            return Admission(HTTPStatus.FORBIDDEN, reason)
        if is_same(token_in(target), self.token):
            return Admission(HTTPStatus.OK)
        return self._refused(peer, "the address must end in ?token= and the token that the terminal shows")


def gate_for(line: socket.socket, *, lan: bool) -> Gate:
    """Return the access control for a page at a listening socket; in a network (`lan`) a token is required."""
    return Gate(*names_of(line, lan=lan), locked=lan)
