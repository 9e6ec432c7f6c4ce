"""Scenery: every shape as closed triangles of its size, in the frame that poses are of, seen from outside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import graspfx as gx
from graspfx.live.frame import Frames
from graspfx.live.page.story import with_normals
from graspfx.live.scenery import SLAB, Scenery, scenery, slab
from graspfx.show.picture.surfaces import Surface
from graspfx.show.style import EXTERNAL, INTERNAL
from tests.support.played import SECONDS, played

FloatArray = NDArray[np.float64]


def of(name: str) -> Scenery:
    run = played(name)
    return scenery(run.header, run.layout)


def volume(vertices: FloatArray, faces: NDArray[np.int64]) -> float:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize("name", SECONDS)
def test_a_recording_gives_the_scenery_of_its_scene(name: str) -> None:
    scene, one = gx.load(name), of(name)
    assert [each.object for each in one.solids if each.object is not None] == [each.name for each in scene.object]
    assert len(one.solids) == len(scene.object) + len(scene.obstacle)
    assert (one.apart > 0.0) == (scene.dimensions == 1) and one.fingers == scene.finger_names
    assert one.notes == ()
    assert not {INTERNAL, EXTERNAL} & {each.colour for each in one.solids}


def test_a_square_in_the_plane_is_a_slab() -> None:
    cube = of("paper-waving")
    (solid,) = cube.solids
    assert solid.object == "object"
    assert volume(solid.vertices, solid.faces) == pytest.approx(0.05**2 * SLAB * cube.extent, rel=1e-12)


@pytest.mark.parametrize("turn", [1, -1])
def test_a_slab_is_seen_from_outside_whichever_way_its_outline_goes(turn: int) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 7)[:-1][::turn]
    made = slab(Surface(np.column_stack([np.cos(angle), np.sin(angle)]), np.empty((0, 3), dtype=np.int64)), 0.5)
    assert volume(made.vertices, made.faces) == pytest.approx(0.5 * 1.5 * 3**0.5, rel=1e-12)


def test_a_ball_touches_where_its_contact_is() -> None:
    """A fingertip's centre is a radius from the mug's wall: the mesh stands where its pose says."""
    run = played("mug")
    drawn = scenery(run.header, run.layout)
    frames = Frames(run)
    position, wxyz = (each[-1] for each in frames.poses["object"])
    mug = next(each for each in drawn.solids if each.object)
    w, x, y, z = wxyz
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    assert np.ptp(mug.vertices, axis=0)[1:] == pytest.approx(
        [0.08, 0.09], abs=0.011
    )  # 80 mm across, in its file's frame
    assert drawn.is_ball.all()
    own = (frames.fingertips[-1] - position) @ turn
    away = np.linalg.norm(own[:, :2], axis=1) - 0.04 - drawn.radii
    assert (away < 0.0005).all()
    assert (away > -0.008).all()  # as deep as the fingers press


def test_what_cannot_be_drawn_is_said(tmp_path: Path) -> None:
    run = played("mug")
    drawn = scenery(run.header, run.layout, tmp_path)
    assert [each.name for each in drawn.solids] == ["table"]
    assert "object is not drawn" in drawn.notes[0]


def test_corners_at_creases_are_kept_apart_and_others_merged() -> None:
    (box,) = of("paper-waving").solids
    mesh = with_normals(box.vertices, box.faces)
    assert len(mesh.vertices) == 24  # eight corners, three faces each
    assert np.allclose(np.abs(mesh.normals).max(axis=1), 1.0)
    ball = of("sphere-three-fingers").solids[0]
    mesh = with_normals(ball.vertices, ball.faces)
    assert len(mesh.vertices) == len(ball.vertices)
    outward = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    assert (mesh.normals * outward).sum(axis=1).min() > 0.999
