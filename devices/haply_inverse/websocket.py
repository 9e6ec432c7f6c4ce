"""A WebSocket client for a real-time loop: without a thread, and with a deadline for every wait.

The package `websockets` encodes and decodes the protocol (RFC 6455); this module owns the socket.
"""

from __future__ import annotations

import logging
import select
import socket
import time
from collections import deque
from contextlib import suppress

from websockets.client import ClientProtocol
from websockets.exceptions import InvalidURI, PayloadTooBig
from websockets.frames import Frame, Opcode
from websockets.protocol import State
from websockets.uri import WebSocketURI, parse_uri

from graspfx.protocols import DeviceError, InputError

PATIENCE = 1.0  # longest time for connecting [s]
DATA = frozenset({Opcode.CONT, Opcode.TEXT, Opcode.BINARY})
MOST = 1 << 20  # largest message [bytes]
CHUNK = 1 << 16
SILENT = logging.Logger("websockets", logging.CRITICAL + 1)  # no log is written in a tick, whatever the configuration


def address(url: object) -> WebSocketURI:
    """Parse a URL such as ws://localhost:10001; encrypted connections (wss) are not accepted."""
    uri = None
    if isinstance(url, str) and all("!" <= letter <= "~" for letter in url):
        with suppress(InvalidURI, ValueError):
            uri = parse_uri(url)
    if uri is None or uri.secure:
        raise InputError("url", url, "an address such as ws://localhost:10001")
    return uri


class WebSocket:
    """A WebSocket connection that sends and receives texts.

    Args:
        url: Address of the service.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._uri = address(url)
        self._protocol = ClientProtocol(self._uri)
        self._socket: socket.socket | None = None
        self._texts: deque[str] = deque()
        self._parts = bytearray()  # received frames of an incomplete message

    def now(self) -> float:
        """Return the time of `time.perf_counter`, the clock of all deadlines [s]."""
        return time.perf_counter()

    def open(self) -> None:
        """Connect to the service, after closing an existing connection."""
        self.close()
        deadline = self.now() + PATIENCE
        try:
            self._socket = socket.create_connection((self._uri.host, self._uri.port), PATIENCE)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._greet(self._socket, deadline)
            self._socket.setblocking(False)
        except DeviceError:
            self.close()
            raise
        except OSError as error:
            self.close()
            raise DeviceError(f"no service answers at {self.url} ({error}): check that it is running") from error

    def _greet(self, line: socket.socket, deadline: float) -> None:
        protocol = self._protocol = ClientProtocol(self._uri, max_size=MOST, logger=SILENT)
        protocol.send_request(protocol.connect())
        line.sendall(b"".join(protocol.data_to_send()))
        size = 0
        while protocol.state is State.CONNECTING and protocol.handshake_exc is None:
            line.settimeout(max(1e-3, deadline - self.now()))
            try:
                part = line.recv(CHUNK)
            except TimeoutError:
                if not size:
                    raise
                break
            if not part or self.now() > deadline:
                break
            size += len(part)
            protocol.receive_data(part)
        if protocol.state is not State.CONNECTING:
            self._take()
            return
        error = protocol.handshake_exc
        raise DeviceError(
            f"the service at {self.url} is not a WebSocket server{f': {error}' if error else ''}"[:200]
        ) from error

    def send(self, text: str) -> None:
        """Send a text.

        The text is sent even if the service has sent a closing frame or invalid data, because zero force must be sent.

        Raises:
            DeviceError: If the connection is lost, or accepts no more data.
        """
        self._send(Frame(Opcode.TEXT, text.encode()).serialize(mask=True))

    def _send(self, data: bytes) -> None:
        try:
            count = self._line.send(data)
        except OSError as error:
            raise DeviceError(f"the connection to {self.url} is lost: {error}") from error
        if count != len(data):
            raise DeviceError(f"the service at {self.url} accepts no more data: a message was truncated")

    def receive(self, deadline: float) -> str | None:
        """Wait for a text until a deadline on the clock `now` [s]; return None if none arrives.

        Raises:
            DeviceError: If the connection is lost, or the data violate the WebSocket protocol.
        """
        while not self._texts:
            if not self._more(deadline):
                return None
        return self._texts.popleft()

    def _more(self, deadline: float) -> bool:
        """Wait for data until a deadline [s]; return whether data have arrived."""
        line, protocol = self._line, self._protocol
        if protocol.state is not State.OPEN:
            raise self._end()
        try:
            ready = select.select([line], [], [], max(0.0, deadline - self.now()))[0]
            part = line.recv(CHUNK) if ready else None
        except BlockingIOError:
            return False
        except (OSError, ValueError) as error:
            raise DeviceError(f"the connection to {self.url} is lost: {error}") from error
        if part is None:
            return False
        if not part:
            raise DeviceError(f"the connection to {self.url} is lost: the service has closed it")
        protocol.receive_data(part)
        self._take()
        return True

    def _take(self) -> None:
        """Process the received frames, and answer pings."""
        protocol = self._protocol
        for event in protocol.events_received():
            if isinstance(event, Frame) and event.opcode in DATA:
                self._parts += event.data
                if event.fin:
                    self._texts.append(self._parts.decode(errors="replace"))
                    self._parts.clear()
        answers = b"".join(protocol.data_to_send())
        # A closing frame is not answered here, because zero force could not be sent afterwards; `close` sends one.
        if answers and protocol.state is State.OPEN:
            self._send(answers)

    def _end(self) -> DeviceError:
        """Return an error that states why the connection has ended."""
        error = self._protocol.parser_exc
        if error is None:
            text = f"the service at {self.url} has closed the connection"
        elif isinstance(error, PayloadTooBig):
            text = f"the service at {self.url} sent a message of more than {MOST} bytes"
        else:
            text = f"the data from {self.url} violate the WebSocket protocol: {error}"
        end = DeviceError(text)
        end.__cause__ = error
        return end

    @property
    def _line(self) -> socket.socket:
        if self._socket is None:
            raise DeviceError(f"there is no connection to {self.url}")
        return self._socket

    def close(self) -> None:
        """Close the connection, without an error if the service has ended or the connection is already closed."""
        line, self._socket = self._socket, None
        if line is not None:
            with suppress(OSError):
                line.setblocking(False)
                line.send(Frame(Opcode.CLOSE, b"").serialize(mask=True))
            line.close()
        self._texts.clear()
        self._parts.clear()
