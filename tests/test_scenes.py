"""Every scene on the shelf keeps the promises of `gx.testing.check_scene`, and a number of it is what physics says."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

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
}


@pytest.mark.parametrize("name", SHELF)
def test_keeps_its_promises(name: str) -> None:
    assert gx.load(name).title
    gx.testing.check_scene(name, number=NUMBERS.get(name, ()))


def test_every_scene_has_its_number() -> None:
    assert NUMBERS.keys() == set(SHELF)
