"""Certificates of scenes: modes against the whole loop, and runs of scenes 3 % inside and outside of their limits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.certificate.certificate import Certificate, lines
from graspfx.certificate.certify import certificates
from tests.support.small_scenes import attached


def limit_of(certificate: Certificate, mode: str) -> float:
    return next(row.limit for row in certificate.limits if row.mode == mode)


def fast_motion(rec: gx.Recording) -> np.ndarray:
    """Give second differences of the object's velocity, in which nothing but oscillation is left, (N - 2, w)."""
    velocity, turning = rec.object_velocity, rec.objects["object"].angular_velocity
    if turning is not None:
        velocity = np.hstack([velocity, 0.03 * turning.reshape(len(rec), -1)])
    return np.diff(velocity, 2, axis=0)


def unexplained(motion: np.ndarray, poles: np.ndarray) -> float:
    """The share of a motion, as a root mean square, that is no sum of powers of the poles."""
    k = np.arange(len(motion))[:, None]
    with np.errstate(under="ignore"):
        powers = poles[np.abs(poles) > 0.9] ** k
    basis = np.hstack([powers.real, powers.imag])
    left = motion - basis @ np.linalg.lstsq(basis, motion, rcond=1e-9)[0]
    return float(np.sqrt((left**2).mean() / (motion**2).mean()))


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
        "finger.*.device.damping": 0.19906,
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


@pytest.mark.parametrize(("d", "integrator"), [(1, "explicit"), (2, "explicit"), (3, "exact")])
def test_runs_grow_and_decay_on_either_side_of_a_limit(d: int, integrator: str) -> None:
    """kep 3 % below and above what the certificate says, squeezed by 3 mm: the last seconds shrink and grow.

    They are sums of powers of the linearised loop's poles to 2 %, and of no others: the motion is small by then.
    """
    scene = attached(d, integrator, 0.003)
    (found,) = certificates(scene)
    edge = limit_of(found, "external")
    assert 0.0 < edge < math.inf
    turning: dict[str, Any] = {} if d == 1 else {"object.angular_velocity": 0.02 if d == 2 else [0.02] * 3}
    for factor, sign in ((0.97, -1.0), (1.03, 1.0)):
        near = scene.replace({"coupling.external.stiffness": factor * edge})
        rec = gx.run(near.replace({"object.velocity": [1e-3] * d} | turning), duration=9.0 if d == 3 else 14.0)
        assert not rec.faults
        late = fast_motion(rec)[-900:]
        first, last = (np.sqrt((part**2).mean()) for part in (late[:300], late[-300:]))
        assert (last - first) * sign > 0.0
        poles = np.linalg.eigvals(gx.stability.loop_matrix(near.linearise()))
        assert (np.abs(poles).max() - 1.0) * sign > 0.0
        assert unexplained(late, poles) < 0.02


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


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_a_prism_held_by_friction_rings_as_its_loop_says(factor: float) -> None:
    """Sticking contacts on a mesh in space, lifted and set turning: the force's rate per sample is the spectral radius.

    The weakest mode is a rotation, which the lift alone would not start: one finger has 0.01 % more friction.
    """
    scene = gx.load("prism")
    (found,) = certificates(scene)
    friction = scene.to_dict()["finger"][0]["device"]["damping"]
    near = scene.replace(
        {
            "coupling.external.stiffness": factor * limit_of(found, "external"),
            "finger.0.device.damping": 1.0001 * friction,
            "object.angular_velocity": [0.2, 0.1, 0.05],
        }
    )
    recording = gx.run(near, duration=3.0)
    force = recording.finger_force.reshape(len(recording), -1)
    swing = np.abs(np.diff(force, 2, axis=0)).max(axis=1)
    early, late = (swing[round(t / near.period) :][: round(0.3 / near.period)].max() for t in (1.8, 2.6))
    seen = (late / early) ** (near.period / 0.8)
    assert (seen - 1.0) * (factor - 1.0) > 0.0
    assert seen == pytest.approx(gx.stability.spectral_radius(near), abs=2e-4)
