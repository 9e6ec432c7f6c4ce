"""Answer page for participants: the question, a button for each answer, and optionally the running scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from graspfx.live.page.document import document
from graspfx.live.page.story import bare_story
from graspfx.live.run_look import RunLook
from graspfx.live.view.frame_feed import FrameFeed
from graspfx.live.view.page_server import Order, PageServer

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.scene.model import Scene

FRAME = 1.0 / 50.0  # interval between frames [s]
READY = "Ready"
SHAPES = ("object", "obstacle", "finger")  # tables that determine the picture


class AnswerPage(RunLook):
    """Page with a button for each answer, served on 127.0.0.1; a context manager that can draw the running scene.

    The page is reloaded if the objects, obstacles or fingers of a run differ from those on the page.

    Args:
        title: Title of the experiment.
        answers: Answers to the question, by key.
        press: Function called with the key of a pressed button, which may be Enter.
        scene: Scene whose runs are drawn; None for a page that shows only the question.
        port: Port of the page; None for the first free port from 8080.

    Attributes:
        server: Server of the page.

    Raises:
        MissingPackageError: If websockets is not installed.
        InputError: If the port is in use.
    """

    def __init__(
        self, title: str, answers: Mapping[str, str], press: Callable[[str], object], scene: Scene | None = None,
        *, port: int | None = None,
    ) -> None:  # fmt: skip
        self._press, self._draws = press, scene is not None
        self._keys = {**answers, "\n": READY}
        self._story, self._question = bare_story(title), ""
        self._shapes = self._drawn = ""  # shapes of the run, and shapes on the page
        self._title, self._again, self._runs = title, 0, 0
        self._feed: FrameFeed | None = None
        self.server = PageServer(self, port).__enter__()
        self.server.tell(self._state())
        super().__init__("page of answers", FRAME)

    def tell(self, text: str) -> None:
        """Show a text in place of the question."""
        self._question = text
        self.server.tell(self._state())

    def attach(self, run: LiveRun) -> None:
        """Start drawing a run, if the page draws a scene. The last picture remains after the run is detached."""
        if self._draws:
            super().attach(run)

    def close(self) -> None:
        """Stop drawing, and close the server of the page."""
        super().close()
        self.server.__exit__()

    def document(self, path: str, host: str) -> str | None:
        """Return the HTML text of the page; None for a path other than "/"."""
        if path != "/":
            return None
        ask = [{"key": key, "text": text} for key, text in self._keys.items()]
        live = {"live": True, "hardware": True, "again": self._again, "frames": self._story["ticks"], "ask": ask}
        return document(self._story | {"run": live}, "live", f"ws://{host}")

    def order(self, order: Order) -> bool:
        """Press the key of an answer; return False if the order is not an answer or the key is unknown."""
        if order.act != "answer" or order.key not in self._keys:
            return False
        self._press(order.key)
        return True

    def _state(self) -> dict[str, Any]:
        return {"again": self._again, "question": self._question}

    def _begin(self, run: LiveRun) -> None:
        self._feed, self._runs = FrameFeed(run), self._runs + 1
        table = run.scene.to_dict()
        self._shapes = repr([table.get(name) for name in SHAPES])

    def _look(self, run: LiveRun) -> None:
        """Send the newest frames if a browser is connected.

        If the shapes of the run are new, replace the page first.
        """
        if self._feed is None or run.tick < 0:
            return
        if self._shapes != self._drawn:
            self._story, self._drawn = self._feed.story() | {"title": self._title}, self._shapes
            self._again += 1
            self.server.tell(self._state())
        if self.server.clients and (news := self._feed.news()) is not None:
            self.server.show(self._runs, news.first, news.frames)
