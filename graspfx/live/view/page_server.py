"""Page server: viser on 127.0.0.1 only, behind access control and without its public tunnel."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from graspfx import log
from graspfx.errors import GraspFXError, MissingPackageError, installation
from graspfx.live.view.gate import LARGEST, Gate
from graspfx.screen.own_page import HOST, listen_at

if TYPE_CHECKING:
    import viser

FIRST = 8080  # first port to try


def listen(port: int | None = None) -> socket.socket:
    """Bind a port of 127.0.0.1, and listen.

    Args:
        port: Port to bind; None for the first free one from 8080.

    Raises:
        InputError: The port is in use or not permitted.
    """
    return listen_at(HOST, port, FIRST, "--port")


LOGGER = "graspfx page"  # logger of the sockets, silent by default


def page_server(label: str, port: int | None = None, *, fits: Callable[[dict[str, Any]], bool] | None = None) -> Server:
    """Start the server of a page; add controls through its attribute `viser`.

    Args:
        label: Label above the page's controls.
        port: Port on 127.0.0.1; None for the first free one from 8080, 0 for any.
        fits: Additional check of messages from the page, for example whether a goal is within reach.

    Raises:
        MissingPackageError: viser is not installed.
        InputError: The port is in use.
    """
    require_viser()
    import viser

    return Server(viser, listen(port), label, fits)


def require_viser() -> None:
    """Require that viser is installed, without importing it.

    Raises:
        MissingPackageError: viser is not installed.
    """
    if find_spec("viser") is None:
        raise MissingPackageError.of_extra("viser", "a scene in a browser", "view")


class Server:
    """Server of a page.

    Args:
        package: The package viser.
        line: Listening socket.
        label: Label above the page's controls.
        fits: Additional check of messages from the page.

    Attributes:
        viser: Server of viser, to which controls are added.
        gate: Access control of the page.
        url: Address of the page.
    """

    def __init__(
        self, package: Any, line: socket.socket, label: str, fits: Callable[[dict[str, Any]], bool] | None
    ) -> None:
        self._fits, self._line = fits, line
        self.gate = Gate(self._accepts)
        self.url = f"http://{HOST}:{line.getsockname()[1]}"
        with _silent(), self._in_front(package) as entered:
            self.viser: viser.ViserServer = package.ViserServer(HOST, line.getsockname()[1], label, verbose=False)
        if not entered:
            self.stop()
            raise GraspFXError(
                f"viser {package.__version__} starts its server in a way that cannot be guarded; {installation('view')}"
            )
        self.viser.get_event_loop().call_soon_threadsafe(
            self.viser.get_event_loop().set_exception_handler, lambda _, context: log.debug("page: %s", context)
        )

    @property
    def pages(self) -> int:
        """Number of open pages."""
        return self.gate.pages

    def stop(self) -> None:
        """Close all pages, and free the port."""
        with _silent():
            self.viser.stop()
        self._line.close()

    def _accepts(self, message: dict[str, Any]) -> bool:
        """Tell whether a message is for an existing control and within its range."""
        kind = message["type"]
        if kind == "GuiUpdateMessage":
            return self._is_in_range(message["uuid"], message["updates"]["value"])
        if kind.startswith("TransformControls"):
            gizmos = self.viser.scene._handle_from_transform_controls_name
            return message["name"] in gizmos and (self._fits is None or self._fits(message))
        return True

    def _is_in_range(self, uuid: str, value: bool | float | str) -> bool:
        """Tell whether a value is valid for a control: an option of a button group, or in the range of a slider."""
        handle: Any = self.viser.gui._gui_input_handle_from_uuid.get(uuid)
        match type(handle).__name__:
            case "GuiButtonGroupHandle":
                return value in handle.options
            case "GuiSliderHandle":
                return not isinstance(value, bool | str) and handle.min <= value <= handle.max
        return False

    @contextmanager
    def _in_front(self, package: Any) -> Iterator[list[bool]]:
        """Make viser's server use the access control and the listening socket, by replacing its `websockets`."""
        import websockets
        from websockets.asyncio.server import serve as original

        infra: Any = import_module("viser.infra._infra")
        entered: list[bool] = []
        protocol, quiet = f"viser-v{package.__version__}", logging.getLogger(LOGGER)
        quiet.addHandler(logging.NullHandler())
        quiet.propagate = False

        def serve(handle: Any, host: str, port: int, **choices: Any) -> Any:
            entered.append(True)
            page = choices.pop("process_request")
            choices |= {"max_size": LARGEST, "logger": quiet, "sock": self._line, "server_header": None}
            return original(
                lambda connection: self.gate.enter(connection, handle, protocol),
                process_request=lambda connection, request: self.gate.answer(connection, request, page),
                **choices,
            )

        before = infra.websockets
        server = SimpleNamespace(serve=serve, ServerConnection=websockets.asyncio.server.ServerConnection)
        infra.websockets = SimpleNamespace(
            asyncio=SimpleNamespace(server=server), exceptions=websockets.exceptions,
            datastructures=websockets.datastructures,
        )  # fmt: skip
        try:
            yield entered
        finally:
            infra.websockets = before


@contextmanager
def _silent() -> Iterator[None]:
    """Keep viser from printing on the terminal."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
