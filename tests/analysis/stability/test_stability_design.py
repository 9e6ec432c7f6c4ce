"""Gains and devices chosen: they meet their margin and no more."""

from __future__ import annotations

import math

import pytest

import graspfx as gx
from graspfx.analysis.stability.one_gain import integrators_compared, largest_gains, least_friction, least_wall_friction

T, SPRING = 0.005, 33.0
SYSTEM = (0.05, 0.19906, T, 0.1, 0.8)


def test_largest_gains_of_a_grasp() -> None:
    """Their margin times larger they are the limits: 38.8 and 80 N/m at 0.05 kg, explicit."""
    found = largest_gains(*SYSTEM, spring=SPRING, integrator="explicit", margin=2.0, pushing=False)
    assert (2 * found.external, 2 * found.internal) == pytest.approx((38.8, 80.0), abs=0.05)
    assert found.conventional == found.external


def test_largest_gains_that_may_push() -> None:
    """One finger of two alone then sees exactly its own limit, 51.9 N/m."""
    found = largest_gains(*SYSTEM, spring=SPRING, integrator="explicit", margin=1.0)
    assert found.external < 38.8
    seen = 2 * found.external * found.internal / (found.external + found.internal)
    alone = gx.stability.external_limit(*SYSTEM, fingers=1, spring=SPRING, integrator="explicit")
    assert seen == pytest.approx(alone, rel=1e-12)


def test_least_friction_of_a_wall() -> None:
    """0.1997 N s/m give 0.15 kg a limit of 80 N/m; without a spring b is nearly K T/2 (Colgate and Schenkel)."""
    assert least_wall_friction(0.15, T, 80.0, spring=SPRING) == pytest.approx(0.1997, abs=5e-5)
    b = least_wall_friction(0.15, T, 40.0, margin=2.0)
    assert b == pytest.approx(80.0 * T / 2, rel=0.01)
    assert gx.stability.wall_limit(0.15, b, T) == pytest.approx(80.0, rel=1e-9)
    assert least_wall_friction(0.15, T, 10.0, wall_damping=0.1) == 0.0


def test_least_friction_for_an_object() -> None:
    b = least_friction(0.15, T, 0.1, 0.8, 60.0, spring=SPRING, integrator="explicit")
    assert gx.stability.external_limit(0.15, b, T, 0.1, 0.8, spring=SPRING, integrator="explicit") == pytest.approx(
        60.0
    )
    assert least_friction(0.15, T, 0.1, 0.0, 60.0, spring=SPRING, integrator="explicit") == math.inf


def test_integrators_compared() -> None:
    """The later the force is felt the less: explicit, exact, PyBullet, semi-implicit, implicit."""
    limits = {name: found.limit for name, found in integrators_compared(*SYSTEM, spring=SPRING).items()}
    order = ["explicit", "exact", "bullet", "semi-implicit", "implicit"]
    assert sorted(limits, key=limits.__getitem__) == order
