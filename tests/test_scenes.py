"""Every scene on the shelf keeps the promises of `gx.testing.check_scene`, and a number of it is what physics says."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

import graspfx as gx
from graspfx import plugins
from graspfx.loop.record import Recording

FloatArray = NDArray[np.float64]

SHELF = sorted(name for name, origin in plugins.names("scenes").items() if origin.startswith("GraspFX"))


def first_forces(recording: Recording) -> FloatArray:
    return recording.finger_force[0, :, 0]


def squeeze_before_waving(recording: Recording) -> FloatArray:
    """How deep each finger stands in the cube from 0.9 to 1 s: squeezed, not yet waved."""
    gap = recording.gap
    assert gap is not None
    return -gap[(recording.time >= 0.9) & (recording.time < 1.0)].mean(axis=0)


def squeeze_in_the_end(recording: Recording) -> FloatArray:
    gap = recording.gap
    assert gap is not None
    return -gap[-200:].mean(axis=0)


def first_slip(recording: Recording) -> FloatArray:
    """What each finger pushes with when the first one begins to slip in torsion and shear."""
    assert recording.status is not None
    return normal_forces(recording)[np.argmax((recording.status == 2).any(axis=1))]


def normal_forces(recording: Recording) -> FloatArray:
    return np.abs(recording.finger_force[:, :, 1])


def torsion_at_rest(recording: Recording) -> FloatArray:
    """About y, from 1.2 to 1.4 s: the bar has come to rest and does not slip yet."""
    moment = recording.finger_moment
    assert moment is not None
    return moment[(recording.time >= 1.2) & (recording.time < 1.4), :, 1].mean(axis=0)


def distances(recording: Recording) -> FloatArray:
    """Between the first finger and the second, the second and the third, the third and the first, (N, 3)."""
    p = recording.finger_position
    return np.linalg.norm(p - np.roll(p, -1, axis=1), axis=2)


def change_of_squeeze(recording: Recording) -> FloatArray:
    return np.abs(distances(recording) - distances(recording)[0]).max(axis=0)


def pinch_and_weight(recording: Recording) -> FloatArray:
    """What each finger pushes with and carries in the end."""
    f = recording.finger_force[-1]
    return np.stack([np.hypot(f[:, 0], f[:, 1]), f[:, 2]], axis=1)


# A finger between a spring k to a point s inside the surface and the coupling: k (s - x) = kip x, x = s k/(k + kip).
WAVING = (squeeze_before_waving, 0.01 * 60.0 / (60.0 + 70.0), 1e-5)  # 0.2 %: the arms have viscous friction, and settle
SPRING = (squeeze_in_the_end, 0.01 * 33.0 / (33.0 + 80.0), 1e-5)  # the encoders' counts are 4 um
# The bar hangs 15 mm beside two springs in torsion, kep rho^2 each: 2 kep rho^2 a = m g x cos(a), a = 5.82 degrees.
# Each carries half of its moment and weight, and slips where sqrt(f_t^2 + (tau/rho)^2) = mu f_n.
RHO, WEIGHT = 0.006, 0.03 * 9.81
TILT = brentq(lambda a: 2 * 600.0 * RHO**2 * a - WEIGHT * 0.015 * np.cos(a), 0.0, 1.0)
TORSION = WEIGHT * 0.015 * np.cos(TILT) / 2
SLIPPING = np.hypot(WEIGHT / 2, TORSION / RHO) / 0.6
# density x s/2 R^2 sin(2 pi/s) h of a prism with s = 6 sides, a third of its weight for each finger
CARRIED = 600.0 * 3 * 0.03**2 * np.sin(np.pi / 3) * 0.05 * 9.81 / 3
NUMBERS = {
    # e = (2, -1) mm: kep times the mean of 0.5 mm, and kip times 1.5 mm from it
    "reference-1dof": (first_forces, [30.0 * 0.0005 + 70.0 * 0.0015, 30.0 * 0.0005 - 70.0 * 0.0015], 1e-15),
    "paper-waving": WAVING,
    "paper-waving-turning": WAVING,
    "paper-spring": SPRING,
    "paper-spring-arms": SPRING,
    "soft-pinch": (
        (
            torsion_at_rest,
            [-TORSION] * 2,
            5e-3 * TORSION,
        ),  # 0.2 % are left of the swing with which it took up its weight
        (first_slip, [SLIPPING] * 2, 0.01 * SLIPPING),  # the pinch falls by 0.3 % in a sample
    ),
    "unequal-devices": (change_of_squeeze, [0.0] * 3, 1e-15),  # rounding of 50 mm is 7e-18
    "prism": (pinch_and_weight, [[1.0, CARRIED]] * 3, 1e-9),  # 1 s after the lift
}


@pytest.mark.parametrize("name", SHELF)
def test_keeps_its_promises(name: str) -> None:
    assert gx.load(name).title
    gx.testing.check_scene(name, number=NUMBERS.get(name, ()))


def test_every_scene_has_its_number() -> None:
    assert NUMBERS.keys() == set(SHELF)


def test_without_the_mass_metric_waving_gets_into_the_squeeze() -> None:
    """The fingers' distances along x, against the frequency response of three devices and a puck: 1 % for 2 ms samples.

    Devices, hands and gains are those of the scene; 1 Hz, over the last second.
    """
    scene = gx.load("unequal-devices", {"metric": "equal"})
    recording = gx.run(scene)
    assert change_of_squeeze(recording).max() > 1e-4  # with the mass metric 1e-17
    w, m = 2j * np.pi, np.array([0.05, 0.1, 0.3])
    gain = 400.0 * np.eye(3) + (200.0 - 400.0) / 3 + w * 0.5 * np.eye(3)
    hand = 2000.0 * m + w * 40.0 * m
    A = np.zeros((4, 4), dtype=complex)
    A[:3, :3] = np.diag(m * w**2 + 4.0 * m * w + hand) + gain
    A[:3, 3] = A[3, :3] = -gain.sum(axis=1)
    A[3, 3] = 0.1 * w**2 + 0.5 * w + gain.sum()
    expected = 0.03 * np.linalg.solve(A, [*hand, 0.0])[:3]
    x = recording.finger_position[-500:, :, 0]
    found = 2 * (x * np.exp(-w * recording.time[-500:, None])).mean(axis=0) * 1j * np.exp(w * 0.2)  # it begins at 0.2 s
    assert abs(expected[0] - expected[2]) == pytest.approx(0.138e-3, rel=5e-3)  # what the gallery says
    apart, found = expected - np.roll(expected, 1), found - np.roll(found, 1)
    np.testing.assert_allclose(found, apart, rtol=0.0, atol=0.01 * np.abs(apart).max())


@pytest.mark.parametrize(("sides", "fingers"), [(3, 3), (4, 2), (8, 4), (7, 3)])
def test_prisms_of_other_parameters_are_carried(sides: int, fingers: int) -> None:
    """All fingers together carry density x volume; where their number divides the sides', each the same."""
    recording = gx.run(gx.load("prism", {"sides": sides, "fingers": fingers, "height": 0.04}))
    assert recording.touching.all()
    weight = 600.0 * sides / 2 * 0.03**2 * np.sin(2 * np.pi / sides) * 0.04 * 9.81
    pinch, carried = pinch_and_weight(recording).T
    assert carried.sum() == pytest.approx(weight, rel=1e-8)
    if sides % fingers == 0:
        np.testing.assert_allclose(carried, weight / fingers, rtol=1e-8)
        np.testing.assert_allclose(pinch, 1.0, rtol=1e-8)


@pytest.mark.parametrize(("parameters", "said"), [({"sides": 2}, "sides: given 2"), ({"fingers": 7}, "from 2 to 6")])
def test_a_prism_that_cannot_be_is_said(parameters: dict[str, int], said: str) -> None:
    with pytest.raises(gx.errors.GraspFXError, match=said):
        gx.load("prism", parameters)
