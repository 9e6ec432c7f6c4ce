"""The socket of a stream: on this machine, or in the network, always behind a token."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import ExitStack

from graspfx.live.stream.state_stream import RATE, StateStream
from graspfx.screen.own_page import HOST, NAMES, listen_at
from graspfx.screen.stream_gate import StreamGate
from graspfx.screen.stream_server import SOCKET
from graspfx.screen.touch_address import network_address
from graspfx.screen.touch_gate import TOKEN

FIRST = 8770  # port to try


def stream_of(
    stack: ExitStack, *, rate: float = RATE, goals: bool = False, port: int | None = None, lan: bool = False,
    token: str | None = None, origins: Collection[str] = (),
) -> tuple[StateStream, str]:  # fmt: skip
    """Open a stream, which the stack closes; give it and its address, with the token.

    Args:
        stack: closes it.
        rate: of states [Hz].
        goals: whether clients may lead guides.
        port: by default the first that is free from 8770 on; 0 for any.
        lan: whether other machines in the network may have it.
        token: that clients bring; a new one if not given.
        origins: of browsers' pages that may open it.

    Raises:
        InputError: a port in use; a token that is short; a machine in no network; a rate that is none.
        MissingPackageError: websockets is not installed.
    """
    line = stack.enter_context(listen_at(network_address() if lan else HOST, port, FIRST, "--port"))
    host, number = line.getsockname()[:2]
    gate = StreamGate({host} if lan else NAMES, number if lan else 0, token, origins)
    stream = stack.enter_context(StateStream(line, gate, rate=rate, goals=goals))
    return stream, f"ws://{host}:{number}{SOCKET}?{TOKEN}={gate.token}"
