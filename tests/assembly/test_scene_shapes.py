"""Every shape and fingertip from the scene to the force: depths, meshes against boxes, thin plates, poses, faults."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import graspfx as gx
from graspfx.__main__ import main
from graspfx.assembly.build import build
from graspfx.assembly.meshes import scene_mesh
from graspfx.certificate.plan import plan
from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.errors import InputError, SceneError
from graspfx.objects import integrators as body
from graspfx.objects.body import fill_body
from graspfx.objects.body_state import BodyState
from graspfx.surfaces.closed_form.shape import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Shape, Sphere
from tests.support.meshes import ell, plate, sheet
from tests.support.optional import require

FloatArray = np.ndarray
DEVICE = {"name": "simulated", "mass": 0.1, "damping": 0.5}
HALF_TURN = [0.1, 0.5, -0.3, 0.65**0.5]  # a quaternion that favours no axis


def table(
    d: int, shape: Any, starts: Any, *, radius: Any = 0.0, gains: tuple[float, float] = (50.0, 50.0), **more: Any
) -> dict[str, Any]:
    """A scene's tables: an object of that shape and a finger at each start; `more` are keys of the object."""
    radii = np.broadcast_to(radius, len(starts)).tolist()
    thing = {
        "mass": 0.2,
        "viscosity": 0.5,
        "shape": shape,
        **({} if d == 1 else {"rotational_viscosity": 1e-4}),
        **more,
    }
    if shape.get("kind") in ("half-space", "plane") and d > 1:
        thing["inertia"] = 1e-4
    return {
        "dimensions": d,
        "period": 0.001,
        "duration": 0.05,
        "object": thing,
        "coupling": {"external": {"stiffness": gains[0]}, "internal": {"stiffness": gains[1]}, "absent": "follow"},
        "finger": [{"device": DEVICE, "start": list(s), "radius": r} for s, r in zip(starts, radii, strict=True)],
    }


@contextmanager
def grasped(tables: dict[str, Any]) -> Iterator[GraspedObject]:
    """The coupled object of a scene, as its run would begin."""
    with build(gx.Scene(**tables)) as servo:
        yield servo.objects[0].grasped


def respond(g: GraspedObject, position: Any, velocity: Any = 0.0) -> FloatArray:
    g.finger_position[:], g.finger_velocity[:] = position, velocity
    assert g.sample() == 0
    return g.force.copy()


def inline(surface: tuple[FloatArray, FloatArray], **more: Any) -> dict[str, Any]:
    return {"vertices": surface[0].tolist(), "faces": surface[1].tolist(), **more}


BLOCK = inline(plate(0.05, 0.04, 0.03))
# shape, direction out of it, and how far the surface is in that direction
CASES: list[tuple[int, dict[str, Any], list[float], float]] = [
    (1, {"kind": "box", "size": [0.05]}, [1.0], 0.025),
    (1, {"kind": "sphere", "radius": 0.03}, [-1.0], 0.03),
    (1, {"kind": "half-space", "normal": [2.0]}, [1.0], 0.0),
    (1, {"kind": "plane", "normal": [1.0]}, [-1.0], 0.0),
    (2, {"kind": "box", "size": [0.05, 0.04]}, [0.0, 1.0], 0.02),
    (2, {"kind": "sphere", "radius": 0.03}, [0.6, -0.8], 0.03),
    (2, {"kind": "half-space", "normal": [3.0, 4.0]}, [0.6, 0.8], 0.0),
    (2, {"kind": "plane", "normal": [3.0, 4.0]}, [-0.6, -0.8], 0.0),
    (2, {"kind": "capsule", "radius": 0.02, "length": 0.03}, [0.0, 1.0], 0.02),
    (2, {"kind": "ellipsoid", "semi_axes": [0.03, 0.02]}, [0.0, -1.0], 0.02),
    (3, {"kind": "box", "size": [0.05, 0.04, 0.03]}, [0.0, 0.0, -1.0], 0.015),
    (3, {"kind": "sphere", "radius": 0.03}, [0.48, 0.6, -0.64], 0.03),
    (3, {"kind": "half-space", "normal": [0.0, 3.0, 4.0]}, [0.0, 0.6, 0.8], 0.0),
    (3, {"kind": "plane", "normal": [0.0, 3.0, 4.0]}, [0.0, -0.6, -0.8], 0.0),
    (3, {"kind": "capsule", "radius": 0.02, "length": 0.03}, [0.6, 0.8, 0.0], 0.02),
    (3, {"kind": "cylinder", "radius": 0.02, "length": 0.03}, [0.6, 0.8, 0.0], 0.02),
    (3, {"kind": "cylinder", "radius": 0.02, "length": 0.03}, [0.0, 0.0, 1.0], 0.015),
    (3, {"kind": "ellipsoid", "semi_axes": [0.03, 0.02, 0.01]}, [0.0, 0.0, 1.0], 0.01),
    (3, BLOCK, [1.0, 0.0, 0.0], 0.025),
    (3, BLOCK, [0.0, 0.0, -1.0], 0.015),
]


def turned(d: int) -> tuple[Any, FloatArray]:
    """An orientation that is no special one, and its matrix."""
    if d == 1:
        return None, np.eye(1)
    if d == 2:
        return 0.7, np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    S = np.zeros(body.SIZE)
    S[body.DIMENSIONS], S[body.QUATERNION : body.QUATERNION + 4] = 3, HALF_TURN
    body.orient(BodyState(S))
    return HALF_TURN, S[body.ROTATION : body.ROTATION + 9].reshape(3, 3)


@pytest.mark.parametrize("radius", [0.0, 0.004])
@pytest.mark.parametrize(("d", "shape", "out", "surface"), CASES)
def test_a_lone_finger_feels_stiffness_times_depth(
    d: int, shape: dict[str, Any], out: list[float], surface: float, radius: float
) -> None:
    """k x depth along the normal, to 1e-12 N: 50 at equal gains, and of 30/70 the external one."""
    orientation, R = turned(d)
    x = np.array([0.3, -0.2, 0.1])[:d]
    pose = {"position": x.tolist()} | ({} if orientation is None else {"orientation": orientation})
    n = R @ np.array(out)  # outwards
    for gains, k in (((50.0, 50.0), 50.0), ((30.0, 70.0), 30.0)):
        start = x + (surface + radius + 0.005) * n
        with grasped(table(d, shape, [start.tolist()], radius=radius, gains=gains, **pose)) as g:
            assert np.array_equal(respond(g, start), np.zeros((1, d)))
            assert g.array(FingerState.gap)[0] == pytest.approx(0.005, abs=1e-15)
            for depth in (0.0005, 0.002, 0.003):
                p = x + (surface + radius - depth) * n
                np.testing.assert_allclose(respond(g, p), [-k * depth * n], atol=1e-12)
                np.testing.assert_allclose(g.contact_position, [x + (surface + radius) * n], atol=1e-15)
                np.testing.assert_allclose(g.wrench[:d], g.force[0], atol=0.0)
                np.testing.assert_allclose(g.wrench[d:], 0.0, atol=1e-13 if d > 1 else 0.0)


@pytest.mark.parametrize("radius", [0.0, 0.004])
@pytest.mark.parametrize(("d", "shape", "out", "surface"), [case for case in CASES if case[3] > 0.0])
def test_a_squeeze_is_felt_with_the_internal_gain(
    d: int, shape: dict[str, Any], out: list[float], surface: float, radius: float
) -> None:
    """Two fingers from both sides, 2 mm deep each: 70 N/m of 30/70, and no wrench."""
    n = np.array(out)
    starts = np.stack([n, -n]) * (surface + radius)
    with grasped(table(d, shape, starts.tolist(), radius=radius, gains=(30.0, 70.0))) as g:
        f = respond(g, starts * (1.0 - 0.002 / (surface + radius)))
        np.testing.assert_allclose(f, [-0.14 * n, 0.14 * n], atol=1e-12)
        assert np.abs(g.wrench).max() < 1e-14


def turn_body(g: GraspedObject, x: FloatArray, q: FloatArray) -> FloatArray:
    state = g.body_state
    state[body.POSITION : body.POSITION + 3], state[body.QUATERNION : body.QUATERNION + 4] = x, q / np.linalg.norm(q)
    body.orient(BodyState(state))
    return state[body.ROTATION : body.ROTATION + 9].reshape(3, 3).copy()


@pytest.mark.parametrize("friction", [0.0, "stick"])
@pytest.mark.parametrize("gains", [(50.0, 50.0), (30.0, 70.0)])
def test_a_box_of_triangles_is_a_box(gains: tuple[float, float], friction: Any) -> None:
    """A point and three balls touch, press, slide over edges and leave a box that moves and turns: 1e-12 N."""
    radii = [0.0, 0.004, 0.002, 0.006]
    out = np.array([[0.025, 0.0, 0.0], [-0.025, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.015]])
    n = np.sign(out)
    away = out + n * (np.array(radii)[:, None] + 0.004)
    shapes = ({"kind": "box", "size": [0.05, 0.04, 0.03]}, BLOCK)
    tables = [table(3, shape, away.tolist(), radius=radii, gains=gains) for shape in shapes]
    for each in tables:
        each["coupling"] |= {"absent": "fade", "friction": friction}
    worst = touched = 0.0
    with grasped(tables[0]) as box, grasped(tables[1]) as mesh:
        for t in np.linspace(0.0, 1.0, 250):
            q = np.array([0.3 * np.sin(3 * t), 0.4 * t, 0.2 * np.sin(5 * t), 1.0])
            x = 0.1 * np.array([np.sin(2 * t), t, np.cos(3 * t)])
            slide = np.roll(n, 1, axis=1) * 0.024 * np.sin(9 * t) * np.array([0.4, 1.0, 1.0, 1.0])[:, None]
            press = n * (0.004 - 0.008 * np.sin(6 * t + np.arange(4.0))[:, None])
            local = out + n * np.array(radii)[:, None] + press + slide
            forces = [respond(g, x + local @ turn_body(g, x, q).T) for g in (box, mesh)]
            worst = max(worst, np.abs(forces[0] - forces[1]).max(), np.abs(box.wrench - mesh.wrench).max())
            touched += float((np.abs(forces[0]).max(axis=1) > 0.0).sum())
    assert worst < 1e-12
    assert touched > 250  # of a thousand


@pytest.mark.parametrize("radius", [0.0, 0.004])
def test_a_finger_is_never_through_a_thin_plate(tmp_path: Path, radius: float) -> None:
    """A plate of 1 mm in a file in millimetres, a hand that pushes 6 mm in: the force never turns."""
    trimesh.Trimesh(*plate(100.0, 80.0, 1.0), process=False).export(tmp_path / "plate.stl")
    shape = {"mesh": str(tmp_path / "plate.stl"), "scale": 0.001}
    tables = table(3, shape, [[0.01, 0.005, 0.0005 + radius]], radius=radius, free=[False] * 6)
    motion = {"kind": "reach", "displacement": [0.02, 0.0, -0.0062], "duration": 0.15}
    tables["finger"][0]["hand"] = {"stiffness": 2000.0, "damping": 20.0, "motion": motion}
    rec = gx.run(gx.Scene(**tables | {"duration": 0.3}))
    f, gap = rec.finger_force[:, 0], rec.gap
    assert gap is not None and gap.min() < -0.0058
    assert (f[:, 2] <= 0.0).all() and f[-1, 2] == pytest.approx(50.0 * gap[-1, 0], abs=1e-12)
    assert np.abs(f[:, :2]).max() < 1e-12 and rec.touching[2:].all()
    assert np.abs(np.diff(f[:, 2])).max() < 0.01  # no sample loses it


@pytest.mark.parametrize("radius", [0.0, 0.004])
def test_a_finger_that_leaves_may_touch_the_other_side(radius: float) -> None:
    """Pressed from above, away, round the plate and pressed from below; far away, the gap is one that it exceeds."""
    high = 0.0005 + radius
    tables = table(3, inline(plate()), [[0.0, 0.0, high]], radius=radius)
    tables["coupling"]["absent"] = "fade"
    way = [[0, 0, high - 0.003], [0, 0, 0.2], [0.2, 0, 0.2], [0.2, 0, -0.2], [0, 0, -0.2], [0, 0, 0.003 - high]]
    with grasped(tables) as g:
        forces, gaps = [], []
        for a, b in itertools.pairwise(way):
            for p in np.linspace(a, b, 100):
                forces.append(respond(g, p)[0])
                gaps.append(g.array(FingerState.gap)[0])
        np.testing.assert_allclose(forces[0], [0.0, 0.0, -0.15], atol=1e-12)
        np.testing.assert_allclose(forces[-1], [0.0, 0.0, 0.15], atol=1e-12)
        assert np.abs(forces[10:490]).max() == 0.0 and min(gaps[10:490]) > 0.0
        assert g.array(FingerState.weight)[0] == 1.0


@pytest.mark.parametrize("reaction", ["fingertip", "contact"])
@pytest.mark.parametrize("friction", [0.0, "stick"])
def test_damping_of_balls_never_creates_energy(friction: Any, reaction: str) -> None:
    """The power that damping takes from fingers and object, 400 random states on a box and a mesh: never negative.

    Action is reaction in moments too: about the object's centre the wrench has that of the forces at the balls' centres
    p, or at the points where p would be if they just touched.
    """
    rng = np.random.default_rng(1)
    starts = np.array([[0.029, 0.0, 0.0], [-0.029, 0.0, 0.0], [0.0, 0.024, 0.0]])
    box = {"kind": "box", "size": [0.05, 0.04, 0.03]}
    for shape, orientation in ((box, HALF_TURN), (BLOCK, HALF_TURN)):
        R = turned(3)[1]
        tables = table(3, shape, (starts @ R.T).tolist(), radius=0.004, gains=(30.0, 70.0), orientation=orientation)
        tables["coupling"] |= {"friction": friction, "reaction": reaction}
        still, damped = dict(tables), {**tables, "coupling": {**tables["coupling"]}}
        for part, damping in (("external", 2.0), ("internal", 0.5)):
            damped["coupling"][part] = {**tables["coupling"][part], "damping": damping}
        least = 0.0
        with grasped(still) as a, grasped(damped) as b:
            for _ in range(100):
                p = (starts * rng.uniform(0.85, 1.02, (3, 1)) + rng.normal(size=(3, 3)) * 0.002) @ R.T
                rates, v, w = rng.normal(size=(3, 3)) * 0.1, rng.normal(size=3) * 0.1, rng.normal(size=3)
                for g in (a, b):
                    g.body_state[body.VELOCITY : body.VELOCITY + 3] = v
                    g.body_state[body.ANGULAR_VELOCITY : body.ANGULAR_VELOCITY + 3] = w
                f, wrench = respond(b, p, rates) - respond(a, p), b.wrench - a.wrench
                if np.array_equal(a.touching, b.touching):
                    least = min(least, float((f * rates).sum() - wrench[:3] @ v - wrench[3:] @ w))
                where = p if reaction == "fingertip" else b.contact_position
                np.testing.assert_allclose(b.wrench[3:], np.cross(where, b.force).sum(axis=0), atol=1e-15)
        assert least > -1e-15


@pytest.mark.parametrize("changes", [{"contact": "attached"}, {"absent": "fade", "friction": "stick"}])
def test_the_implicit_integrator_takes_a_mesh_as_a_box(changes: dict[str, Any]) -> None:
    """Two balls squeeze and shake it for 50 samples: the same motion to 1e-12 m, attached and unilateral."""
    starts = [[-0.0285, 0.0, 0.001], [0.0285, 0.002, 0.0]]
    recordings = []
    for shape in ({"kind": "box", "size": [0.05, 0.04, 0.03]}, BLOCK):
        tables = table(3, shape, starts, radius=0.004, gains=(30.0, 70.0), integrator="implicit")
        tables["coupling"] |= changes
        for finger in tables["finger"]:
            finger["hand"] = {"stiffness": 300.0, "damping": 3.0, "squeeze": 0.002}
        recordings.append(gx.run(gx.Scene(**tables)))
    box, mesh = recordings
    assert box.touching.all() and np.abs(box.finger_force).max() > 0.01
    np.testing.assert_allclose(mesh.finger_force, box.finger_force, atol=1e-12)
    np.testing.assert_allclose(mesh.object_position, box.object_position, atol=1e-12)


@pytest.mark.parametrize("radius", [-0.001, np.inf, [0.001, 0.001, 0.001]])
def test_a_coupling_takes_lengths_for_radii(radius: Any) -> None:
    def fill(state: FloatArray) -> None:
        fill_body(state, dimensions=1, mass=0.1)

    law = gx.Coupling(external=gx.Impedance(30.0), internal=gx.Impedance(70.0))
    with pytest.raises(InputError, match="radius"):
        GraspedObject(2, 1, 0.001, law, Rules(), fill, shape=Box((0.05,)), radius=radius)


# Mass and pose -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (Box((0.1, 0.2, 0.3)), 6e-3),
        (Sphere(0.1), 4e-3 / 3 * np.pi),
        (Cylinder(0.1, 0.3), 3e-3 * np.pi),
        (Capsule(0.1, 0.3), (3e-3 + 4e-3 / 3) * np.pi),
        (Ellipsoid((0.1, 0.2, 0.3)), 8e-3 * np.pi),
    ],
)
def test_volumes(shape: Shape, volume: float) -> None:
    assert shape.volume() == pytest.approx(volume, rel=1e-15)


def test_what_is_flat_or_endless_has_no_volume() -> None:
    with pytest.raises(InputError, match="dimensions"):
        Box((0.1, 0.2)).volume()
    with pytest.raises(InputError, match="a bounded shape"):
        HalfSpace((0.0, 0.0, 1.0)).volume()


@pytest.mark.parametrize("shape", [{"kind": "box", "size": [0.05, 0.04, 0.03]}, BLOCK])
def test_density_gives_mass_and_inertia(shape: dict[str, Any]) -> None:
    """60 cm^3 at 2000 kg/m^3."""
    tables = table(3, shape, [[0.1, 0.0, 0.0]], density=2000.0)
    del tables["object"]["mass"]
    with grasped(tables) as g:
        assert g.body_state[body.MASS] == pytest.approx(0.12, rel=1e-13)
        sides = np.array([0.05, 0.04, 0.03]) ** 2
        moments = 0.12 / 12 * (sides.sum() - sides)
        np.testing.assert_allclose(g.body_state[body.INERTIA : body.INERTIA + 3], moments, rtol=1e-13)


def test_the_pose_of_a_mesh_is_its_files(tmp_path: Path) -> None:
    """An L whose file's origin is a corner, turned: mass properties as trimesh has them, a contact by hand."""
    v, f = ell()
    trimesh.Trimesh(v * 1000.0, f, process=False).export(tmp_path / "ell.obj")
    x, R = np.array([0.3, -0.2, 0.1]), turned(3)[1]
    shape = {"mesh": "ell.obj", "scale": 0.001}
    start = x + R @ [0.03, -0.004, 0.01]
    pose = {"position": x.tolist(), "orientation": HALF_TURN, "angular_velocity": [1.0, 2.0, -1.0]}
    tables = table(3, shape, [start.tolist()], density=1500.0, **pose)
    del tables["object"]["mass"]
    text = "\n".join(["def scene():", "    import graspfx", f"    return graspfx.Scene(**{tables!r})"])
    (tmp_path / "mine.py").write_text(text.replace("ell.obj", str(tmp_path / "ell.obj")))
    scene = gx.load(tmp_path / "mine.py")
    unit = trimesh.Trimesh(v * 1000.0, f, process=False)
    unit.density = 1500e-9
    whole = unit.mass_properties
    with build(scene) as servo:
        g = servo.objects[0].grasped
        state = g.body_state
        assert state[body.MASS] == pytest.approx(whole["mass"], rel=1e-6)
        centre = x + R @ (np.asarray(whole["center_mass"]) / 1000.0)
        np.testing.assert_allclose(state[body.POSITION : body.POSITION + 3], centre, atol=1e-9)
        Q = state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
        inertia = Q @ np.diag(state[body.INERTIA : body.INERTIA + 3]) @ Q.T
        np.testing.assert_allclose(inertia, R @ (np.asarray(whole["inertia"]) * 1e-6) @ R.T, rtol=1e-6, atol=1e-12)
        p = x + R @ [0.03, 0.002, 0.01]  # 2 mm in through the side y = 0
        np.testing.assert_allclose(respond(g, p), [R @ [0.0, 0.1, 0.0]], atol=1e-12)
        np.testing.assert_allclose(g.contact_position, [x + R @ [0.03, 0.0, 0.01]], atol=1e-15)

    rec = gx.run(scene, out=tmp_path / "out")  # what was written and read again
    position, orientation = rec.described_pose("object")
    assert orientation is not None
    np.testing.assert_allclose(position[0], x, atol=1e-15)
    assert abs(orientation[0] @ HALF_TURN) == pytest.approx(1.0, abs=1e-15)
    assert np.linalg.norm(position[-1] - x) > 1e-3  # it turns about its centre of mass, and the corner goes with it
    arms = Rotation.from_quat(orientation).apply(np.asarray(whole["center_mass"]) / 1000.0)
    np.testing.assert_allclose(position + arms, rec.object_position, atol=1e-9)


def test_a_pose_that_was_described_is_that_of_any_other_shape() -> None:
    rec = gx.run(gx.Scene(**table(2, {"kind": "sphere", "radius": 0.03}, [[0.03, 0.0]])))
    position, orientation = rec.described_pose("object")
    assert position is rec.object_position or np.array_equal(position, rec.object_position)
    assert orientation is not None and np.array_equal(orientation, require(rec.object_orientation))


def test_a_file_is_read_once_until_it_changes(tmp_path: Path) -> None:
    file = tmp_path / "a.stl"
    trimesh.Trimesh(*plate(), process=False).export(file)
    scene = gx.Scene(**table(3, {"mesh": str(file)}, [[0.0, 0.0, 0.01]]))
    first = scene_mesh(scene.object[0], None)
    assert scene_mesh(scene.object[0], None) is first
    trimesh.Trimesh(*ell(), process=False).export(file)
    assert scene_mesh(scene.object[0], None) is not first


# What a scene says of it -------------------------------------------------------------------------------------------

SHELL = inline(sheet(), shell=True)


SOURCES = "expected a file (mesh = 'mug.stl'), or vertices and faces"
KINDS = "box, sphere, half-space, plane, capsule, cylinder, ellipsoid, mesh"
OPEN = (
    "given '24 open edges, 0 with more than two triangles', expected a watertight surface; "
    "close the surface, or set shell = true, so that fingers touch only its front"
)
MISSING = "given 'none.stl', expected the path of a file; paths are relative to the scene's file"
NUMBERS = "given an array of shape (1, 3), expected integer vertex indices from 0 to 7"
DISC = {"kind": "sphere", "radius": 0.1}
FLOOR = {"kind": "plane", "normal": [0.0, 0.0, 1.0]}
DENSE = {"mass": None, "density": 1000.0}


@pytest.mark.parametrize(
    ("d", "shape", "key", "fault"),
    [
        (3, {"mesh": "none.stl"}, "mesh", MISSING),
        (3, inline(sheet()), "vertices", OPEN),
        (3, {**BLOCK, "scale": -1.0}, "scale", "expected more than 0; given -1.0"),
        (3, {**BLOCK, "scal": 1.0}, "scal", "unknown key; did you mean 'scale'?"),
        (3, {"vertices": BLOCK["vertices"]}, "", SOURCES),
        (3, {"kind": "mesh"}, "", SOURCES),
        (3, {**BLOCK, "mesh": "a.stl"}, "vertices", "expected either a file (mesh) or vertices and faces, not both"),
        (3, {**BLOCK, "faces": [[0, 1, 99]]}, "faces", NUMBERS),
        (3, {**BLOCK, "faces": [[0, 1]]}, "faces.0.2", "required, but not given"),
        (2, BLOCK, "vertices", "there is no mesh in 2 dimension(s)"),
        (3, {"kind": "mush"}, "kind", f"unknown kind of shape 'mush'; did you mean 'mesh'? (known: {KINDS})"),
    ],
)  # fmt: skip
def test_faults_of_a_mesh(d: int, shape: dict[str, Any], key: str, fault: str) -> None:
    assert faults(table(d, shape, [[0.1] * d])) == [f"object.shape{key and '.'}{key}: {fault}"]


@pytest.mark.parametrize(
    ("d", "shape", "changes", "fault"),
    [
        (3, BLOCK, {"mass": None}, "mass: required, but not given (or density)"),
        (2, DISC, {"mass": None}, "mass: required, but not given"),
        (3, BLOCK, {"density": 1000.0}, "density: expected either a mass or a density, not both"),
        (3, SHELL, DENSE, "density: a shell has no volume: set the mass instead"),
        (3, FLOOR, DENSE, "density: a plane has no finite volume: set the mass instead"),
        (2, DISC, DENSE, "density: a density requires three dimensions; given 2: set the mass instead"),
        (3, BLOCK, {"mass": None, "density": -1.0}, "density: expected more than 0; given -1.0"),
        (3, BLOCK, {"mass": None, "masss": 1.0}, "masss: unknown key; did you mean 'mass'?"),
    ],
)
def test_faults_of_a_mass(d: int, shape: dict[str, Any], changes: dict[str, Any], fault: str) -> None:
    tables = table(d, shape, [[0.1] * d])
    tables["object"] = {key: value for key, value in (tables["object"] | changes).items() if value is not None}
    assert faults(tables) == [f"object.{fault}"]


def faults(tables: dict[str, Any]) -> list[str]:
    with pytest.raises(SceneError) as found:
        gx.Scene(**tables)
    return [each.text("").removeprefix(": ") for each in found.value.faults]


def test_files_that_are_no_meshes_are_faults_of_their_key(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_text("no mesh")
    (tmp_path / "a.shape").write_text("no mesh")
    for name, wanted in (("a.stl", "a valid stl file"), ("a.shape", "a file that ends in .glb, .obj")):
        with pytest.raises(SceneError, match=rf"object\.shape\.mesh: .* expected {wanted}"):
            gx.Scene(**table(3, {"mesh": str(tmp_path / name)}, [[0.1, 0.0, 0.0]]))


@pytest.mark.parametrize("radius", [-0.001, "big"])
def test_a_radius_is_a_length(radius: Any) -> None:
    tables = table(1, {"kind": "box", "size": [0.05]}, [[0.1]])
    tables["finger"][0]["radius"] = radius
    with pytest.raises(SceneError, match=r"finger\.0\.radius: expected"):
        gx.Scene(**tables)


TOML = """
dimensions = 3
period = 0.001
duration = 0.003
[object]
density = 1000.0
viscosity = 0.5
rotational_viscosity = 1e-4
shape = { mesh = "parts/inside-out.stl", scale = 1e-5 }
[coupling]
external = { stiffness = 30.0 }
internal = { stiffness = 70.0 }
[[finger]]
device = { name = "simulated", mass = 0.1 }
start = [0.01, 0.0, 0.0]
radius = 0.004
"""


def test_check_and_run_say_what_was_found_in_a_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file beside the scene, its triangles inside out and its scale a hundred times too small."""
    (tmp_path / "parts").mkdir()
    v, f = plate(50.0, 40.0, 30.0)
    trimesh.Trimesh(v, f[:, ::-1], process=False).export(tmp_path / "parts" / "inside-out.stl")
    (tmp_path / "a.toml").write_text(TOML)
    notes = [
        "inside-out.stl: all triangles faced inwards and were reversed",
        "object.0.shape = 0.0005 m across: check the unit (scale = 0.001 for millimetres)",
    ]
    assert main(["check", str(tmp_path / "a.toml"), "-v"]) == 0
    said = capsys.readouterr().out
    assert (
        all(said.count(f"note: {note}") == 1 for note in notes)
        and "adjacency walk on inside-out.stl, 12 triangles" in said
    )
    assert "1 of 1, radius 4 mm" in said and "trimesh (mesh)" in said
    assert main(["run", str(tmp_path / "a.toml"), "--no-figure", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().err
    assert all(said.count(f"note: {note}") == 1 for note in notes)


def test_points_on_closed_forms_need_neither_balls_nor_trimesh() -> None:
    rows = {row.step: row for row in plan(gx.Scene(**table(1, {"kind": "box", "size": [0.05]}, [[0.1]])))}
    assert not rows["ball fingertips"].runs and "trimesh" not in rows["packages"].why


def test_a_scene_in_python_takes_arrays_and_goes_back_to_tables() -> None:
    v, f = plate()
    scene = gx.Scene(**table(3, {"vertices": v, "faces": f}, [[0.0, 0.0, 0.01]], radius=0.004))
    again = gx.Scene(**scene.to_dict())
    assert again == scene and again.finger[0].radius == 0.004
    assert scene.replace({"object.shape.scale": 2.0}).object[0].shape.scale == 2.0  # type: ignore[union-attr]
