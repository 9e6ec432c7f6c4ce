"""PyBullet's bodies alone: the banner, limits on turns and on locked rotations."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.objects import integrators as at
from graspfx.objects.body import fill_body
from graspfx.objects.bullet.bullet import BulletBody
from graspfx.objects.bullet.bullet_world import BulletWorld
from graspfx.objects.surroundings import Meeting, Member
from graspfx.surfaces.closed_form.shape import Box

pytest.importorskip("pybullet", reason="pybullet has no wheel for this Python or platform")

ROOT = Path(__file__).parents[3]
T = 0.005


def body(**given: Any) -> BulletBody:
    state: NDArray[np.float64] = np.zeros(at.SIZE)
    fill_body(state, **given)
    return BulletBody(state)


def test_a_turn_that_pybullet_would_cut_short_is_refused() -> None:
    """45 degrees a step are 157.1 rad/s at 5 ms."""
    body(dimensions=2, mass=1.0, inertia=1.0, angular_velocity=157.0).step(T)
    with pytest.raises(InputError, match=r"at most 157\.1 rad/s"):
        body(dimensions=2, mass=1.0, inertia=1.0, angular_velocity=158.0).step(T)


def test_two_free_rotations_of_unequal_moments_are_refused() -> None:
    with pytest.raises(InputError, match="equal moments of inertia"):
        body(dimensions=3, mass=0.1, inertia=(3e-5, 5e-5, 6e-5), free=(1, 1, 1, 1, 1, 0))


def test_what_a_world_cannot_hold_is_refused() -> None:
    cube = Box((0.05, 0.05, 0.05))
    flat, partial = np.zeros(at.SIZE), np.zeros(at.SIZE)
    fill_body(flat, dimensions=2, mass=0.1, inertia=1e-5)
    fill_body(partial, dimensions=3, mass=0.1, inertia=1e-5, free=(True, True, True, False, False, True))
    with pytest.raises(InputError, match="in space"):
        BulletWorld([Member(flat, None)], [], Meeting())
    with pytest.raises(InputError, match="all or none"):
        BulletWorld([Member(partial, cube)], [], Meeting())


def test_nothing_is_printed() -> None:
    """In a fresh process: neither stdout nor stderr has PyBullet's banner, and both still work."""
    code = """
import sys, numpy as np
from graspfx.objects import integrators as at
from graspfx.objects.body import fill_body
from graspfx.objects.bullet.bullet import BulletBody
from graspfx.objects.bullet.bullet_world import BulletWorld
from graspfx.objects.surroundings import Meeting, Member
from graspfx.surfaces.closed_form.shape import Box
assert "pybullet" not in sys.modules
state = np.zeros(at.SIZE)
fill_body(state, dimensions=1, mass=0.1)
print("before")
BulletBody(state).step(0.005)
print("after")
print("still here", file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["before", "after"]
    assert done.stderr.strip() == "still here"
