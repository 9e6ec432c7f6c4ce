"""Draws the figure of docs/how-to/feedback.md: its MuJoCo gripper beside its loop, as both are on the page."""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[2]))

import graspfx as gx
from tests.support import feedback_page as page

FloatArray = NDArray[np.float64]
DURATION = 3.0


def measured() -> FloatArray:
    """Run the page's gripper; return rows of time, grip, push, the hand's height and aperture."""
    rows: list[tuple[float, ...]] = []

    def watch(shown: Any, hand: Any, space: dict[str, Any]) -> None:
        rows.append((space["data"].time, shown.grip, shown.push[2], hand.centre[2], hand.aperture))

    with TemporaryDirectory() as folder:
        model = Path(folder) / "gripper.xml"
        model.write_text(page.blocks("xml")[0], encoding="utf-8")
        scene = page.scene(Path(folder), **{"host.name": "picture", "host.silence": 5.0})
        page.run_host(page.blocks("python")[1], scene, DURATION, {"MODEL": str(model)}, watch)
    return np.array(rows)


def draw() -> None:
    time, grip, push, height, aperture = measured().T
    with gx.style.look():
        sheet = gx.style.figure([1.6, 1.1])
        [forces], [motion] = sheet.panels
        forces.plot(time, grip, color=gx.style.INTERNAL, label="grip, of the squeeze")
        forces.plot(time, push, color=gx.style.EXTERNAL, label="push, vertical")
        forces.axhline(-0.1 * 9.81, color="0.6", lw=0.8, ls=":")
        forces.legend(loc="lower right")
        gx.style.panel(
            forces, y="force on the operator [N]", title="A gripper of MuJoCo closes on a box of 0.1 kg and lifts it"
        )
        motion.plot(time, 1e3 * height, color="0.3", label="height of the hand")
        motion.plot(time, 1e3 * aperture, color="0.3", ls="--", label="aperture")
        motion.legend(loc="center right")
        gx.style.panel(motion, x="time [s]", y="operator [mm]")
    gx.style.save(sheet, Path(__file__).parent / "feedback.png")


if __name__ == "__main__":
    draw()
