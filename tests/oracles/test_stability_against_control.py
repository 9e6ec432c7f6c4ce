"""Limits against python-control: plants that it samples, loops that it closes, poles and margins that it finds."""

from __future__ import annotations

import warnings

import control
import numpy as np
import pytest

import graspfx as gx
from tests.support.sampled_loops import stepped_object

T, SPRING = 0.005, 33.0
WITHIN = 1e-6


def device(m: float, b: float, spring: float) -> control.StateSpace:
    """Position per force, under python-control's zero-order hold."""
    plant = control.ss([[0.0, 1.0], [-spring / m, -b / m]], [[0.0], [1.0 / m]], [[1.0, 0.0]], 0.0)
    return control.sample_system(plant, T, "zoh")


def thing(M: float, B: float, integrator: str) -> control.StateSpace:
    A, b = stepped_object(M, B, T, integrator)
    return control.ss(A, b[:, None], [[1.0, 0.0]], 0.0, T)


def late(loop: control.StateSpace, samples: int) -> control.StateSpace:
    for _ in range(samples):
        loop = loop * control.ss(0.0, 1.0, 1.0, 0.0, T)
    return loop


def is_limit(loop: control.StateSpace, limit: float) -> bool:
    """Whether 1 + k L(z) = 0 has all roots inside the circle just below the limit and not just above it."""
    inside, outside = (
        np.abs(control.feedback(factor * limit * loop, 1).poles()).max() for factor in (1.0 - WITHIN, 1.0 + WITHIN)
    )
    return bool(inside < 1.0 < outside)


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize(("m", "b"), [(0.05, 0.2), (0.15, 0.2), (0.2, 1.5)])
def test_wall(m: float, b: float, delay: int) -> None:
    """Poles to 1e-6 of the gain; the gain margin to 1e-5, which python-control interpolates."""
    loop = late(device(m, b, SPRING), delay)
    limit = gx.stability.wall_limit(m, b, T, spring=SPRING, delay=delay)
    assert is_limit(loop, limit)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that it does so is what it warns of
        margin, _, _, crossing, _, _ = control.stability_margins(loop)
    assert limit == pytest.approx(float(margin), rel=1e-5)
    frequency = gx.stability.wall_limits(m, b, T, spring=SPRING, delay=delay).frequency
    assert frequency == pytest.approx(float(crossing) / (2 * np.pi), rel=1e-5)


@pytest.mark.parametrize("integrator", ["explicit", "semi-implicit", "exact", "bullet"])
@pytest.mark.parametrize(("m", "b_v", "delay"), [(0.05, 0.8, 0), (0.15, 1.5, 0), (0.1, 1.0, 1)])
def test_external(integrator: str, m: float, b_v: float, delay: int) -> None:
    """Both fingers' devices and the object at once, as the external mode: poles to 1e-6 of the gain."""
    limit = gx.stability.external_limit(m, 0.2, T, 0.1, b_v, spring=SPRING, integrator=integrator, delay=delay)
    assert is_limit(late(device(m, 0.2, SPRING), delay) + thing(0.05, b_v / 2, integrator), limit)
