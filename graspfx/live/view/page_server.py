"""The server of the page: viser's, on a port of 127.0.0.1 only, behind the gate, without its tunnel to the world."""

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

FIRST = 8080  # port to try


def listen(port: int | None = None) -> socket.socket:
    """Bind a port of 127.0.0.1.

    Args:
        port: to bind; by default the first that is free from 8080 on.

    Raises:
        InputError: it is in use, or not a program's to have.
    """
    return listen_at(HOST, port, FIRST, "--port")


LOGGER = "graspfx page"  # of the sockets: heard by who listens to it, else silent


def page_server(label: str, port: int | None = None, *, fits: Callable[[dict[str, Any]], bool] | None = None) -> Server:
    """Start the server of a page; its controls are made through `.viser`.

    Args:
        label: above the page's controls.
        port: on 127.0.0.1; by default the first that is free from 8080 on, 0 for any.
        fits: a further condition on messages from the page, as of a goal out of reach.

    Raises:
        MissingPackageError: no viser.
        InputError: the port is in use.
    """
    require_viser()
    import viser

    return Server(viser, listen(port), label, fits)


def require_viser() -> None:
    """Require that viser is installed, without loading it.

    Raises:
        MissingPackageError: it is not.
    """
    if find_spec("viser") is None:
        raise MissingPackageError.of_extra("viser", "a scene in a browser", "view")


class Server:
    """A page's server.

    Args:
        package: viser.
        line: the socket that listens.
        label: above the page's controls.
        fits: a further condition on messages from the page.

    Attributes:
        viser: the server of viser, by which the page is made.
        gate: through which the page's messages come.
        url: of the page.
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
        """Count the pages that look on."""
        return self.gate.pages

    def stop(self) -> None:
        """Let every page go, and free the port."""
        with _silent():
            self.viser.stop()
        self._line.close()

    def _accepts(self, message: dict[str, Any]) -> bool:
        """Tell whether a message is for a control that there is, and within its range."""
        kind = message["type"]
        if kind == "GuiUpdateMessage":
            return self._is_in_range(message["uuid"], message["updates"]["value"])
        if kind.startswith("TransformControls"):
            gizmos = self.viser.scene._handle_from_transform_controls_name
            return message["name"] in gizmos and (self._fits is None or self._fits(message))
        return True

    def _is_in_range(self, uuid: str, value: bool | float | str) -> bool:
        """Tell whether a control takes a value: a button group one of its options, a slider what is on it."""
        handle: Any = self.viser.gui._gui_input_handle_from_uuid.get(uuid)
        match type(handle).__name__:
            case "GuiButtonGroupHandle":
                return value in handle.options
            case "GuiSliderHandle":
                return not isinstance(value, bool | str) and handle.min <= value <= handle.max
        return False

    @contextmanager
    def _in_front(self, package: Any) -> Iterator[list[bool]]:
        """Put the gate, and the socket that listens, where viser's server looks for those of `websockets`."""
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
    """Let viser print nothing on the terminal."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
