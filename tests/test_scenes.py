"""Every scene on the shelf keeps the promises of `gx.testing.check_scene`, and a number of it is what physics says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import graspfx as gx
from graspfx import plugins
from graspfx.loop.record import Recording
from graspfx.scene.model import Scene

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


def gaps_at(begin: float, end: float) -> Callable[[Recording], FloatArray]:
    """How deep each finger stands in the object, the mean from `begin` to `end` [s]."""

    def depths(recording: Recording) -> FloatArray:
        gap = recording.gap
        assert gap is not None
        return -gap[(recording.time >= begin) & (recording.time < end)].mean(axis=0)

    return depths


def forces_in_the_end(recording: Recording) -> FloatArray:
    return np.linalg.norm(recording.finger_force[-1], axis=1)


def total_force_in_the_end(recording: Recording) -> FloatArray:
    return recording.finger_force[-50:].sum(axis=1).mean(axis=0)


def turned_in_the_end(recording: Recording) -> FloatArray:
    """The rotation vector from the first pose to the last [rad]."""
    first, last = (Rotation.from_quat(recording.object_orientation[k]) for k in (0, -1))
    return (last * first.inv()).as_rotvec()


def depth_once_squeezed(recording: Recording) -> FloatArray:
    """Of each finger at every tick from 0.35 s on [m]."""
    gap = recording.gap
    assert gap is not None
    return -gap[recording.time >= 0.35]


def contacts_apart(recording: Recording) -> FloatArray:
    """How far the second finger's contact is from the first one's along the plate's normal, at every tick [m]."""
    _, orientation = recording.described_pose("object")
    normal = Rotation.from_quat(orientation).apply([0.0, 0.0, 1.0])
    return np.einsum("ki,ki->k", recording.contact_position[:, 1] - recording.contact_position[:, 0], normal)


def weight(mesh: str, density: float) -> float:
    """m g [N] of a mesh of the shelf in millimetres."""
    file = plugins.find("scenes", "mug").parent / "meshes" / f"{mesh}.ply"
    return float(trimesh.load(file).volume) * 1e-9 * density * 9.81


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
    """What the left hand and the right hand carry in the end [N]."""
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


# A finger between a spring k to a point s inside the surface and the coupling: k (s - x) = kip x, x = s k/(k + kip).
WAVING = (squeeze_before_waving, 0.01 * 60.0 / (60.0 + 70.0), 1e-5)  # 0.2 %: the arms have viscous friction, and settle
SPRING = (squeeze_in_the_end, 0.01 * 33.0 / (33.0 + 80.0), 1e-5)  # the encoders' counts are 4 um
NUMBERS = {
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
        (gaps_at(0.35, 0.4), [0.008 * 500.0 / 900.0] * 2, 1e-5),
        (depth_once_squeezed, 0.008 * 500.0 / 900.0, 2e-4),
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
