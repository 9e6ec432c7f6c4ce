"""A page on which a participant answers: the question, a button for each answer, and if asked for the running scene."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from html import escape
from typing import TYPE_CHECKING, Any

from graspfx.errors import GraspFXError
from graspfx.live.frame import Frames, history_of
from graspfx.live.scenery import scenery
from graspfx.live.view.page_server import Server, page_server
from graspfx.live.view.scene_tree import SceneTree
from graspfx.live.view.words_on_page import PAGE_STYLE
from graspfx.loop.recording.header import SPLIT, KeyChange
from graspfx.resource import Resource

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.scene.model import Scene

FRAME = 1.0 / 30.0  # from a frame to the next [s]
READY = "Ready"
SHAPES = ("object", "obstacle", "finger")  # tables that a picture follows from


class AnswerPage(Resource):
    """A page with buttons, on 127.0.0.1; a context manager, and a watcher of runs.

    Args:
        title: of the experiment.
        answers: by key.
        press: is called with the key of a button, or with Enter.
        scene: that is drawn; None for the question alone.
        port: by default the first that is free from 8080 on.

    Raises:
        MissingPackageError: no viser.
        InputError: the port is in use.
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
        self._draws, self._look = scene is not None, ""
        self._tree: SceneTree | None = None
        self._apart = 0.0
        if scene is not None:
            self._draw(scene)
        self._run: LiveRun | None = None
        self._lock, self._over = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._follow, name="page of answers", daemon=True)
        self._thread.start()

    def tell(self, text: str) -> None:
        """Show a text."""
        self._text.content = f"<div class=gfx style='font-size:17px;padding:10px 12px'><b>{escape(text)}</b></div>"

    def attach(self, run: LiveRun) -> None:
        """Draw a run from now on."""
        if self._draws:
            with self._lock:
                self._draw(run.scene)
                self._run = run

    def detach(self) -> None:
        """Leave what was drawn last."""
        with self._lock:
            self._run = None

    def close(self) -> None:
        """Let every page go."""
        self._over.set()
        self._thread.join()
        self.server.stop()

    def _buttons(self, label: str, keys: Mapping[str, str]) -> None:
        group = self.server.viser.gui.add_button_group(label, tuple(keys))

        async def press(event: Any) -> None:
            if event.client_id is not None:
                self._press(keys[event.target.value])

        group.on_click(press)

    def _draw(self, scene: Scene) -> None:
        """Draw what does not move, where it is not drawn already."""
        table = scene.to_dict()
        look = repr([table.get(name) for name in SHAPES])
        if look != self._look:
            drawn = scenery(scene)
            if self._tree is not None:
                self.server.viser.scene.reset()
            self._tree, self._apart, self._look = SceneTree(self.server.viser, drawn), drawn.apart, look

    def _follow(self) -> None:
        while not self._over.wait(FRAME):
            with self._lock:
                run, tree = self._run, self._tree
                if run is None or tree is None or not self.server.pages:
                    continue
                try:
                    tick, rows = run.rows(run.tick)
                    if len(rows):
                        splits = [KeyChange(since, SPLIT, split) for since, split in run.splits]
                        at = tick + len(rows) - 1
                        history = history_of(rows[-1:], run.layout, run.header, changes=splits, tick=at)
                        with self.server.viser.atomic():
                            tree.show(Frames(history, self._apart)[0])
                except GraspFXError:  # a run that ends while it is looked at
                    continue
