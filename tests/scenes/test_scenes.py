"""Every scene on the shelf keeps the promises of `gx.testing.check_scene`, and a number of it is what physics says."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import graspfx as gx
from graspfx import plugins
from graspfx.recording.record import Recording
from graspfx.scene.model import Scene
from tests.support.optional import require

FloatArray = NDArray[np.float64]

SHELF = sorted(name for name, origin in plugins.names("scenes").items() if origin.startswith("GraspFX"))


def first_forces(recording: Recording) -> FloatArray:
    return recording.finger_force[0, :, 0]


def depths(begin: float, end: float = np.inf, *, mean: bool = True) -> Callable[[Recording], FloatArray]:
    """How deep each finger stands in the object from `begin` to `end` [s], in the mean or at every tick."""

    def number(recording: Recording) -> FloatArray:
        each = -require(recording.gap)[(recording.time >= begin) & (recording.time < end)]
        return np.asarray(each.mean(axis=0) if mean else each)

    return number


def squeeze_in_the_end(recording: Recording) -> FloatArray:
    return np.asarray(-require(recording.gap)[-200:].mean(axis=0))


def depths_in_the_end(recording: Recording) -> FloatArray:
    return -require(recording.gap)[-1]


def forces_in_the_end(recording: Recording) -> FloatArray:
    return np.linalg.norm(recording.finger_force[-1], axis=1)


def total_force_in_the_end(recording: Recording) -> FloatArray:
    return recording.finger_force[-50:].sum(axis=1).mean(axis=0)


def turned_in_the_end(recording: Recording) -> FloatArray:
    """The rotation vector from the first pose to the last [rad]."""
    first, last = (Rotation.from_quat(require(recording.object_orientation)[k]) for k in (0, -1))
    return (last * first.inv()).as_rotvec()


def contacts_apart(recording: Recording) -> FloatArray:
    """How far the second finger's contact is from the first one's along the plate's normal, at every tick [m]."""
    _, orientation = recording.described_pose("object")
    normal = Rotation.from_quat(require(orientation)).apply([0.0, 0.0, 1.0])
    return np.einsum("ki,ki->k", recording.contact_position[:, 1] - recording.contact_position[:, 0], normal)


def weight(mesh: str, density: float) -> float:
    """m g [N] of a mesh of the shelf in millimetres."""
    file = plugins.find("scenes", "mug").parent / "meshes" / f"{mesh}.ply"
    return float(trimesh.load_mesh(file).volume) * 1e-9 * density * 9.81


def turn_about_z(recording: Recording) -> FloatArray:
    orientation = recording.object_orientation
    assert orientation is not None
    return np.asarray(2.0 * np.arctan2(orientation[:, 2], orientation[:, 3]))


def where_it_stands(recording: Recording) -> FloatArray:
    return recording.object_position[-1, :2]


def how_far_it_turned(recording: Recording) -> float:
    return float(turn_about_z(recording)[-1])


def height_in_the_end(recording: Recording) -> float:
    return float(recording.object_position[-1, 2])


def speed_in_the_end(recording: Recording) -> FloatArray:
    return recording.object_velocity[-1]


def touching_in_the_end(recording: Recording) -> NDArray[np.bool_]:
    return recording.touching[-1]


def loads(recording: Recording) -> list[float]:
    """Give what the left hand and the right hand carry in the end [N]."""
    lift = recording.finger_force[-1, :, 2]
    names = recording.layout.fingers
    return [
        sum(float(f) for f, name in zip(lift, names, strict=True) if name.startswith(side))
        for side in ("left", "right")
    ]


def stacked(recording: Recording) -> FloatArray:
    base, block = (thing.position[-1] for thing in recording.objects.values())
    return np.asarray(block - base)


def base_height(recording: Recording) -> float:
    return float(recording.objects["base"].position[-1, 2])


def impulse_over_drag(recording: Recording) -> float:
    """The moment about the knob's axis over time, by its drag, less the angle: I w = 0 at both ends [rad]."""
    return float(recording.wrench[:, 5].sum() * recording.period / 0.02) - how_far_it_turned(recording)


def sideways(recording: Recording) -> FloatArray:
    return recording.wrench[-1, :2]


def turned_while_pushed(recording: Recording) -> float:
    return float(np.ptp(turn_about_z(recording)[recording.time >= 3.6]))


def first_slip(recording: Recording) -> FloatArray:
    """Give each finger's push when the first one begins to slip in torsion and shear."""
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
    """Give each finger's push and load in the end."""
    f = recording.finger_force[-1]
    return np.stack([np.hypot(f[:, 0], f[:, 1]), f[:, 2]], axis=1)


# A finger between a spring k to a point s inside the surface and the coupling: k (s - x) = kip x, x = s k/(k + kip).
WAVING = (depths(0.9, 1.0), 0.01 * 60.0 / (60.0 + 70.0), 1e-5)  # 0.2 %: the arms have viscous friction, and settle
SPRING = (squeeze_in_the_end, 0.01 * 33.0 / (33.0 + 80.0), 1e-5)  # the encoders' counts are 4 um
# The bar hangs 15 mm beside two springs in torsion, kep rho^2 each: 2 kep rho^2 a = m g x cos(a), a = 5.82 degrees.
# Each carries half of its moment and weight, and slips where sqrt(f_t^2 + (tau/rho)^2) = mu f_n.
RHO, WEIGHT = 0.006, 0.03 * 9.81
TILT = brentq(lambda a: 2 * 600.0 * RHO**2 * a - WEIGHT * 0.015 * np.cos(a), 0.0, 1.0)
TORSION = WEIGHT * 0.015 * np.cos(TILT) / 2
SLIPPING = np.hypot(WEIGHT / 2, TORSION / RHO) / 0.6
# density x s/2 R^2 sin(2 pi/s) h of a prism with s = 6 sides, a third of its weight for each finger
CARRIED = 600.0 * 3 * 0.03**2 * np.sin(np.pi / 3) * 0.05 * 9.81 / 3
# Hand, coupling and pads in series, the block free: s = f/k_h + f/kip + (d_1 + d_2)/2, d_i = (f/k_i)^(2/3).
PADS = np.array([2e4, 8e4])
PINCH = brentq(lambda f: f / 500.0 + f / 1000.0 + ((f / PADS) ** (2 / 3)).mean() - 0.006, 0.0, 10.0)
YIELD = (PINCH / PADS) ** (2 / 3)
NUMBERS: dict[str, Any] = {
    # e = (2, -1) mm: kep times the mean of 0.5 mm, and kip times 1.5 mm from it
    "reference-1dof": (first_forces, [30.0 * 0.0005 + 70.0 * 0.0015, 30.0 * 0.0005 - 70.0 * 0.0015], 1e-15),
    "paper-waving": WAVING,
    "paper-waving-turning": WAVING,
    "paper-spring": SPRING,
    "paper-spring-arms": SPRING,
    # Three springs k to points s inside the surface, kip each: f = s k kip/(k + kip). At rest no moment is left: the
    # sphere has turned by as much as the wrist. What is left is rounding and e^-t/tau, a second after the turn.
    "sphere-three-fingers": [
        (forces_in_the_end, [0.01 * 300.0 * 400.0 / 700.0] * 3, 1e-6),
        (turned_in_the_end, [0.0, 0.0, 1.0], 1e-6),
    ],
    # Depth s k/(k + kip) before the plate is lifted, 4.4 times its thickness, and nearly so all the while: waving takes
    # 0.06 N and the swing some more, 0.1 mm. The contacts of the balls of 10 mm stay 21 mm apart, each on its own face;
    # they are where the implicit step predicts the plate, which turns by 0.02 rad from there at most: 21 mm (1 - cos).
    "thin-plate": [
        (depths(0.35, 0.4), [0.008 * 500.0 / 900.0] * 2, 1e-5),
        (depths(0.35, mean=False), 0.008 * 500.0 / 900.0, 2e-4),
        (contacts_apart, 0.021, 5e-6),
    ],
    # At rest the fingers carry the weight and nothing else.
    "mug": (total_force_in_the_end, [0.0, 0.0, weight("mug", 2400.0)], 1e-3),
    "twenty-fingers": (total_force_in_the_end, [0.0, 0.0, weight("potato", 1000.0)], 1e-3),
    "pick-and-place": (
        # a swing of 0.1 degree is left when an edge meets the floor, and flat it stands 30 mm * 0.0017 beside: 0.05 mm
        (where_it_stands, [0.08, 0.0], 1e-4),
        (how_far_it_turned, np.pi / 2.0, 1e-5),  # the hand is there 0.8 s before it lands: forty times its b/k
        (height_in_the_end, 0.03 - 0.15 * 9.81 / (4.0 * 1e5), 1e-10),  # on four corners of 1e5 N/m: m g/(4 k)
        (speed_in_the_end, [0.0] * 3, 1e-12),
        (touching_in_the_end, [False] * 2, 0.0),
    ),
    # the law of the lever: left at 150 mm and right at 100 mm; askew by 7.9 mrad, arms are off by that squared, 6e-5
    "carry-bar": (loads, [0.4 * 0.5 * 9.81, 0.6 * 0.5 * 9.81], 2e-4),
    "two-objects": (
        (stacked, [0.0, 0.0, 0.03], 1e-6),  # half the heights, 15 mm each
        (loads, [0.2 * 9.81, 0.0], 1e-4),  # the left hand carries 0.15 and 0.05 kg
        # it means to be at 45 mm: four springs of 300 N/m and four of 400 N/m in a row give under that
        (base_height, 0.045 - 0.2 * 9.81 * (1.0 / 1200.0 + 1.0 / 1600.0), 1e-6),
    ),
    "knob": (
        (how_far_it_turned, 2.0, 1e-4),  # 1 rad twice, without a slip
        (impulse_over_drag, 0.0, 1e-8),  # I w' = M - b_w w between rest and rest
        (sideways, [4 * 0.003 * 300.0 * 500.0 / 800.0, 0.0], 1e-4),  # internal: kip and the hand in a row, no kep
        (turned_while_pushed, 0.0, 1e-4),  # what comes too late of the turn that ended at 3.3 s
    ),
    "soft-pinch": (
        (
            torsion_at_rest,
            [-TORSION] * 2,
            5e-3 * TORSION,
        ),  # 0.2 % are left of the swing with which it took up its weight
        (first_slip, [SLIPPING] * 2, 0.01 * SLIPPING),  # the pinch falls by 0.3 % in a sample
    ),
    "soft-pads": (
        (forces_in_the_end, [PINCH] * 2, 1e-7),  # 1.573 N
        (depths_in_the_end, PINCH / 1000.0 + YIELD, 1e-8),  # 3.408 mm and 2.301 mm
        (where_it_stands, [-(YIELD[0] - YIELD[1]) / 2, 0.0], 1e-7),  # 0.554 mm towards the softer one
    ),
    "unequal-devices": (change_of_squeeze, [0.0] * 3, 1e-15),  # rounding of 50 mm is 7e-18
    "prism": (pinch_and_weight, [[1.0, CARRIED]] * 3, 1e-9),  # 1 s after the lift
}


def loaded(name: str) -> Scene:
    """The scene; where a package that it names is missing, the test is skipped with what the fault says."""
    try:
        return gx.load(name)
    except gx.errors.SceneError as error:
        missing = [fault.message for fault in error.faults if "which is not installed" in fault.message]
        if len(missing) < len(error.faults):
            raise
        pytest.skip(missing[0])


@pytest.mark.parametrize("name", SHELF)
def test_keeps_its_promises(name: str) -> None:
    scene = loaded(name)
    assert scene.title
    gx.testing.check_scene(scene, number=NUMBERS.get(name, ()))


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
