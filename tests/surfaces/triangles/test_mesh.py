"""Meshes as they come: files, units, winding, triangles without area, holes; and what they weigh, by closed forms."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from graspfx.errors import InputError, MissingPackageError
from graspfx.surfaces.closed_form.shape import Box
from graspfx.surfaces.triangles.mesh import STATE, Mesh, load_mesh, make_mesh, new_fingers
from graspfx.surfaces.triangles.tree import half_edges
from tests.support.meshes import bumpy_sphere, ell, mug, plate, sheet

FloatArray = NDArray[np.float64]


def volume(mesh: Mesh) -> float:
    """Signed volume, by the divergence theorem."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def soup(vertices: FloatArray, faces: NDArray[np.intp]) -> tuple[FloatArray, NDArray[np.intp]]:
    """Every triangle with three vertices of its own, as an STL file has it."""
    return vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "off", "glb"])
def test_files(tmp_path: Path, kind: str) -> None:
    """An L in millimetres: 0.06 x 0.02 + 0.04 x 0.02 = 0.002 m^2 by 30 mm, 6e-5 m^3; 12 vertices, 20 triangles."""
    v, f = ell()
    file = tmp_path / f"ell.{kind}"
    trimesh.Trimesh(v * 1000, f, process=False).export(file)
    mesh = load_mesh(file, scale=0.001)
    assert (len(mesh.vertices), len(mesh.faces), mesh.notes) == (12, 20, ())
    assert volume(mesh) == pytest.approx(6e-5, rel=1e-6)


def test_a_scene_of_several_parts_is_one_mesh(tmp_path: Path) -> None:
    """Two cubes of 20 mm, moved by the file's own transforms: 1.6e-5 m^3."""
    cube = trimesh.creation.box(extents=[0.02] * 3)
    scene = trimesh.Scene()
    for x in (0.0, 0.1):
        scene.add_geometry(cube, transform=trimesh.transformations.translation_matrix([x, 0, 0]))
    scene.export(tmp_path / "two.glb")
    mesh = load_mesh(tmp_path / "two.glb")
    assert len(mesh.faces) == 24
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(0.12)
    assert volume(mesh) == pytest.approx(1.6e-5)


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "off", "glb", "foo", "xyz", "zip", "3mf"])
def test_files_of_rubbish(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # a long path is told in part
    file = Path(f"rubbish.{kind}")
    file.write_bytes(b"hello\n")
    with pytest.raises(InputError, match="rubbish"):
        load_mesh(file)


def test_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"none\.stl.*the path of a file"):
        load_mesh("none.stl")
    with pytest.raises(InputError):
        load_mesh(tmp_path)


def test_trimesh_missing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    trimesh.Trimesh(*plate()).export(tmp_path / "a.stl")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(MissingPackageError, match="trimesh"):
        load_mesh(tmp_path / "a.stl")


def test_nothing_heavy_is_imported_before_a_file_is_read() -> None:
    name = "graspfx.surfaces.triangles.mesh"
    code = f"import sys, {name}; print(" + "{'trimesh', 'scipy'} & {m.split('.')[0] for m in sys.modules})"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "set()"


def test_inverted_winding_is_fixed_and_said() -> None:
    v, f = bumpy_sphere(2)
    mesh = make_mesh(v, f[:, ::-1])
    assert volume(mesh) == pytest.approx(volume(make_mesh(v, f)))
    assert volume(mesh) > 0
    assert mesh.notes == ("all triangles faced inwards and were reversed",)


def test_mixed_winding_is_fixed_and_counted() -> None:
    v, f = bumpy_sphere(3)
    wrong = np.random.default_rng(1).random(len(f)) < 0.4
    mesh = make_mesh(v, np.where(wrong[:, None], f[:, ::-1], f))
    assert not half_edges(mesh.faces)[1].any()
    assert volume(mesh) == pytest.approx(volume(make_mesh(v, f)), rel=1e-14)
    assert mesh.notes == (f"{wrong.sum()} of 1280 triangles had the wrong orientation and were reversed",)


@pytest.mark.parametrize("turned", [(), (0,), (1,), (2,), (0, 1, 2)])
def test_cavities_face_inwards_whatever_the_file_says(turned: tuple[int, ...]) -> None:
    """Spheres of 40, 30 and 20 mm inside one another: solid, cavity, solid; a sphere beside them is solid too."""
    v, f = bumpy_sphere(2, 1.0, 0.0)
    one = volume(make_mesh(v, f))
    scales, places = [0.04, 0.03, 0.02, 0.01], [0.0, 0.0, 0.0, 0.1]
    parts = [f + len(v) * k for k in range(4)]
    for k in turned:
        parts[k] = parts[k][:, ::-1]
    points = [scale * v + np.array([x, 0, 0]) for scale, x in zip(scales, places, strict=True)]
    mesh = make_mesh(np.vstack(points), np.vstack(parts))
    assert volume(mesh) == pytest.approx(one * (0.04**3 - 0.03**3 + 0.02**3 + 0.01**3), rel=1e-12)
    assert not any("may intersect" in note for note in mesh.notes)


def test_solids_that_cross_are_noted() -> None:
    """A ball across a face of a cube of 100 mm, a ball beside it, and a cube that shares an edge with it."""
    cube = trimesh.creation.box(extents=[0.1] * 3)
    v, f = np.asarray(cube.vertices), np.asarray(cube.faces)
    ball, g = bumpy_sphere(2, 0.02, 0.0)
    for x, crosses in ((0.05, True), (0.08, False)):
        mesh = make_mesh(np.vstack([v, ball + np.array([x, 0.0, 0.0])]), np.vstack([f, g + len(v)]))
        assert any(note.startswith("2 closed surfaces may intersect") for note in mesh.notes) == crosses
    diagonal = v + np.array([0.1, 0.1, 0.0])
    with pytest.raises(InputError, match=r"1 with more than two triangles.*unite solids that touch"):
        make_mesh(np.vstack([v, diagonal]), np.vstack([f, f + len(v)]))


def test_not_watertight_is_refused_unless_a_shell() -> None:
    v, f = ell()
    with pytest.raises(InputError, match=r"3 open edges.*watertight.*shell = true"):
        make_mesh(v, f[1:])
    mesh = make_mesh(v, f[1:], shell=True)
    assert (len(mesh.faces), mesh.shell) == (19, True)
    with pytest.raises(InputError, match="more than two"):
        make_mesh(*_fin())


def _fin() -> tuple[FloatArray, NDArray[np.intp]]:
    """Two tetrahedra that share an edge."""
    v = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 1, 0], [-1, 0, 0], [-1, -1, 0]]) * 0.02
    f = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2], [0, 1, 4], [0, 5, 1], [0, 4, 5], [1, 5, 4]])
    return v, f


def test_a_shell_keeps_the_side_of_most_of_its_triangles() -> None:
    v, f = sheet()
    g = f.copy()
    g[[3, 10]] = g[[3, 10], ::-1]
    mesh = make_mesh(v, g, shell=True)
    assert {tuple(np.sort(row)) for row in mesh.faces} == {tuple(np.sort(row)) for row in f}
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    assert mesh.notes == ("2 of 72 triangles had the wrong orientation and were reversed",)


def test_triangles_without_area_are_dropped_and_counted() -> None:
    """Repeated corners, and equal points under two numbers."""
    v, f = soup(*plate())
    v = np.vstack([v, v[:1]])
    extra = [[0, 0, 1], [2, 2, 2], [0, len(v) - 1, 1]]
    mesh = make_mesh(v, np.vstack([f, extra]))
    assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
    assert mesh.notes == ("3 of 15 triangles had no area and were removed",)
    assert np.isfinite(mesh.data).all()


def test_a_flat_triangle_in_a_seam_leaves_the_surface_closed() -> None:
    """A corner in the middle of the neighbour's side with a triangle of no height between: the neighbour is cut."""
    v, f = plate()
    side = f[0]
    v = np.vstack([v, 0.5 * (v[side[0]] + v[side[1]])])
    other = next(k for k in range(1, 12) if {side[0], side[1]} <= set(f[k]))
    # the other triangle is cut at the new vertex, and the gap filled with the flat triangle
    far = next(c for c in f[other] if c not in (side[0], side[1]))
    a, b, m = side[0], side[1], 8
    rest = np.delete(f, other, axis=0)
    mesh = make_mesh(v, np.vstack([rest, [[b, m, far], [m, a, far], [b, a, m]]]))
    assert len(mesh.faces) == 14  # both sides of the seam are cut at m
    assert (half_edges(mesh.faces)[0] >= 0).all()
    assert volume(mesh) == pytest.approx(0.1 * 0.08 * 0.001, rel=1e-12)
    assert mesh.notes == (
        "1 of 14 triangles had no area and were removed",
        "1 triangles were split at a vertex in the middle of their side",
    )


def test_corners_that_nearly_meet_are_joined() -> None:
    """A soup whose corners are 1e-9 m apart closes; one with gaps of 10 um does not."""
    v, f = soup(*ell())
    rng = np.random.default_rng(2)
    mesh = make_mesh(v + rng.uniform(-5e-10, 5e-10, v.shape) + 1.3e-8, f)
    assert (len(mesh.vertices), len(mesh.faces)) == (12, 20)
    assert "merged" in mesh.notes[0]
    with pytest.raises(InputError, match="open edges"):
        make_mesh(v + rng.uniform(-1e-5, 1e-5, v.shape), f)


@pytest.mark.parametrize(
    ("vertices", "faces", "fault"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], [[0, 1, 2]], "finite"),
        ([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]], [[0, 1, 2]], "finite"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], "0 to 2"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, -1]], "0 to 2"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.5, 1, 2]], "integer vertex indices"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.zeros((0, 3), int), "surface of triangles"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], "surface of triangles"),
        ([[1, 1, 1], [1, 1, 1], [1, 1, 1]], [[0, 1, 2]], "larger than a point"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "without area"),
    ],
)
def test_surfaces_that_cannot_be(vertices: Any, faces: Any, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        make_mesh(vertices, faces)


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
def test_scales_that_cannot_be(scale: float) -> None:
    with pytest.raises(InputError, match="scale"):
        make_mesh(*plate(), scale=scale)


def test_vertices_that_no_triangle_has_do_not_matter() -> None:
    v, f = plate()
    mesh = make_mesh(np.vstack([v, [[np.nan, 5.0, 0.0], [9.0, 9.0, 9.0]]]), f)
    assert (len(mesh.vertices), mesh.notes) == (8, ())


def test_mass_properties_of_a_box_anywhere() -> None:
    """Those of `Box`, about the centre; density 1000 kg/m^3 of 8e-6 m^3 is 8 g; also for a box of 30 um."""
    v, f = plate()
    for scale in (1.0, 3e-4):
        moved = v * scale + np.array([0.3, -0.2, 0.1]) * scale
        found = make_mesh(moved, f).mass_properties(mass=0.1)
        np.testing.assert_allclose(found.centre, np.array([0.3, -0.2, 0.1]) * scale, rtol=1e-14)
        np.testing.assert_allclose(found.moments, Box((0.1, 0.08, 0.001)).inertia(0.1, 3) * scale**2, rtol=1e-12)
        np.testing.assert_array_equal(found.axes, np.eye(3))
    assert make_mesh(v, f).mass_properties(density=1000.0).mass == pytest.approx(0.008, rel=1e-13)


def test_mass_properties_of_a_turned_box() -> None:
    """The principal axes are the box's edges; R diag(moments) R' is the inertia."""
    v, f = plate(0.1, 0.06, 0.03)
    axis, angle = np.array([1.0, 2.0, -0.5]), 0.4
    R = trimesh.transformations.rotation_matrix(angle, axis)[:3, :3]
    mesh = make_mesh(v @ R.T, f)
    found = mesh.mass_properties(mass=0.2)
    expected = Box((0.1, 0.06, 0.03)).inertia(0.2, 3)
    np.testing.assert_allclose(found.moments, expected, rtol=1e-12)  # they increase as x, y, z do here
    np.testing.assert_allclose(found.axes @ np.diag(found.moments) @ found.axes.T, found.inertia, atol=1e-18)
    np.testing.assert_allclose(np.abs(R.T @ found.axes), np.eye(3), atol=1e-11)
    assert np.linalg.det(found.axes) == pytest.approx(1.0)
    own = mesh.seen_from(found.centre, found.axes)
    np.testing.assert_allclose(own.mass_properties(mass=0.2).inertia, np.diag(expected), atol=1e-18)
    np.testing.assert_allclose(np.sort(np.abs(own.vertices), axis=0)[0], [0.05, 0.03, 0.015], rtol=1e-9)


def test_mass_properties_of_a_concave_solid() -> None:
    """An L is two boxes: Steiner's theorem."""
    found = make_mesh(*ell()).mass_properties(density=500.0)
    boxes = [((0.06, 0.02, 0.03), np.array([0.03, 0.01, 0.015])), ((0.02, 0.04, 0.03), np.array([0.01, 0.04, 0.015]))]
    masses = [500.0 * math.prod(size) for size, _ in boxes]
    centre = sum(m * at for m, (_, at) in zip(masses, boxes, strict=True)) / sum(masses)
    inertia = np.zeros((3, 3))
    for m, (size, at) in zip(masses, boxes, strict=True):
        r = at - centre
        inertia += np.diag(Box(size).inertia(m, 3)) + m * (r @ r * np.eye(3) - np.outer(r, r))
    assert found.mass == pytest.approx(0.03, rel=1e-13)
    np.testing.assert_allclose(found.centre, centre, rtol=1e-13)
    np.testing.assert_allclose(found.inertia, inertia, atol=1e-17)


def test_mass_properties_of_a_shell() -> None:
    """Mass spread over the surface: a sphere's moments are 2/3 m r^2 (0.1 % of facets), a square's m a^2/12 and /6."""
    v, f = bumpy_sphere(5, 0.03, 0.0)
    found = make_mesh(v, f, shell=True).mass_properties(mass=0.2)
    np.testing.assert_allclose(found.moments, 2 / 3 * 0.2 * 0.03**2, rtol=2e-3)
    square = make_mesh(
        [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, 0.1, 0.0]], [[0, 1, 2], [0, 2, 3]], shell=True
    )
    found = square.mass_properties(mass=0.3)
    np.testing.assert_allclose(found.centre, [0.05, 0.05, 0.0], rtol=1e-14)
    np.testing.assert_allclose(found.moments, 0.3 * 0.01 / 12 * np.array([1, 1, 2]), rtol=1e-13)
    with pytest.raises(InputError, match="density"):
        square.mass_properties(density=1000.0)


def test_masses_that_cannot_be() -> None:
    mesh = make_mesh(*plate())
    with pytest.raises(InputError, match="either"):
        mesh.mass_properties()
    with pytest.raises(InputError, match="either"):
        mesh.mass_properties(mass=1.0, density=1.0)
    for wrong in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="mass"):
            mesh.mass_properties(mass=wrong)
        with pytest.raises(InputError, match="density"):
            mesh.mass_properties(density=wrong)


def test_a_mug_is_sound() -> None:
    """Booleans leave it watertight: outside pi r^2 h less the inside, plus the handle; sound within 2 %."""
    mesh = make_mesh(*mug())
    cup = math.pi * (0.04**2 * 0.09 - 0.037**2 * 0.086)
    assert cup < volume(mesh) < cup + math.pi * 0.004**2 * 2 * math.pi * 0.025
    assert mesh.dimensions_ok(3)
    assert not mesh.dimensions_ok(2)


def test_contact_from_python() -> None:
    """5 mm above a plate; pressed 6 mm deep from there; a new finger at the same place is below it."""
    mesh = make_mesh(*plate())
    state = new_fingers(1)
    found = mesh.contact([[0.01, 0.02, 0.0055]], state)
    assert found.gap[0] == pytest.approx(0.005, rel=1e-13)
    found = mesh.contact([[0.01, 0.02, -0.0055]], state)
    np.testing.assert_allclose(found.point, [[0.01, 0.02, 0.0005]], atol=1e-17)
    np.testing.assert_array_equal(found.normal, [[0, 0, -1]])
    assert found.gap[0] == pytest.approx(-0.006, rel=1e-13)
    assert mesh.contact([[0.01, 0.02, -0.0055]]).gap[0] == pytest.approx(0.005, rel=1e-13)
    with pytest.raises(InputError, match="points"):
        mesh.contact([[0.0, 0.0]])
    with pytest.raises(InputError, match="points"):
        mesh.contact([[0.0, 0.0, np.nan]])
    with pytest.raises(InputError, match="state"):
        mesh.contact([[0.0, 0.0, 0.0]], np.zeros((1, STATE - 1)))
