"""Answer page for participants: the question, a button for each answer, and optionally the running scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from typing import TYPE_CHECKING, Any

from graspfx.live.frame import Frames, history_of
from graspfx.live.run_look import RunLook
from graspfx.live.scenery import scenery
from graspfx.live.view.page_server import Server, page_server
from graspfx.live.view.scene_tree import SceneTree
from graspfx.live.view.words_on_page import PAGE_STYLE
from graspfx.recording.header import SPLIT, KeyChange

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.scene.model import Scene

FRAME = 1.0 / 30.0  # interval between frames [s]
READY = "Ready"
SHAPES = ("object", "obstacle", "finger")  # tables that determine the picture


class AnswerPage(RunLook):
    """Page with buttons on 127.0.0.1. A context manager; watches runs.

    Args:
        title: Title of the experiment.
        answers: Answers by key.
        press: Function called with the key of a pressed button, or with Enter.
        scene: Scene to draw; None for the question only.
        port: Port of the page; None for the first free one from 8080.

    Raises:
        MissingPackageError: viser is not installed.
        InputError: The port is in use.
    """

    def __init__(
        self, title: str, answers: Mapping[str, str], press: Callable[[str], object], scene: Scene | None = None,
        *, port: int | None = None,
    ) -> None:  # fmt: skip
        self._press = press
        self.server: Server = page_server(title, port)
        viser = self.server.viser
        viser.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(55, 71, 79))
        viser.gui.add_html(PAGE_STYLE)
        self._text = viser.gui.add_html("<div></div>")
        if answers:
            self._buttons("answer", {answer: key for key, answer in answers.items()})
        self._buttons("go on", {READY: "\n"})
        self._draws, self._drawn = scene is not None, ""
        self._tree: SceneTree | None = None
        self._apart = 0.0
        if scene is not None:
            self._draw(scene)
        super().__init__("page of answers", FRAME)

    def tell(self, text: str) -> None:
        """Show a text."""
        self._text.content = f"<div class=gfx style='font-size:17px;padding:10px 12px'><b>{escape(text)}</b></div>"

    def attach(self, run: LiveRun) -> None:
        """Start drawing a run. Its last picture stays after it is detached."""
        if self._draws:
            super().attach(run)

    def close(self) -> None:
        """Close all pages."""
        super().close()
        self.server.stop()

    def _buttons(self, label: str, keys: Mapping[str, str]) -> None:
        group = self.server.viser.gui.add_button_group(label, tuple(keys))

        async def press(event: Any) -> None:
            if event.client_id is not None:
                self._press(keys[event.target.value])

        group.on_click(press)

    def _draw(self, scene: Scene) -> None:
        """Draw the scene's shapes, unless they are drawn already."""
        table = scene.to_dict()
        look = repr([table.get(name) for name in SHAPES])
        if look != self._drawn:
            drawn = scenery(scene)
            if self._tree is not None:
                self.server.viser.scene.reset()
            self._tree, self._apart, self._drawn = SceneTree(self.server.viser, drawn), drawn.apart, look

    def _begin(self, run: LiveRun) -> None:
        self._draw(run.scene)

    def _look(self, run: LiveRun) -> None:
        tree = self._tree
        if tree is None or not self.server.pages:
            return
        tick, rows = run.rows(run.tick)
        if len(rows):
            splits = [KeyChange(since, SPLIT, split) for since, split in run.splits]
            history = history_of(rows[-1:], run.layout, run.header, changes=splits, tick=tick + len(rows) - 1)
            with self.server.viser.atomic():
                tree.show(Frames(history, self._apart)[0])
