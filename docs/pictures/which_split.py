"""Draws the figure of docs/explanation/which-split.md; with the argument `table` prints its numbers."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import graspfx as gx

FloatArray = NDArray[np.float64]

POINTS = np.array([[-0.03, 0.0], [0.01, 0.025], [0.03, 0.0], [0.01, -0.025]])  # [m]
FORCE = np.array([[3.0, 0.0], [0.0, -1.0], [-1.0, 0.5], [0.0, 1.0]])  # of the fingers on the object [N]
WEIGHTS = [3.0, 1.0, 1.0, 1.0]
KINDS: dict[str, dict[str, Any]] = {
    "pseudoinverse": {}, "mass": {"weights": WEIGHTS}, "stiffness": {"stiffness": [1.0, 1.0, 4.0, 1.0]},
}  # fmt: skip
REACH = 0.012  # [m/N]


def divided() -> dict[str, tuple[FloatArray, FloatArray]]:
    """Give external and internal forces of the same grasp and load under each kind."""
    grasp = gx.Grasp(POINTS)
    kinds: dict[Any, dict[str, Any]] = dict(KINDS)
    return {kind: gx.divide(grasp, FORCE, kind=kind, **more) for kind, more in kinds.items()}


def margins() -> dict[str, tuple[float, float]]:
    """Give the internal and external margins of a pinch by devices of 0.3 and 0.1 kg, under each split of a scene."""
    heavy = {"name": "simulated", "mass": 0.3, "damping": 0.4}
    light = {"name": "simulated", "mass": 0.1, "damping": 0.2}
    changes: dict[str, dict[str, Any]] = {
        "pseudoinverse": {},
        "mass": {"coupling.split": "mass"},
        "weights 1 : 3": {"coupling.split": "weights", "coupling.weights": [1.0, 3.0]},
        "object stiffness": {"coupling.external": {"object_stiffness": [60.0, 60.0, 0.0375]}},
    }
    found = {}
    for name, change in changes.items():
        scene = gx.load("paper-waving", {"finger.0.device": heavy, "finger.1.device": light, **change})
        rows = {row.mode: row.margin for row in gx.certify(scene)[0].limits}
        found[name] = rows["internal"], rows["external"]
    return found


def draw() -> None:
    with gx.style.look():
        parts = divided()
        sheet = gx.style.figure([2.2], columns=len(parts))
        for axes, (kind, (external, internal)) in zip(sheet.panels[0], parts.items(), strict=True):
            axes.plot(*np.vstack([POINTS, POINTS[:1]]).T, color="0.8", lw=1.0)
            for forces, colour in ((internal, gx.style.INTERNAL), (external, gx.style.EXTERNAL)):
                for point, f in zip(POINTS, forces, strict=True):
                    end = point + REACH * f
                    axes.annotate("", end, point, arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.4})
            axes.set(xlim=(-0.045, 0.062), ylim=(-0.045, 0.045), aspect="equal", xticks=[], yticks=[])
            gx.style.panel(axes, title=kind)
    gx.style.save(sheet, Path(__file__).parent / "which-split.png")


def tell() -> None:
    for kind, parts in divided().items():
        push, squeeze = (np.linalg.norm(part, axis=1).round(3).tolist() for part in parts)
        print(f"{kind}: push {push} N, squeeze {squeeze} N")
    for name, (internal, external) in margins().items():
        print(f"{name}: margin internal {internal:.2f}, external {external:.2f}")


if __name__ == "__main__":
    if sys.argv[1:] == ["table"]:
        tell()
    else:
        draw()
