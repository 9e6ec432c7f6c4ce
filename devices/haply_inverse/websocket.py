"""A client's end of a WebSocket (RFC 6455) for a loop in real time: no thread, and no wait without an end."""

from __future__ import annotations

import base64
import hashlib
import os
import select
import socket
import struct
import time
from contextlib import suppress
from urllib.parse import urlsplit

from graspfx.protocols import DeviceError, InputError

MAGIC = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
PATIENCE = 1.0  # for the connection [s]
FINAL, MASK = 0x80, 0x80
MORE, TEXT, BINARY, CLOSE, PING, PONG = 0, 1, 2, 8, 9, 10  # kinds of frames
MOST = 1 << 20  # bytes of a message: a larger one is no answer of a device
CHUNK = 1 << 16


def address(url: object) -> tuple[str, int, str]:
    """Split a url such as ws://localhost:10001 into host, port and path."""
    expected = "an address such as ws://localhost:10001"
    if not isinstance(url, str):
        raise InputError("url", url, expected)
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise InputError("url", url, expected) from error
    if parts.scheme != "ws" or not host or any(letter <= " " or letter > "~" for letter in url):
        raise InputError("url", url, expected)
    return host, port or 80, (parts.path or "/") + (f"?{parts.query}" if parts.query else "")


class WebSocket:
    """A connection to a service, over which texts go both ways.

    Args:
        url: of the service.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._host, self._port, self._path = address(url)
        self._socket: socket.socket | None = None
        self._bytes = bytearray()
        self._parts = bytearray()  # of a message that comes in several frames

    def open(self) -> None:
        """Connect, afresh if there is a connection."""
        self.close()
        deadline = time.perf_counter() + PATIENCE
        try:
            self._socket = socket.create_connection((self._host, self._port), PATIENCE)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._greet(self._socket, deadline)
            self._socket.setblocking(False)
        except DeviceError:
            self.close()
            raise
        except OSError as error:
            self.close()
            raise DeviceError(f"nothing answers at {self.url}: {error}; is the service running?") from error

    def _greet(self, line: socket.socket, deadline: float) -> None:
        key = base64.b64encode(os.urandom(16))
        lines = (
            f"GET {self._path} HTTP/1.1", f"Host: {self._host}:{self._port}", "Upgrade: websocket",
            "Connection: Upgrade", f"Sec-WebSocket-Key: {key.decode()}", "Sec-WebSocket-Version: 13", "", "",
        )  # fmt: skip
        line.sendall("\r\n".join(lines).encode())
        data = bytearray()
        while b"\r\n\r\n" not in data:
            line.settimeout(max(1e-3, deadline - time.perf_counter()))
            part = line.recv(CHUNK)
            data += part
            if not part or len(data) > CHUNK or time.perf_counter() > deadline:
                raise DeviceError(f"what answers at {self.url} is no WebSocket")
        head, _, rest = bytes(data).partition(b"\r\n\r\n")
        status, *fields = head.decode("latin-1").split("\r\n")
        headers = {name.strip().lower(): value.strip() for name, _, value in (field.partition(":") for field in fields)}
        accept = base64.b64encode(hashlib.sha1(key + MAGIC).digest()).decode()
        if status.split(" ")[1:2] != ["101"] or headers.get("sec-websocket-accept") != accept:
            raise DeviceError(f"what answers at {self.url} is no WebSocket: {status[:80]}")
        self._bytes[:], self._parts[:] = rest, b""

    def send(self, text: str) -> None:
        """Send a text.

        Raises:
            DeviceError: the connection is lost, or takes no more.
        """
        self._send(TEXT, text.encode())

    def _send(self, kind: int, data: bytes) -> None:
        size, mask = len(data), os.urandom(4)
        if size < 126:
            head = bytes([FINAL | kind, MASK | size])
        elif size < 1 << 16:
            head = struct.pack(">BBH", FINAL | kind, MASK | 126, size)
        else:
            head = struct.pack(">BBQ", FINAL | kind, MASK | 127, size)
        key = int.from_bytes(mask * (-(-size // 4)), "little") & ((1 << 8 * size) - 1)
        frame = head + mask + (int.from_bytes(data, "little") ^ key).to_bytes(size, "little")
        try:
            count = self._line.send(frame)
        except OSError as error:
            raise DeviceError(f"the service at {self.url} is gone: {error}") from error
        if count != len(frame):
            raise DeviceError(f"the service at {self.url} takes no more: a message was cut")

    def receive(self, deadline: float) -> str | None:
        """Wait for a text until a time of `time.perf_counter` [s]; None if none has come.

        Raises:
            DeviceError: the connection is lost, or what comes is no WebSocket's.
        """
        while True:
            frame = self._frame()
            if frame is None:
                if not self._more(deadline):
                    return None
                continue
            final, kind, data = frame
            if kind == PING:
                self._send(PONG, data)
            elif kind == CLOSE:
                raise DeviceError(f"the service at {self.url} has closed the connection")
            elif kind in (TEXT, BINARY, MORE):
                self._parts += data
                if len(self._parts) > MOST:
                    raise DeviceError(f"the service at {self.url} sends a message of more than {MOST} bytes")
                if final:
                    text, self._parts = self._parts.decode(errors="replace"), bytearray()
                    return text

    def _frame(self) -> tuple[bool, int, bytes] | None:
        """Take a frame from what has come; None if it is not all there."""
        data = self._bytes
        if len(data) < 2:
            return None
        size, start = data[1] & 0x7F, 2
        if size > 125:
            width = 2 if size == 126 else 8
            if len(data) < start + width:
                return None
            size, start = int.from_bytes(data[start : start + width], "big"), start + width
        if data[1] & MASK or data[0] & 0x70 or size > MOST:
            raise DeviceError(f"what comes from {self.url} is no WebSocket's")
        if len(data) < start + size:
            return None
        frame = bool(data[0] & FINAL), data[0] & 0xF, bytes(data[start : start + size])
        del data[: start + size]
        return frame

    def _more(self, deadline: float) -> bool:
        """Wait for more bytes; tell whether some have come."""
        line = self._line
        try:
            ready = select.select([line], [], [], max(0.0, deadline - time.perf_counter()))[0]
            part = line.recv(CHUNK) if ready else None
        except BlockingIOError:
            return False
        except (OSError, ValueError) as error:
            raise DeviceError(f"the service at {self.url} is gone: {error}") from error
        if part is None:
            return False
        if not part:
            raise DeviceError(f"the service at {self.url} is gone: the connection is closed")
        self._bytes += part
        return True

    @property
    def _line(self) -> socket.socket:
        if self._socket is None:
            raise DeviceError(f"there is no connection to {self.url}")
        return self._socket

    def close(self) -> None:
        """Close the connection; returns also with the service gone, and twice."""
        line, self._socket = self._socket, None
        if line is not None:
            with suppress(OSError):
                line.setblocking(False)
                line.send(bytes([FINAL | CLOSE, MASK, 0, 0, 0, 0]))
            line.close()
        self._bytes.clear()
        self._parts.clear()
