"""The page of a scene with hardware: sliders go where the certificate lets them, and the recording has just that."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import count
from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.live.hardware_clamp import INSIDE, SHARE
from graspfx.live.live_run import LiveRun
from graspfx.live.sliders import sliders
from tests.support.chromium import Browser
from tests.support.servo_wires import BUSY, PATIENT, PRESSED, board, boards_scene, settled, undisturbed
from tests.support.view_page import serving
from tests.support.waiting import wait_until

pytestmark = pytest.mark.alone

pytest.importorskip("websockets", reason="the page needs websockets: pip install 'graspfx[view]'")

KIP, KID = "coupling.internal.stiffness", "coupling.internal.damping"
MECHANICS = {"finger.*.device.measures": {"mass": 0.1, "friction": 1.5}}
TEXT = "document.body.innerText"
SHOWN = f"graspfx.run.values[graspfx.run.sliders.findIndex((each) => each.key === '{KIP}')]"


def steer(browser: Browser, tmp_path: Path) -> tuple[gx.Scene, Path | None, float]:
    """Lead a gain up until it is clamped, and another one until it is refused, before a browser."""
    from graspfx.live.view.live_page import LivePage

    with board() as wire:
        scene = boards_scene([wire], PATIENT, engine="interpreted", **MECHANICS, **BUSY)
        numbers = [slider for slider in sliders(scene) if slider.key in (KIP, KID)]
        run = settled(lambda: LiveRun(scene, live=[slider.key for slider in numbers]))
        folders = (tmp_path / str(i) for i in count())  # another one where the machine is too busy for a board
        view = LivePage(run, numbers, lambda: next(folders), port=0, tell=lambda _: None)
        with run, view as page, serving(page):
            shown = browser.open(page.server.url)

            def says(text: str) -> Callable[[], bool]:
                return lambda: text in shown.evaluate(TEXT)

            wait_until(says("HARDWARE IS ARMED"))
            wait_until(says("spectral radius"), 300.0)
            settled(page._record)
            runs = run.run_number
            wire.place(np.array(PRESSED))
            wait_until(lambda: bool(np.abs(wire.torque).max() > 1e-3))
            page.sliders.set(KIP, 75.0)
            wait_until(lambda: page.sliders.values[KIP] == 75.0)
            page.sliders.set(KIP, 480.0)
            wait_until(says("at most 0.9 of each limit"))
            clamped = page.sliders.values[KIP]
            wait_until(lambda: shown.evaluate(SHOWN) == clamped)
            page.sliders.set(KID, 400.0)
            wait_until(says("refused: coupling.internal.damping = 400"))
            assert page.sliders.shown[KID] == page.sliders.values[KID] == 0.0
            for act in ("run", "pause", "reset"):  # a page does not stop or start a device that a person holds
                shown.evaluate(f"tell('{act}')")
            wait_until(lambda: page.server.counts["order"] == 3)
            assert run.state == "running" and run.run_number == runs
            assert not shown.console_errors
            time.sleep(0.1)
            folder = page.recording
            internal = run.scene.coupling.internal
    assert (internal.stiffness, internal.damping) == (clamped, 0.0)
    return scene, folder, clamped


def test_sliders_of_an_armed_board(browser: Browser, tmp_path: Path) -> None:
    """A browser looks on: a gain goes up, is clamped, is refused; the recording replays to the bit."""
    scene, folder, clamped = undisturbed(lambda k: steer(browser, tmp_path / str(k)))
    assert folder is not None
    recording = gx.Recording.load(folder)
    assert [(change.key, change.value) for change in recording.changes] == [(KIP, 75.0), (KIP, clamped)]
    limit = next(row.limit for row in gx.certify(scene.replace({KIP: clamped}))[0].limits if row.mode == "internal")
    assert SHARE * limit * (1.0 - 2.0 * INSIDE) < clamped < SHARE * limit
    again = gx.replay(recording)
    for name in ("finger_force", "displayed_force", "touching"):
        assert np.array_equal(getattr(again, name), getattr(recording, name)), name
    assert recording.displayed_force.any()
