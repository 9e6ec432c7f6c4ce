"""Motions that do not settle grow in a run by the factor in the note; those that settle have none."""

from __future__ import annotations

import re
from math import exp
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.resolve import resolve
from graspfx.certificate.notes import unsettled

T, M, B = 0.005, 0.1, 0.5  # [s, kg, N s/m]
GAP = 0.02


def scene(kep: float = 10.0, kip: float = 10.0, free: bool = True, rest: tuple[float, float] = (0.0, 0.0)) -> gx.Scene:
    """Two devices on a line that never let go, each behind a spring of 5 N/m whose rest is shifted by `rest` [m]."""
    device = {"name": "simulated", "mass": M, "damping": B}
    return gx.Scene(
        dimensions=1,
        period=T,
        duration=2.0,
        object={"mass": 0.2, "viscosity": 0.3, "free": [free]},
        coupling={"contact": "attached", "external": {"stiffness": kep}, "internal": {"stiffness": kip}},
        finger=[
            {"device": device, "start": [x], "hand": {"stiffness": 5.0, "damping": 0.1, "rest": [x + shift]}}
            for x, shift in zip((-GAP, GAP), rest, strict=True)
        ],
    )


def named_factor(made: gx.Scene) -> float:
    [said] = unsettled(resolve(made))
    return float(re.findall(r"grows ([\d.]+)-fold", said)[0])


@pytest.mark.parametrize(("kep", "kip", "right"), [(10.0, 4e2, -1), (10.0, 1e3, -1), (3e2, 10.0, 1), (1e3, 10.0, 1)])
def test_a_squeeze_or_a_swing_grows_in_a_run_as_it_says(kep: float, kip: float, right: int) -> None:
    made = scene(kep, kip, rest=(0.001, 0.001 * right))
    assert grown(gx.run(made, {"coupling.force_bound": 1e39})) == pytest.approx(
        named_factor(made), rel=5e-3
    )  # three digits are printed


def test_with_the_mass_metric_the_gains_are_as_the_masses() -> None:
    """The modes of unequal devices are then those of equal ones, if friction and hands are as the masses too."""
    alike = scene(kip=1000.0)
    values = {"device.mass": M, "device.damping": B, "hand.stiffness": 5.0, "hand.damping": 0.1}
    unequal = {f"finger.{i}.{key}": c * value for i, c in enumerate((0.5, 1.5)) for key, value in values.items()}
    assert named_factor(alike.replace(unequal | {"coupling.metric": "mass"})) == named_factor(alike)


def grown(rec: gx.Recording) -> float:
    """Fit the factor by which an alternating force grows per sample: that of its envelope."""
    force = np.diff(rec.finger_force[:, 0, 0])  # without what the springs hold at rest
    late = np.arange(150, 390)
    peaks = late[np.abs(force[late]) >= np.maximum(np.abs(force[late - 1]), np.abs(force[late + 1]))]
    return float(exp(np.polyfit(peaks, np.log(np.abs(force[peaks])), 1)[0]))


def test_the_limit_of_a_held_spring() -> None:
    """m x'' + b x' = -k x held for T: the product of its two multipliers reaches one at this k (Jury)."""
    a = exp(-B * T / M)
    g = T / B - M / B**2 * (1.0 - a)
    limit = (1.0 - a) / ((1.0 - a) ** 2 * M / B**2 - a * g)
    assert limit == pytest.approx(2.0 * B / T, rel=0.02)  # k T/2 = b, less what the mass gives

    def lone(kip: float) -> list[str]:
        return unsettled(resolve(scene(kip=kip).replace({"finger.*.hand": {"stiffness": 0.0}})))

    assert not lone(0.999 * limit)
    assert lone(1.5 * limit)


@pytest.mark.parametrize(
    "changes",
    [
        {"coupling.internal.stiffness": [1e4, 1e4]},
        {"object.integrator": "implicit", "coupling.external.stiffness": 1e4, "coupling.internal.stiffness": 10.0},
        {"object.free": [False], "coupling.external.stiffness": 1e4, "coupling.internal.stiffness": 10.0},
    ],
)
def test_what_it_knows_nothing_of_is_passed_over(changes: dict[str, Any]) -> None:
    assert not unsettled(resolve(scene().replace(changes)))


@pytest.mark.parametrize("name", ["paper-waving", "paper-spring-arms", "pick-and-place", "mug", "prism"])
def test_the_shelf_settles(name: str) -> None:
    assert not unsettled(resolve(gx.load(name)))
