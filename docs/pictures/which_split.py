"""Draws the figure of docs/explanation/which-split.md; with the argument `table` prints the page's table."""

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
MASSES = [0.3, 0.1, 0.1, 0.1]  # of the fingers' devices [kg]
WEIGHTS = [1.0, 1.0, 1.0, 3.0]
SPRINGS = [1.0, 1.0, 4.0, 1.0]  # of fingers and pads, of any unit
KINDS: dict[str, dict[str, Any]] = {
    "pseudoinverse": {}, "mass": {"weights": MASSES}, "weights": {"weights": WEIGHTS},
    "stiffness": {"stiffness": SPRINGS}, "virtual-linkage": {},
}  # fmt: skip
SPLITS: dict[str, dict[str, Any]] = {  # of a scene; the springs count like weights
    "pseudoinverse": {"split": "pseudoinverse"},
    "mass": {"split": "mass"},
    "weights": {"split": "weights", "weights": WEIGHTS},
    "stiffness": {"split": "weights", "weights": SPRINGS},
    "virtual-linkage": {"split": "pseudoinverse"},  # the same for contacts without moments
}
DRAWN = ("pseudoinverse", "mass", "stiffness")
REACH = 0.012  # [m/N]


def divided() -> dict[str, tuple[FloatArray, FloatArray]]:
    """Compute external and internal forces of the same grasp and load under each kind."""
    grasp = gx.Grasp(POINTS)
    kinds: dict[Any, dict[str, Any]] = dict(KINDS)
    return {kind: gx.divide(grasp, FORCE, kind=kind, **more) for kind, more in kinds.items()}


def scene(split: dict[str, Any]) -> gx.Scene:
    """Build the same grasp as a scene: four attached fingers, the first device three times as heavy as the others."""
    return gx.Scene(
        dimensions=2, period=0.005, duration=1.0,
        object={"mass": 0.1, "inertia": 4e-5, "viscosity": 0.8, "rotational_viscosity": 3e-4,
                "shape": {"kind": "box", "size": [0.06, 0.05]}},
        coupling={"contact": "attached", "external": {"stiffness": 15.0}, "internal": {"stiffness": 60.0}, **split},
        finger=[
            {"device": {"name": "simulated", "mass": mass, "damping": 0.3}, "start": point,
             "hand": {"stiffness": 33.0, "rest": point}}
            for mass, point in zip(MASSES, POINTS.tolist(), strict=True)
        ],
    )  # fmt: skip


def limits(kind: str) -> dict[str, float]:
    """Compute the stability limits of the internal and external gains [N/m]."""
    found = {row.mode: row.margin * row.gain for row in gx.certify(scene(SPLITS[kind]))[0].limits}
    return {mode: found[mode] for mode in ("internal", "external")}


def table() -> list[str]:
    """Write the page's table: push and squeeze of each finger, and the limits of the gains."""
    head = "| kind | push of each finger [N] | squeeze of each finger [N] | limit of kip [N/m] | limit of kep [N/m] |"
    lines = [head, "|---|---|---|---|---|"]
    for kind, parts in divided().items():
        push, squeeze = (", ".join(f"{size:.2f}" for size in np.linalg.norm(part, axis=1)) for part in parts)
        most = limits(kind)
        lines.append(f"| {kind} | {push} | {squeeze} | {most['internal']:.0f} | {most['external']:.1f} |")
    return lines


def draw() -> None:
    with gx.style.look():
        parts = {kind: each for kind, each in divided().items() if kind in DRAWN}
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


if __name__ == "__main__":
    if sys.argv[1:] == ["table"]:
        print(*table(), sep="\n")
    else:
        draw()
