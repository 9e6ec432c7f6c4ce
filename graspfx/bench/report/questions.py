"""Questions that the benchmarks' figures answer, one each, in at most three panels; all else stands in the tables."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from graspfx.bench.measure import Row

Measure = Literal["time", "error"]

NAMES = {"time": "time of one operation [µs]", "error": "error"}
MOST_PANELS = 3


@dataclass(frozen=True)
class Curves:
    """Time or error of methods over a number that stands in the cases' names.

    Attributes:
        cases: pattern of their names, of which the first group is the number.
        x: what the number is.
        y: what is drawn over it.
        methods: with their names in the figure.
        title: of the panel.
    """

    cases: str
    x: str
    y: Measure
    methods: Mapping[str, str]
    title: str = ""

    def points(self, rows: Sequence[Row]) -> dict[str, list[tuple[float, float]]]:
        """List the points of each method, ordered by the number."""
        points: dict[str, list[tuple[float, float]]] = {}
        for row in rows:
            match, value = re.fullmatch(self.cases, row.case), row.time_us if self.y == "time" else row.error
            if match and row.method in self.methods and value is not None and row.state == "timed":
                points.setdefault(self.methods[row.method], []).append((float(match[1]), value))
        return {name: sorted(each) for name, each in points.items()}


@dataclass(frozen=True)
class Scatter:
    """Error over time in one case; methods of one name up to " to " are one line.

    Attributes:
        case: its name.
        methods: with their names in the figure; all of them if empty.
        title: of the panel.
    """

    case: str
    methods: Mapping[str, str] = field(default_factory=dict)
    title: str = ""


@dataclass(frozen=True)
class Dots:
    """Time of each method as a dot on a line of its own.

    Attributes:
        cases: with the names of their markers, empty where there is one case.
        title: of the panel.
        x: name of the time, with its unit.
        unit: how many of it are a microsecond.
    """

    cases: Mapping[str, str]
    title: str = ""
    x: str = NAMES["time"]
    unit: float = 1.0


@dataclass(frozen=True)
class Spread:
    """Quantiles of each case's methods, a case on a line of its own."""

    quantiles: tuple[str, ...] = ("p50", "p99.9", "max")
    title: str = ""
    x: str = "time of a tick [µs]"


@dataclass(frozen=True)
class Savings:
    """Times of each case's methods on a line of its own, from the quickest to the slowest, each named."""

    title: str = ""
    x: str = "time of a tick [µs]"


Panel = Curves | Scatter | Dots | Spread | Savings


@dataclass(frozen=True)
class Question:
    """A question, and the panels that answer it.

    Attributes:
        text: with its question mark.
        panels: at most three.
        stacked: below one another instead of side by side.
    """

    text: str
    panels: tuple[Panel, ...]
    stacked: bool = False


EQ4 = {
    "GraspFX PointCoupling, compiled": "GraspFX, compiled",
    "GraspFX PointCoupling, interpreted": "GraspFX, interpreted",
    "numpy pinv": "numpy pinv",
    "numpy lstsq": "numpy lstsq",
    "numpy solve": "numpy solve",
    "scipy gelsy": "scipy gelsy",
}
CONES = {
    "GraspFX Newton in modes, compiled": "GraspFX, compiled",
    "GraspFX Newton in modes, interpreted": "GraspFX, interpreted",
    "GraspFX unilateral_force": "GraspFX unilateral_force",
    **{f"clarabel to 1e-{k:02d}": "clarabel" for k in (8, 12)},
    **{f"Gauss-Seidel to 1e-{k:02d}": "Gauss-Seidel" for k in (3, 6, 9, 12)},
}
CONTACT = {
    "GraspFX, compiled": "GraspFX, compiled",
    "GraspFX, interpreted": "GraspFX, interpreted",
    "trimesh": "trimesh",
    "coal": "coal",
    "PyBullet, concave": "PyBullet, concave",
    "PyBullet, hull": "PyBullet, hull",
}
BODIES = {
    "GraspFX exact": "GraspFX exact",
    "GraspFX implicit": "GraspFX implicit",
    "GraspFX semi-implicit": "GraspFX semi-implicit",
    "PyBullet": "PyBullet",
    "MuJoCo implicitfast": "MuJoCo implicitfast",
    "MuJoCo RK4": "MuJoCo RK4",
}
GAINS = {"kep = kip": "$k_{ep} = k_{ip}$", "kep < kip": "$k_{ep} < k_{ip}$"}


def _gains(case: str, more: str = "") -> dict[str, str]:
    return {f"{case}, {gains}{more}": name for gains, name in GAINS.items()}


QUESTIONS = {
    "eq4": Question(
        "Which way to compute eq. (4) is quick with many fingers, and exact in nearly singular grasps?",
        (
            Curves(r"(\d+) fingers", "fingers", "time", EQ4),
            Curves(r"5 fingers, condition (1e\d)", "condition of the grasp, 5 fingers", "error", EQ4),
        ),
    ),
    "projection": Question(
        "How long does it take until the forces of 5 fingers lie in their cones?",
        (
            Scatter("frictionless, 5 fingers, gains' ratio 1000", CONES, "no friction, gains 1000 : 1"),
            Scatter("associated, 5 fingers, gains' ratio 1000", CONES, "associated law, gains 1000 : 1"),
            Scatter("coulomb, 5 fingers, gains' ratio 30", CONES, "Coulomb's law, gains 30 : 1"),
        ),
    ),
    "contact": Question(
        "What does contact with a mesh cost as the mesh gets finer, and how far off is it?",
        (
            Curves(r"sphere, (\d+) triangles", "triangles", "time", CONTACT),
            Curves(r"sphere, (\d+) triangles", "triangles", "error", CONTACT),
        ),
    ),
    "bodies": Question(
        "How far off is a free body after its motion, by the time step?",
        tuple(
            Curves(rf"{case}, T = ([\d.]+) ms", "time step [ms]", "error", BODIES, case)
            for case in ("line, viscous", "spinning cube", "tumbling box")
        ),
    ),
    "ticks": Question(
        "What does a whole tick cost?",
        (
            Dots(_gains("line, 2 fingers"), "on a line, 2 fingers", "time of a tick [µs]"),
            Dots(_gains("plane, 3 fingers"), "in the plane, 3 fingers", "time of a tick [µs]"),
            Dots(_gains("space, 5 fingers"), "in space, 5 fingers", "time of a tick [µs]"),
        ),
    ),
    "runs": Question(
        "What does a tick of a whole run cost, from the scene to the recording?",
        (Dots(_gains("space, 5 fingers", ", 10000 ticks"), x="time of a tick [µs]"),),
    ),
    "skips": Question("What does a tick save where a scene does not need a step?", (Savings(),)),
    "batches": Question(
        "What does a run of 1000 ticks cost within a batch?",
        (
            Dots({
                "10000 values of one key, 1000 ticks": "10000 values of one key",
                "1000 random points of two keys, 1000 ticks": "1000 points of two keys",
                "100 by 100 values of two keys, 1000 ticks": "100 by 100 values",
            }, x="time of a run [µs]"),
        ),
    ),
    "maps": Question(
        "What does a point of a map of limits cost, and how exact is it?",
        (
            Scatter("device that moves an object, 200 by 200", title="device that moves an object"),
            Scatter("device on a wall, 200 by 200", title="device on a wall"),
        ),
    ),
    "startup": Question(
        "How long does one wait for the first result?",
        (
            Dots({"whole processes": ""}, "whole processes", "time [s]", 1e-6),
            Dots({"paper-waving": ""}, "paper-waving", "time [s]", 1e-6),
            Dots({"mug": ""}, "mug", "time [s]", 1e-6),
        ),
        stacked=True,
    ),
    "jitter": Question("How late is a tick at worst?", (Spread(),)),
}  # fmt: skip


def question(name: str, title: str, rows: Sequence[Row]) -> Question:
    """Give the question that a benchmark's figure answers; of one without, its first cases."""
    if name in QUESTIONS:
        return QUESTIONS[name]
    cases = list(dict.fromkeys(row.case for row in rows if row.time_us is not None))[:MOST_PANELS]
    errs = any((row.error or 0.0) > 0.0 for row in rows)
    return Question(title, tuple(Scatter(case, title=case) if errs else Dots({case: ""}, case) for case in cases))
