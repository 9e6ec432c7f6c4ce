"""Action equals reaction: at faces, edges and corners a finger's force acts on the object, and once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.surfaces.closed_form.shape import Box
from graspfx.surfaces.triangles.mesh import make_mesh
from tests.support.grasps import grasped, law
from tests.support.meshes import plate

EDGE, RADIUS, GAIN = 0.05, 0.004, 400.0


def touched(shape: Any, rules: Rules, position: np.ndarray, gains: gx.Coupling) -> GraspedObject:
    g = grasped(len(position), 3, gains, rules, shape=shape, radius=RADIUS)
    out = position + 0.02 * np.sign(position) * (np.abs(position) >= 0.5 * EDGE)
    g.meet(out)
    for share in np.linspace(0.0, 1.0, 21):  # from outside to where the ball touches
        g.finger_position[:] = out + share * (position - out)
        assert g.sample() == 0
    return g


@pytest.mark.parametrize("make", [Box, lambda size: make_mesh(*plate(*size))], ids=["box", "mesh"])
def test_a_ball_at_faces_edges_and_corners_is_pushed_once(make: Any) -> None:
    """k (r - distance) away from the nearest point of the box, for 200 balls that touch 1, 2 or 3 faces at once."""
    rng = np.random.default_rng(5)
    inside = rng.uniform(-0.45, 0.45, (200, 3)) * EDGE
    beyond = rng.permuted(np.tile([True, False, False], (200, 1)), axis=1) | (rng.random((200, 3)) < 0.5)
    rise = rng.uniform(0.1, 0.55, (200, 3)) * RADIUS * beyond  # the three together stay below the radius
    centre = np.where(beyond, np.sign(inside) * 0.5 * EDGE, inside) + np.sign(inside) * rise
    g = touched(make((EDGE,) * 3), Rules(fade=None), centre, law(GAIN, GAIN))
    distance = np.linalg.norm(rise, axis=1)
    expected = -(GAIN * (RADIUS - distance) / distance)[:, None] * np.sign(inside) * rise
    assert {int(k) for k in beyond.sum(axis=1)} == {1, 2, 3}
    np.testing.assert_allclose(g.force, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("reaction", [False, True], ids=["fingertip", "contact"])
def test_the_wrench_is_the_sum_of_what_the_devices_get(reaction: bool) -> None:
    """To the last bits, for five balls at a face, an edge and a corner, with eq. (4) between them."""
    half = 0.5 * EDGE
    centre = np.array(
        [
            [half + 0.002, 0.0, 0.003], [-half - 0.002, 0.001, 0.0], [half + 0.001, half + 0.002, 0.01],
            [-half - 0.001, -half - 0.001, -half - 0.002], [0.002, 0.0, half + 0.003],
        ]
    )  # fmt: skip
    g = touched(Box((EDGE,) * 3), Rules(fade=None, at_contact=reaction), centre, law(200.0, 500.0))
    where = g.contact_position if reaction else g.finger_position
    assert (np.linalg.norm(g.force, axis=1) > 0.0).all()
    assert np.abs(g.wrench[:3] - g.force.sum(axis=0)).max() <= 4.0 * np.finfo(float).eps * np.abs(g.force).sum()
    moment = np.cross(where, g.force).sum(axis=0)
    assert np.abs(g.wrench[3:] - moment).max() <= 8.0 * np.finfo(float).eps * np.abs(g.force).sum() * EDGE
