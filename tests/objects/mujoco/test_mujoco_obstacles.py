"""Meshes and masses at MuJoCo's edges: parts, shells, thin walls, flat sheets, and bodies too light for it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("mujoco", reason="MuJoCo is not installed")

import graspfx as gx
from graspfx.errors import SceneError
from graspfx.objects.mujoco.geometry import is_hollow, parts

Rows = list[list[float]]
Faces = list[list[int]]

CUBE = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
        [1, 5, 7], [1, 7, 3]]  # fmt: skip
ROOF = [[0, -0.1, 0.1], [0, 0.1, 0.1], [0.1, -0.1, 0], [0.1, 0.1, 0], [-0.1, -0.1, 0], [-0.1, 0.1, 0]]
ROOF_FACES = [[0, 2, 3], [0, 3, 1], [0, 1, 5], [0, 5, 4]]
SQUARE = [[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]]
SQUARE_FACES = [[0, 1, 2], [0, 2, 3]]
SPECK = {"kind": "sphere", "radius": 1e-5}
FLOOR = {"kind": "half-space", "normal": [0.0, 0.0, 1.0]}


def cube(x: float, h: float = 0.05) -> Rows:
    return [[x + a, b, c] for a in (-h, h) for b in (-h, h) for c in (-h, h)]


def two_cubes() -> tuple[Rows, Faces]:
    """Cubes of 0.1 m, 0.2 m apart along x."""
    return cube(-0.15) + cube(0.15), CUBE + [[i + 8 for i in face] for face in CUBE]


def channel() -> tuple[Rows, Faces]:
    """A closed U along y, 0.2 m wide, of walls 2 mm thick: its floor's top is at z = 2 mm."""
    w, t, h = 0.1, 0.002, 0.1
    profile = [(-w, 0.0), (w, 0.0), (w, h), (w - t, h), (w - t, t), (-w + t, t), (-w + t, h), (-w, h)]
    vertices = [[x, y, z] for y in (-0.1, 0.1) for x, z in profile]
    ends = [(0, 1, 4), (0, 4, 5), (1, 2, 3), (1, 3, 4), (0, 5, 6), (0, 6, 7)]
    faces = [[a, b, c] for a, b, c in ends] + [[a + 8, c + 8, b + 8] for a, b, c in ends]
    for i in range(8):
        j = (i + 1) % 8
        faces += [[i, i + 8, j], [j, i + 8, j + 8]]
    return vertices, faces


def scene(obstacle: dict[str, Any] | None, *, g: float = 9.81, **thing: Any) -> gx.Scene:
    body = {"name": "body", "shape": {"kind": "sphere", "radius": 0.01}, "mass": 0.1, "viscosity": 0.0,
            "rotational_viscosity": 1e-5, "dynamics": "mujoco", **thing}  # fmt: skip
    idle = {"start": [5.0, 0.0, 0.0], "object": "body", "device": {"name": "simulated", "mass": 0.1, "damping": 0.5},
            "hand": {"stiffness": 100.0}}  # fmt: skip
    return gx.Scene(
        dimensions=3, period=0.001, duration=0.4, gravity=[0.0, 0.0, -g], object=[body], finger=[idle],
        coupling={"contact": "unilateral", "external": {"stiffness": 200.0}, "internal": {"stiffness": 200.0}},
        obstacle=[{"name": "obstacle", "shape": obstacle}] if obstacle else [],
    )  # fmt: skip


def mesh(vertices: Rows, faces: Faces, **keys: Any) -> dict[str, Any]:
    return {"kind": "mesh", "vertices": vertices, "faces": faces, **keys}


def end(given: gx.Scene) -> NDArray[np.float64]:
    place: NDArray[np.float64] = gx.run(given).objects["body"].position[-1]
    return place


def test_what_falls_between_two_parts_of_a_mesh_falls_freely() -> None:
    """No part fills the gap: z0 - g T^2 n (n + 1)/2 of the semi-implicit step; on a part it rests."""
    shape = mesh(*two_cubes())
    n = 400
    between = end(scene(shape, position=[0.0, 0.0, 0.2]))[2]
    assert between == pytest.approx(0.2 - 9.81e-6 * n * (n + 1) / 2, abs=0.01)
    assert end(scene(shape, position=[0.15, 0.0, 0.08]))[2] == pytest.approx(0.06, abs=1e-6)


def test_closed_convex_parts_are_a_hull_each_and_a_shell_never_is() -> None:
    vertices, faces = (np.array(each) for each in two_cubes())
    assert [len(part) for part in parts(vertices, faces)] == [8, 8]
    assert is_hollow(vertices, faces) and not is_hollow(vertices, faces[:12])
    assert [len(part) for part in parts(vertices, faces, shell=True)] == [4] * 24
    assert is_hollow(np.array(ROOF), np.array(ROOF_FACES))


def test_a_cavity_makes_the_whole_mesh_hollow() -> None:
    """A cube of 0.1 m around an inner surface of 0.06 m that faces inwards: no piece reaches into it."""
    vertices = np.array(cube(0.0) + cube(0.0, 0.03))
    faces = np.array(CUBE + [[c + 8, b + 8, a + 8] for a, b, c in CUBE])
    pieces = list(parts(vertices, faces))
    assert len(pieces) == 24
    assert all(np.abs(points[3]).max() >= 0.03 for points in pieces)


def test_a_dish_too_shallow_to_be_seen_at_its_edges_is_hollow() -> None:
    """A box whose top is 1 mm deep over 1 m, in 2 x 200 strips: each lies 3e-7 m before its neighbour."""
    x = np.linspace(-0.5, 0.5, 601)
    rows = np.array(
        [
            [[a, -0.1, -0.2], [a, 0.1, -0.2], [a, 0.1, b], [a, -0.1, b]]
            for a, b in zip(x, 0.001 * (4 * x * x - 1), strict=True)
        ]
    )
    n = len(x)
    faces = [[0, 3, 2], [0, 2, 1], [4 * n - 4, 4 * n - 3, 4 * n - 2], [4 * n - 4, 4 * n - 2, 4 * n - 1]]
    for k in range(n - 1):
        for j in range(4):
            a, b = 4 * k + j, 4 * k + (j + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    assert is_hollow(rows.reshape(-1, 3), np.array(faces))
    flat = rows.copy()
    flat[:, 2:, 2] = 0.0
    assert not is_hollow(flat.reshape(-1, 3), np.array(faces))


def test_a_body_under_a_roof_that_touches_nothing_stays_and_one_upon_it_is_met() -> None:
    shape = mesh(ROOF, ROOF_FACES, shell=True)
    np.testing.assert_array_equal(end(scene(shape, g=0.0, position=[0.0, 0.0, 0.03])), [0.0, 0.0, 0.03])
    rising = end(scene(shape, g=0.0, position=[0.0, 0.0, -0.05], velocity=[0.0, 0.0, 0.25]))
    assert rising[2] == pytest.approx(-0.05 + 0.25 * 0.399, abs=1e-9)  # through the open bottom
    falls = scene(shape, g=0.0, position=[0.05, 0.0, 0.2], velocity=[0.0, 0.0, -0.5])
    path = gx.run(falls).objects["body"].position
    heights = (path[:, 0] + path[:, 2] - 0.1) / math.sqrt(2.0)  # above the slope
    assert heights.min() == pytest.approx(0.01, abs=2e-4)
    assert heights[-1] < 0.011 and path[-1, 0] > 0.07  # it slides down


def test_thin_walls_have_no_piece_that_looks_out_on_the_other_side() -> None:
    """A ball rests on the channel's floor at 12 mm, wherever it lies."""
    shape = mesh(*channel())
    for x in (0.0, 0.05, -0.07):
        np.testing.assert_allclose(end(scene(shape, position=[x, 0.03, 0.05])), [x, 0.03, 0.012], rtol=0.0, atol=1e-6)


def test_a_flat_shell_bears_what_falls_on_it_and_rests_on_a_floor() -> None:
    """The sheet as an object is a plate of 2e-4 of its width, which stands half of that too high."""
    sheet = mesh(SQUARE, SQUARE_FACES, shell=True)
    assert end(scene(sheet, position=[0.01, 0.0, 0.05]))[2] == pytest.approx(0.01, abs=1e-6)
    plate = scene(FLOOR, position=[0.0, 0.0, 0.05], shape=sheet, inertia=[1e-4, 1e-4, 2e-4])
    assert end(plate)[2] == pytest.approx(2e-5, abs=1e-6)


@pytest.mark.parametrize(
    ("key", "light"),
    [
        ("object.0.mass: the smallest moment", {"mass": 1e-9, "shape": {"kind": "sphere", "radius": 1e-4}}),
        ("object.0.density: the smallest moment", {"mass": None, "density": 1e3, "shape": SPECK}),
        ("object.0.mass: the mass is 1e-16 kg", {"mass": 1e-16, "inertia": [1e-9] * 3}),
        ("object.0.inertia: the smallest moment", {"inertia": [1e-16] * 3}),
    ],
)  # fmt: skip
def test_a_body_too_light_for_mujoco_is_a_fault_that_names_the_key_and_a_way_out(key: str, light: Any) -> None:
    with pytest.raises(SceneError, match=key) as error:
        scene(None, **light)
    assert "MuJoCo needs more than 1e-15 kg" in str(error.value) and "'native'" in str(error.value)
    scene(None, **light, dynamics="native")


def test_a_light_body_that_does_not_turn_needs_no_moment() -> None:
    light = scene(None, mass=1e-9, shape={"kind": "sphere", "radius": 1e-4}, free=[True] * 3 + [False] * 3)
    assert np.isfinite(end(light)).all()


def test_a_mesh_file_that_is_not_there_is_named() -> None:
    nowhere: dict[str, Any] = {"shape": {"kind": "mesh", "mesh": "cup.stl"}}
    for given in (nowhere, {}):
        with pytest.raises(SceneError, match=r"shape\.mesh: .*cup\.stl"):
            scene({"kind": "mesh", "mesh": "cup.stl"}, **given)
