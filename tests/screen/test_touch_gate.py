"""The gate before a page: this machine's own page, and in a network whoever has scanned the code."""

from __future__ import annotations

from http import HTTPStatus

import pytest

from graspfx.screen.gate import COOKIE, LIFE, NAMES, Bucket, Gate, code
from tests.support.hardware import VirtualClock

OPEN = Gate(NAMES, 0, locked=False)
HOST = "192.168.1.7:8765"
TABLET = "192.168.1.20"


def locked() -> tuple[Gate, VirtualClock]:
    clock = VirtualClock()
    return Gate({"192.168.1.7"}, 8765, locked=True, clock=clock.now), clock


@pytest.mark.parametrize(
    ("host", "origin", "is_socket", "is_let_in"),
    [
        ("127.0.0.1:8765", None, False, True),
        ("localhost:8765", "http://localhost:8765", True, True),
        ("localhost:9000", "http://localhost:9000", True, True),  # through a tunnel
        ("127.0.0.1:8765", None, True, False),  # every browser tells it
        ("127.0.0.1:8765", "http://localhost:8765", True, False),
        ("127.0.0.1:8765", "https://127.0.0.1:8765", True, False),
        ("127.0.0.1:8765", "null", True, False),
        ("127.0.0.1:8765", "http://evil.example", False, False),
        ("evil.example:8765", "http://evil.example:8765", True, False),  # a name made to lead here
        ("127.0.0.1.evil.example", None, False, False),
        ("user@127.0.0.1:8765", None, False, False),
        ("127.0.0.1@localhost", None, False, False),
        ("127.0.0.1/x", None, False, False),
        ("127.0.0.1:", None, False, False),
        ("[::1]", None, False, False),
        ("127.0.0.1:port", None, False, False),
        ("[::1", None, False, False),
        ("", None, False, False),
    ],
)
def test_hosts_and_origins(host: str, origin: str | None, is_socket: bool, is_let_in: bool) -> None:
    headers = {"Host": host} | ({} if origin is None else {"Origin": origin})
    for gate in (OPEN, Gate(NAMES, 0, locked=False)):
        admission = gate.admit("/", headers, "127.0.0.1", is_socket=is_socket)
        assert (admission.status == HTTPStatus.OK) == is_let_in
        assert admission.status in (HTTPStatus.OK, HTTPStatus.FORBIDDEN)


def test_a_token_lets_one_screen_in_once() -> None:
    gate, clock = locked()
    token = gate.renew()
    headers = {"Host": HOST}
    assert len(token) >= 32 and token != locked()[0].renew()
    first = gate.admit(f"/?token={token}", headers, TABLET, is_socket=False)
    assert first.status == HTTPStatus.OK
    assert first.cookie.endswith("HttpOnly; SameSite=Strict; Path=/")
    assert gate.admit(f"/?token={token}", headers, "192.168.1.66", is_socket=False).status == HTTPStatus.FORBIDDEN
    cookie = {"Cookie": f"other=1; {first.cookie.partition(';')[0]}"}
    own = headers | cookie | {"Origin": f"http://{HOST}"}
    assert gate.admit("/socket", own, TABLET, is_socket=True).status == HTTPStatus.OK
    assert gate.admit("/", headers | cookie, TABLET, is_socket=False).cookie == ""
    clock.sleep(10 * LIFE)
    assert gate.admit("/socket", own, TABLET, is_socket=True).status == HTTPStatus.OK  # while the server runs
    for other in ({}, {"Cookie": f"{COOKIE}=x"}, {"Cookie": f"{COOKIE}="}, {"Cookie": "\0;;="}):
        stranger = headers | {"Origin": f"http://{HOST}"} | other
        assert gate.admit("/socket", stranger, f"10.0.0.{len(str(other))}", is_socket=True).status != HTTPStatus.OK
    elsewhere = own | {"Host": "evil.example:8765", "Origin": "http://evil.example:8765"}
    assert gate.admit("/socket", elsewhere, TABLET, is_socket=True).status == HTTPStatus.FORBIDDEN


def test_a_token_expires_and_is_renewed() -> None:
    gate, clock = locked()
    token = gate.renew()
    clock.sleep(LIFE)
    assert gate.admit(f"/?token={token}", {"Host": HOST}, TABLET, is_socket=False).status == HTTPStatus.FORBIDDEN
    other = gate.renew()
    assert gate.admit(f"/?token={token}", {"Host": HOST}, TABLET, is_socket=False).status == HTTPStatus.FORBIDDEN
    assert gate.admit(f"/?token={other}", {"Host": HOST}, TABLET, is_socket=False).status == HTTPStatus.OK


def test_no_empty_token_lets_anybody_in() -> None:
    gate, _ = locked()
    for target in ("/", "/?token=", "/?token", "/?" + "a=1&" * 100):
        assert gate.admit(target, {"Host": HOST}, target, is_socket=False).status == HTTPStatus.FORBIDDEN
    gate.admit(f"/?token={gate.renew()}", {"Host": HOST}, TABLET, is_socket=False)
    assert gate.admit("/?token=", {"Host": HOST}, "10.0.0.2", is_socket=False).status == HTTPStatus.FORBIDDEN
    token = gate.renew()
    socket = {"Host": HOST, "Origin": f"http://{HOST}"}
    refused = gate.admit(f"/socket?token={token}", socket, "10.0.0.3", is_socket=True)
    assert refused.status == HTTPStatus.FORBIDDEN  # the token is for the page


def test_wrong_tokens_are_few_in_a_minute() -> None:
    """Five a minute from one address; the right one is let in at any time, or any page could lock it out."""
    gate, clock = locked()
    token = gate.renew()
    headers = {"Host": HOST}
    answers = [gate.admit("/?token=wrong", headers, TABLET, is_socket=False).status for _ in range(8)]
    assert answers == [HTTPStatus.FORBIDDEN] * 5 + [HTTPStatus.TOO_MANY_REQUESTS] * 3
    assert gate.admit(f"/?token={token}", headers, TABLET, is_socket=False).status == HTTPStatus.OK
    assert gate.admit(f"/?token={token}", headers, TABLET, is_socket=False).status == HTTPStatus.TOO_MANY_REQUESTS
    clock.sleep(13.0)
    assert gate.admit(f"/?token={token}", headers, TABLET, is_socket=False).status == HTTPStatus.FORBIDDEN
    for i in range(3000):
        gate.admit("/?token=wrong", headers, f"10.0.{i // 256}.{i % 256}", is_socket=False)
    assert len(gate._wrong) <= 1000


def test_a_budget_is_spent_and_comes_back() -> None:
    bucket = Bucket(10.0, 3.0)
    assert [bucket.take(0.0) for _ in range(4)] == [True, True, True, False]
    assert [bucket.take(time) for time in (0.05, 0.11, 0.25, 0.25)] == [False, True, True, False]


def test_a_code_is_drawn_for_a_terminal() -> None:
    pytest.importorskip("segno", reason="it draws the code: pip install 'graspfx[touch]'")
    lines = code(f"http://{HOST}/?token={'a' * 32}").splitlines()
    assert len(lines) > 15 and len({len(line) for line in lines if line.strip()}) <= 2
