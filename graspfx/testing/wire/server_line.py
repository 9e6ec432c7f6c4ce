"""A server's end of a WebSocket over a socket that waits; the package `websockets` reads and writes the protocol."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

from graspfx.errors import MissingPackageError

if TYPE_CHECKING:
    from websockets.server import ServerProtocol

CHUNK = 1 << 16


class ServerLine:
    """A connection that a client has asked for, over which messages go both ways.

    Args:
        line: the socket.
    """

    def __init__(self, line: socket.socket) -> None:
        self._line, self._protocol = line, server_protocol()
        self._parts = bytearray()  # of a message that comes in several frames

    def greet(self) -> list[bytes]:
        """Answer the request for a WebSocket; give the messages that have come with it.

        Raises:
            ConnectionError: the client has gone, or asks for something else.
        """
        from websockets.protocol import State

        while (messages := self.receive()) is not None and self._protocol.handshake_exc is None:
            if self._protocol.state is not State.CONNECTING:
                return messages
        raise ConnectionError

    def receive(self) -> list[bytes] | None:
        """Wait for bytes and give the messages that are whole by them; None at the end of the connection."""
        from websockets.frames import Frame, Opcode
        from websockets.http11 import Request
        from websockets.protocol import State

        part = self._line.recv(CHUNK)
        if not part:
            return None
        protocol, messages = self._protocol, list[bytes]()
        protocol.receive_data(part)
        for event in protocol.events_received():
            if isinstance(event, Request):
                protocol.send_response(protocol.accept(event))
            elif isinstance(event, Frame) and event.opcode in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
                self._parts += event.data
                if event.fin:
                    messages.append(bytes(self._parts))
                    self._parts.clear()
        self._flush()
        return messages if protocol.state in (State.CONNECTING, State.OPEN) else None

    def send(self, message: bytes) -> None:
        """Send a message as a text, of whatever bytes it is."""
        self._protocol.send_text(message)
        self._flush()

    def _flush(self) -> None:
        self._line.sendall(b"".join(self._protocol.data_to_send()))


def server_protocol() -> ServerProtocol:
    """Make a protocol of a server's that has met nobody.

    Raises:
        MissingPackageError: websockets is not installed.
    """
    try:
        from websockets.server import ServerProtocol
    except ImportError as error:
        raise MissingPackageError.of_extra("websockets", "the emulator of the Inverse service", "inverse") from error
    return ServerProtocol()
