"""Certificates of scenes: modes against the whole loop, and runs of scenes 3 % inside and outside of their limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_linearise import attached

import graspfx as gx
from graspfx.scene.limits.certificate import Certificate, certificates, lines


def limit_of(certificate: Certificate, mode: str) -> float:
    return next(row.limit for row in certificate.limits if row.mode == mode)


def rate(rec: gx.Recording, windows: int = 12) -> float:
    """Growth [1/s] of the fast part of the object's motion: differences of velocity, the first half left out."""
    velocity = rec.object_velocity
    turning = rec.objects["object"].angular_velocity
    if turning is not None:
        velocity = np.hstack([velocity, 0.03 * turning.reshape(len(rec), -1)])
    fast = np.diff(velocity, 2, axis=0)
    parts = fast[len(fast) % windows :].reshape(windows, -1)
    size = np.log(np.sqrt((parts**2).mean(axis=1)))[windows // 2 :]
    return float(np.polyfit(np.arange(len(size)) * (rec.time[-1] / windows), size, 1)[0])


def test_reference() -> None:
    """kip: b = 0.2 N s/m at 5 ms gives 80.1 N/m, its passive limit 2 b/T = 80; kep as THEORY's 91.8 (exact)."""
    (found,) = certificates(gx.load("reference-1dof"))
    assert [row.mode for row in found.limits] == ["internal", "external"]
    assert [row.limit for row in found.limits] == pytest.approx([80.1, 91.8], abs=0.05)
    assert found.limits[0].margin == pytest.approx(80.13 / 70.0, rel=1e-3)
    assert all(row.exact and row.difference < 1e-9 for row in found.limits)
    assert found.passive is not None
    assert found.passive.internal == pytest.approx(80.0)
    assert found.passive.external == pytest.approx(2 / 0.005 * 0.2 * 0.4 / 0.6)  # b and b_v/2 in series
    assert next(lines(found)).startswith("stability of object, squeezed: stable")


def test_pushing_can_be_unstable_where_the_grasp_is_not() -> None:
    """m = 0.05 kg, explicit: both gains at 0.999 of their limits, one finger sees 52.3 where 51.9 is its limit."""
    changes = {
        "coupling.contact": "unilateral",
        "coupling.absent": "follow",
        "object.shape": {"kind": "box", "size": [0.05]},
        "object.integrator": "explicit",
        "finger.*.device.mass": 0.05,
        "finger.*.device.friction": 0.19906,
        "coupling.external.stiffness": 38.8 * 0.999,
        "coupling.internal.stiffness": 80.0 * 0.999,
        "finger.0.start": [-0.024],
        "finger.1.start": [0.024],
        "finger.0.hand.rest": [-0.02],
        "finger.1.hand.rest": [0.02],
    }
    (found,) = certificates(gx.load("reference-1dof", changes))
    assert found.spectral_radius < 1.0
    single = next(row for row in found.limits if row.mode.startswith("pushing"))
    assert single.gain == pytest.approx(52.3, abs=0.1)
    assert single.limit == pytest.approx(51.9, abs=0.1)
    assert single.margin < 1.0


@pytest.mark.parametrize(("d", "integrator", "squeeze"), [(1, "explicit", 0.003), (2, "explicit", 0.003), (3, "exact", 0.003)])
def test_runs_grow_and_decay_on_either_side_of_a_limit(d: int, integrator: str, squeeze: float) -> None:
    """kep 3 % below and above what the certificate says, in motion from a slight push; rates to 5 % and 0.02/s."""
    scene = attached(d, integrator, squeeze)
    (found,) = certificates(scene)
    edge = limit_of(found, "external")
    assert 0.0 < edge < math.inf
    push = {"object.velocity": [1e-4] * d} | ({} if d == 1 else {"object.angular_velocity": [2e-3] * 3 if d == 3 else 2e-3})
    for factor, sign in ((0.97, -1.0), (1.03, 1.0)):
        near = scene.replace({"coupling.external.stiffness": factor * edge} | push)
        rec = gx.run(near, duration=8.0)
        assert not rec.faults
        expected = math.log(gx.stability.spectral_radius(near)) / near.period
        assert expected * sign > 0.0
        assert rate(rec) * sign > 0.0
        assert rate(rec) == pytest.approx(expected, rel=0.05, abs=0.02)


def test_a_prism_in_space_has_every_mode() -> None:
    (found,) = certificates(gx.load("prism"))
    modes = [row.mode for row in found.limits]
    assert modes[:4] == ["internal", "external", "external translation", "external rotation"]
    assert len(modes) == 4 + 6  # one and two of three fingers
    assert all(row.margin > 1.0 for row in found.limits)
    assert found.spectral_radius < 1.0
    assert found.at == "squeezed"
    assert "contacts stick" in found.assumed


def test_larger_gains_than_the_limit_are_said_to_be() -> None:
    """Both gains beyond: every margin below 1, and limits as they are for gains within."""
    scene = attached(2, "explicit")
    edges = {row.mode: row.limit for row in certificates(scene)[0].limits}
    (found,) = certificates(scene.replace({"coupling.external.stiffness": 900.0, "coupling.internal.stiffness": 900.0}))
    assert found.spectral_radius > 1.0
    assert "NOT STABLE" in next(lines(found))
    for mode in ("internal", "external"):
        assert limit_of(found, mode) == pytest.approx(edges[mode], rel=1e-9)
        assert limit_of(found, mode) < 900.0
