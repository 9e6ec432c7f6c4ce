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
}


@pytest.mark.parametrize("name", SHELF)
def test_keeps_its_promises(name: str) -> None:
    assert gx.load(name).title
    gx.testing.check_scene(name, number=NUMBERS.get(name, ()))


def test_every_scene_has_its_number() -> None:
    assert NUMBERS.keys() == set(SHELF)
