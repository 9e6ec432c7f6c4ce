"""A shape of a kind that nothing knows is an error wherever kinds are told apart, and no other shape in silence."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from graspfx.compile.kernel import written
from graspfx.coupling.contacts import LOST
from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.rules import Rules
from graspfx.errors import InputError
from graspfx.objects.floor.floor import features
from graspfx.objects.mujoco.geometry import geometries
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form.proxy import KINDS, MESH, closest
from graspfx.surfaces.closed_form.shape import Sphere
from tests.support.grasps import grasped, law


class Torus:
    kind = 99
    parameters = (0.03, 0.01, 0.0)
    data = None


UNKNOWN: Any = Torus()


@pytest.mark.parametrize("d", [1, 2, 3])
def test_its_contact_is_not_a_number(d: int) -> None:
    for kernel in (closest, written(closest)):
        found: Any = kernel(99, d, Vector(0.03, 0.01, 0.0), Vector(0.02, 0.0, 0.0), -1, Vector(0.03, 0.0, 0.0))
        assert math.isnan(found.gap) and math.isnan(found.point.x) and math.isnan(found.normal.y)


def test_kinds_of_shapes_have_contacts() -> None:
    for kind in set(KINDS) - {MESH}:
        found: Any = closest(kind, 3, Vector(0.03, 0.02, 0.01), Vector(0.02, 0.001, 0.1), -1, Vector(0.03, 0.0, 0.0))
        assert math.isfinite(found.gap), kind


def test_no_coupling_to_it_is_made() -> None:
    with pytest.raises(InputError, match=r"shape: .*expected a shape whose kind `closest` supports"):
        grasped(2, 2, law(40.0, 160.0), Rules(), shape=UNKNOWN)


def test_one_that_gets_into_a_block_is_a_fault() -> None:
    g = grasped(2, 2, law(40.0, 160.0, 0.1, 0.1), Rules(), shape=Sphere(0.03))
    g.state.shape = 99
    g.finger_position[:] = [[-0.02, 0.0], [0.02, 0.0]]
    assert g.sample() == LOST
    assert not g.force.any() and not np.any(g.array(FingerState.touching))


@pytest.mark.parametrize("d", [2, 3])
def test_it_has_no_features_to_stand_on(d: int) -> None:
    with pytest.raises(InputError, match=r"shape: .*expected a shape whose contact with planes is implemented"):
        features(UNKNOWN, d)


def test_other_software_gets_no_geometry_of_it() -> None:
    with pytest.raises(InputError, match=r"shape: .*expected a shape that MuJoCo supports; add it to `geometries`"):
        list(geometries(UNKNOWN, 3, fixed=False))
