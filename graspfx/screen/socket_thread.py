"""Common parts of the servers of pages and streams: a thread that serves a socket, and HTTP responses."""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, Self

from graspfx.errors import DeviceError, MissingPackageError

if TYPE_CHECKING:
    from websockets.http11 import Response

PATIENCE = 5.0  # timeout of handshakes, of closing, and of pings [s]
SILENT = logging.Logger("websockets", logging.CRITICAL + 1)
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Connection": "close",
}


class SocketThread:
    """Server in its own thread with its own event loop; a context manager.

    Args:
        line: Listening socket; the server closes it at the end.
        name: Name of the thread.

    Raises:
        DeviceError: If the socket cannot be served when the block is entered.
    """

    def __init__(self, line: socket.socket, name: str) -> None:
        self.line = line
        self._loop = asyncio.new_event_loop()
        self._stopping = asyncio.Event()
        self._ready, self._error = threading.Event(), list[BaseException]()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait()
        if self._error:
            self._thread.join()
            raise DeviceError(f"the page cannot be served: {self._error[0]}") from self._error[0]
        return self

    def __exit__(self, *exc: object) -> None:
        self._post(self._stopping.set)
        self._thread.join()

    def _post(self, call: Callable[..., object], *arguments: Any) -> None:
        """Call a function in the server's thread; do nothing if the thread has ended."""
        with suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(call, *arguments)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._main())
        except BaseException as error:  # noqa: BLE001 - raised by whoever waits
            self._error.append(error)
        finally:
            self._ready.set()
            self.line.close()
            self._loop.close()

    async def _main(self) -> None:
        raise NotImplementedError

    async def _serve_until_stopped(self) -> None:
        self._ready.set()
        await self._stopping.wait()


def response(status: HTTPStatus, body: bytes, more: Mapping[str, str] | None = None) -> Response:
    """Make an HTTP response; the body is plain text unless `more` has another Content-Type."""
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    headers = Headers(HEADERS | {"Content-Length": str(len(body)), "Content-Type": "text/plain; charset=utf-8"})
    for name, value in (more or {}).items():
        if name in headers:
            del headers[name]
        headers[name] = value
    return Response(status.value, status.phrase, headers, body)


def require_websockets(wanted_by: str = "a touch screen", extra: str = "touch") -> None:
    """Require the package websockets.

    Args:
        wanted_by: Feature that needs the package.
        extra: Extra of GraspFX that installs the package.

    Raises:
        MissingPackageError: If websockets is not installed.
    """
    try:
        import websockets.asyncio.server  # noqa: F401 (whether it is there)
    except ImportError as error:
        raise MissingPackageError.of_extra("websockets", wanted_by, extra) from error
