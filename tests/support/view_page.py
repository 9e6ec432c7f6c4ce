"""A live view for tests: served by a thread while a browser looks on, and places of things on its picture."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

import graspfx as gx
from graspfx.live.live_run import LiveRun
from graspfx.live.sliders import sliders
from graspfx.live.view.live_view import LiveView
from tests.support.chromium import Page, Pixels

STIFFNESS = "coupling.external.stiffness"
SLOW = """(() => {
  const own = window.requestAnimationFrame.bind(window); let last = 0;
  window.requestAnimationFrame = call => own(function wait(time) {
    if (performance.now() - last > 90) { last = performance.now(); call(time); } else setTimeout(() => own(wait), 30);
  });
})()"""  # about ten pictures a second: they are drawn by processors that others need, too
PLAIN = "document.head.insertAdjacentHTML('beforeend', '<style>#webgl-software-rendering{display:none}</style>')"


@contextmanager
def live_view(name: str, folder: Path) -> Iterator[LiveView]:
    """Run a scene whose external stiffness can change, each finger's hand guided, and serve its page."""
    scene = gx.load(name)
    numbers = [each for each in sliders(scene) if each.key == STIFFNESS]
    count = iter(range(100))
    with (
        LiveRun(scene, live=[STIFFNESS], guide="hands") as run,
        LiveView(run, numbers, lambda: folder / f"recording-{next(count)}", port=0, tell=lambda _: None) as view,
        serving(view),
    ):
        yield view


@contextmanager
def serving(view: LiveView) -> Iterator[None]:
    """Let a thread serve a page within."""
    over = threading.Event()
    thread = threading.Thread(target=view.serve, args=(over.is_set,))
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(10.0)


def place(page: Page, view: LiveView, point: ArrayLike) -> tuple[float, float]:
    """Project a point in space [m] onto a page's picture [CSS pixels]."""
    x, y, w, h = page.evaluate(
        "(() => { const b = document.querySelector('canvas').getBoundingClientRect();"
        " return [b.left, b.top, b.width, b.height] })()"
    )
    camera = list(view.server.viser.get_clients().values())[-1].camera
    a, b, c, d = camera.wxyz
    turn = np.array([
        [1 - 2 * (c * c + d * d), 2 * (b * c - d * a), 2 * (b * d + c * a)],
        [2 * (b * c + d * a), 1 - 2 * (b * b + d * d), 2 * (c * d - b * a)],
        [2 * (b * d - c * a), 2 * (c * d + b * a), 1 - 2 * (b * b + c * c)],
    ])  # fmt: skip
    right, down, away = turn.T @ (np.asarray(point, dtype=float) - camera.position)
    focal = 0.5 * h / np.tan(0.5 * camera.fov)
    return x + 0.5 * w + focal * right / away, y + 0.5 * h + focal * down / away


def is_in_place(view: LiveView) -> bool:
    """Tell whether the newest page looks from where it should: viser's own camera is some metres away at first."""
    camera = list(view.server.viser.get_clients().values())[-1].camera
    start = np.asarray(view.server.viser.initial_camera.position)
    return bool(np.linalg.norm(camera.position - start) < 1e-3)


def near(pixels: Pixels, colour: str, tolerance: int = 60) -> NDArray[np.bool_]:
    """Mark the pixels that have about a colour, (h, w)."""
    target = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return np.asarray((np.abs(pixels.astype(int) - target) <= tolerance).all(axis=2))


def vermilion(pixels: Pixels) -> NDArray[np.bool_]:
    """Mark the pixels that are vermilion, or that are seen through an object (h, w); axes of gizmos are pink."""
    red, green, blue = np.moveaxis(pixels.astype(int), 2, 0)
    return np.asarray((red > green + 25) & (green > blue + 15))
