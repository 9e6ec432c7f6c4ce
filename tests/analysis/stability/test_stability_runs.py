"""Limits against runs of the framework itself: motions grow above and decay below, at the rate of the largest root."""

from __future__ import annotations

import math

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.preload import preloaded
from graspfx.analysis.stability import Linearisation, external_limits, spectral_radius, wall_limits
from tests.support.optional import require

T, M, B, SPRING = 0.005, 0.15, 0.2, 33.0


def rate(motion: np.ndarray, duration: float, windows: int = 12) -> float:
    """Growth [1/s] of the fast part of a motion: its third differences, the first third of the run left out."""
    fast = np.diff(motion, 3)
    parts = fast[len(fast) % windows :].reshape(windows, -1)
    size = np.log(np.sqrt((parts**2).mean(axis=1)))[windows // 3 :]
    return float(np.polyfit(np.arange(len(size)) * duration / windows, size, 1)[0])


@pytest.mark.parametrize(
    ("integrator", "delay", "damping"), [("exact", 0, 0.0), ("semi-implicit", 1, 0.0), ("explicit", 0, 0.1)]
)
def test_external_mode(integrator: str, delay: int, damping: float) -> None:
    """3 % on either side of the limit of kep; the rate to 3 % of it, or 0.01/s where it is small."""
    limits = external_limits(
        M, B, T, 0.1, 0.8, spring=SPRING, integrator=integrator, delay=delay, coupling_damping=damping
    )
    for factor, sign in ((0.97, -1.0), (1.03, 1.0)):
        kep = factor * limits.limit
        changes = {
            "object.integrator": integrator,
            "coupling.external.stiffness": kep,
            "coupling.external.damping": damping,
            "coupling.internal.stiffness": 20.0,
            "finger.*.device.delay": delay,
        }
        rec = gx.run(gx.load("reference-1dof", changes), duration=18.0)
        assert not rec.faults
        found = rate(require(rec.true_position)[:, :, 0].mean(axis=1), 18.0)
        assert found * sign > 0.0
        assert found == pytest.approx(math.log(limits.spectral_radius(kep)) / T, rel=0.03, abs=0.01)


def test_internal_mode_with_delay() -> None:
    """One sample late a wall is lost at 26.8 instead of 80 N/m."""
    limits = wall_limits(M, B, T, spring=SPRING, delay=1)
    for factor, sign in ((0.97, -1.0), (1.03, 1.0)):
        kip = factor * limits.limit
        changes = {"coupling.internal.stiffness": kip, "finger.*.device.delay": 1, "coupling.external.stiffness": 5.0}
        rec = gx.run(gx.load("reference-1dof", changes), duration=18.0)
        found = rate(np.diff(require(rec.true_position)[:, :, 0], axis=1)[:, 0], 18.0)
        assert found * sign > 0.0
        assert found == pytest.approx(math.log(limits.spectral_radius(kip)) / T, rel=0.03, abs=0.01)


@pytest.mark.parametrize(("integrator", "reaction"), [("explicit", "fingertip"), ("exact", "contact")])
def test_a_squeezed_cube_turns_as_its_linearisation_says(integrator: str, reaction: str) -> None:
    """Two fingers 5 mm into a cube of 50 mm, turned a little: the rate of its rotation to 2 %.

    Without the preload the rate would be wrong by 16 % at least.
    """
    kep, kip, r, d = 60.0, 70.0, 0.025, 0.005
    f = kip * d
    fingers = [
        {
            "device": {"name": "simulated", "mass": M, "damping": B},
            "hand": {"stiffness": SPRING, "rest": [s * (r - d - f / SPRING), 0.0]},
            "start": [s * (r - d), 0.0],
        }
        for s in (-1.0, 1.0)
    ]
    scene = gx.Scene(
        dimensions=2,
        period=T,
        duration=8.0,
        object={
            "mass": 0.1,
            "viscosity": 0.8,
            "rotational_viscosity": 3.33e-4,
            "integrator": integrator,
            "shape": {"kind": "box", "size": [2 * r, 2 * r]},
            "angular_velocity": 1e-4,
        },
        coupling={
            "contact": "attached",
            "reaction": reaction,
            "external": {"stiffness": kep},
            "internal": {"stiffness": kip},
        },
        finger=fingers,
    )
    rec = gx.run(scene)
    assert not rec.faults
    rotation = squeezed_rotation(kep, kip, r, d, integrator, reaction)
    expected = math.log(spectral_radius(rotation)) / T
    unloaded = math.log(spectral_radius(rotation.with_changes(preload=None, G_displacement=None))) / T
    assert rate(np.asarray(rec.object_orientation), 8.0) == pytest.approx(expected, rel=0.02)
    assert abs(unloaded - expected) > 0.15 * abs(expected)


def squeezed_rotation(kep: float, kip: float, r: float, d: float, integrator: str, reaction: str) -> Linearisation:
    """The object's turn and the tips' opposite sideways motion, which by symmetry move by themselves."""
    c, e = np.array([[-r, 0.0], [r, 0.0]]), np.array([[d, 0.0], [-d, 0.0]])
    P = gx.Grasp(c).split().external
    K = kep * P + kip * (np.eye(4) - P)
    made = preloaded(c, e, (K @ e.ravel()).reshape(2, 2), reaction=reaction)
    s = np.array([[0.0], [-1.0], [0.0], [1.0]]) / math.sqrt(2.0)
    both = np.zeros((7, 2))
    both[:4, 0], both[6, 1] = s[:, 0], 1.0
    return Linearisation(
        period=T,
        mass=M,
        friction=B,
        G=made.G[2:] @ s,
        G_displacement=made.G_displacement[2:] @ s,
        inertia=0.1 * (2 * r) ** 2 / 6,
        viscosity=3.33e-4,
        stiffness=s.T @ K @ s,
        hand_stiffness=SPRING,
        integrator=integrator,
        preload=both.T @ made.preload @ both,
    )
