"""Fingers on meshes against brute force in long double; thin plates; edges and corners; concave shapes; compiled."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.compile.machine import compiled
from graspfx.compile.records import numbers
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form.proxy import BOX, closest
from graspfx.surfaces.triangles import ball, boxes, mesh_tree, tree, walk
from graspfx.surfaces.triangles.mesh import STATE
from graspfx.surfaces.triangles.mesh_tree import FREE, NEW, TOUCHING, MeshFinger, MeshTree, Vertex
from graspfx.surfaces.triangles.tree import flatten
from graspfx.surfaces.triangles.walk import mesh_contact
from tests.support.brute_force import brute_force, winding_number
from tests.support.meshes import (
    SHAPES,
    bumpy_sphere,
    flat,
    mug,
    plate,
    sheet,
    shifted,
    surface_point,
)

FloatArray = NDArray[np.float64]
TICK = 0.001  # [s]


class Finger:
    """One finger on a mesh that begins at entry m of its array, its own state at entry o."""

    def __init__(self, M: FloatArray, *, kernel: Any = None, reach: float = math.inf, m: int = 3, o: int = 2) -> None:
        self.state = np.full(o + STATE, np.nan)
        self.state[o:] = 0.0
        self.m, self.o = m, o
        self._M = shifted(M, m)
        self._kernel = kernel
        self.record = MeshFinger(memoryview(self.state), o)
        self.record.reach = reach
        self._mesh = MeshTree(memoryview(self._M), m)

    def to(self, p: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Contact point, normal and gap at p."""
        if self._kernel is None:
            contact = mesh_contact(self._mesh, self.record, Vector(*p.tolist()))
            _, *rest = numbers(contact)
        else:
            _, *rest = self._kernel(self._M, self.m, self.state, self.o, *p.tolist())
        return np.array(rest[:3]), np.array(rest[3:6]), rest[6]

    @property
    def mode(self) -> int:
        return self.record.mode


@pytest.fixture(scope="module")
def kernel() -> Callable[..., Any]:
    return compiled(mesh_contact)


def around(name: str, count: int, rng: np.random.Generator) -> tuple[Any, FloatArray]:
    """Points in and around a shape, half of them near its surface."""
    v, f = SHAPES[name]()
    low, high = v.min(axis=0), v.max(axis=0)
    anywhere = 0.5 * (low + high) + rng.uniform(-0.8, 0.8, size=(count, 3)) * (high - low)
    near = surface_point(v, f, count, rng) + rng.normal(size=(count, 3)) * 10 ** rng.uniform(-6, -1.5, size=(count, 1))
    return (v, f), np.where(rng.random((count, 1)) < 0.5, anywhere, near)


@pytest.mark.parametrize("name", SHAPES)
def test_a_new_finger_is_at_the_nearest_point(name: str, kernel: Callable[..., Any]) -> None:
    """Distance, contact point and side: 1e-15 x max(size, |p|) of brute force in long double and of the solid angle.

    Two triangles may be equally near to rounding; then only the distance can be compared.
    """
    (v, f), points = around(name, 200, np.random.default_rng(3))
    size = np.ptp(v, axis=0).max()
    M = flatten(v, f, closed=True)
    ties = 0
    for p in points:
        c, n, gap = Finger(M, kernel=kernel).to(p)
        nearest, distance = brute_force(v, f, p)
        bound = 1e-15 * max(size, float(np.linalg.norm(p)))
        assert abs(float(abs(gap) - distance)) <= bound
        assert (gap < 0) == (winding_number(v, f, p) > 0.5)
        np.testing.assert_allclose(p - c, -gap * n, rtol=0, atol=bound)
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-15)
        off = np.linalg.norm((c - nearest).astype(float))
        ties += off > bound
    assert ties <= 2


def test_a_box_as_a_mesh_is_the_box() -> None:
    """A convex mesh needs no path of its own: outside, contact is that of the closed form; face by face inside.

    Inside, the box frees a finger that is past its face's edge at once, the mesh hands it over to the next face.
    """
    rng = np.random.default_rng(5)
    half = (0.025, 0.02, 0.01)
    finger, face = Finger(flatten(*plate(0.05, 0.04, 0.02), closed=True)), -1
    p, before = np.array([0.04, 0.01, 0.0]), np.zeros(3)
    free = held = 0
    for _ in range(2000):
        p = np.clip(p + rng.normal(size=3) * 0.0008 - 0.01 * p, -0.04, 0.04)
        nearest = closest(BOX, 3, Vector(*half), Vector(*p.tolist()), face, Vector(*before.tolist()))
        face, rest = nearest.face, list(numbers(nearest))[1:]
        c, n, gap = finger.to(p)
        if (np.abs(p) > half).any():
            if finger.mode == FREE and rest[6] > 0:
                free += 1
                np.testing.assert_allclose([*c, *n, gap], rest, rtol=0, atol=1e-12)
                assert gap == pytest.approx(rest[6], abs=1e-16)
        else:
            held += 1
            assert finger.mode == TOUCHING
            axis = int(np.abs(n).argmax())
            assert abs(n[axis]) == 1.0
            assert gap == pytest.approx(np.sign(c[axis]) * p[axis] - half[axis], abs=1e-16)
    assert free > 150
    assert held > 300


def press(frame: Callable[[float], tuple[FloatArray, FloatArray]], kernel: Any, seed: int) -> tuple[int, int, int]:
    """A 1 mm plate in motion, pressed up to 6 mm deep from both sides, sliding at up to 3 m/s.

    Returns ticks in contact, how many of them were held by the wrong side, and in how many force was lost.
    """
    rng = np.random.default_rng(seed)
    M = flatten(*plate(), closed=True)
    ticks = wrong = lost = 0
    for path in range(10):
        up = 1.0 if path % 2 == 0 else -1.0
        finger = Finger(M, kernel=kernel, reach=0.01)
        speed = rng.uniform(-3.0, 3.0, size=2)
        xy = np.zeros(2)
        for k in range(290):
            depth = -0.003 if k < 5 else 0.006 * math.sin(0.05 * k + 0.3) ** 2 + 1e-6
            xy = xy + speed * TICK
            speed = np.where(np.abs(xy) > np.array([0.049, 0.039]), -np.sign(xy) * np.abs(speed), speed)
            own = np.array([*np.clip(xy, [-0.0499, -0.0399], [0.0499, 0.0399]), up * (0.0005 - depth)])
            x, R = frame(k * TICK)
            world = x + R @ own
            c, n, gap = finger.to(R.T @ (world - x))
            if depth > 0:
                ticks += 1
                wrong += n[2] != -up or c[2] != pytest.approx(up * 0.0005, abs=1e-15)
                lost += not abs(gap + depth) < 1e-14
    return ticks, wrong, lost


def still(t: float) -> tuple[FloatArray, FloatArray]:
    return np.zeros(3), np.eye(3)


def flying(t: float) -> tuple[FloatArray, FloatArray]:
    """3 m/s round a circle of 0.3 m, turning at 30 rad/s about an oblique axis: 1.9 m/s more at the corners."""
    a = 10.0 * t
    axis, angle = np.array([1.0, 2.0, -2.0]) / 3.0, 30.0 * t
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    x = 0.3 * np.array([math.cos(a), math.sin(a), 0.0])
    return x, np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


@pytest.mark.parametrize("frame", [still, flying])
def test_a_thin_plate_pressed_six_times_through(frame: Any, kernel: Callable[..., Any]) -> None:
    """Ticks on the wrong side 0, force lost 0; gap = -depth to rounding, whatever the plate does meanwhile."""
    assert press(frame, kernel, 6) == (2850, 0, 0)


def test_a_plate_that_sweeps_over_a_resting_finger() -> None:
    """3 m/s is 3 mm a tick, through a plate of 1 mm: the finger is held by the side that it came from."""
    for way in (1.0, -1.0):
        finger = Finger(flatten(*plate(), closed=True))
        gaps = []
        for k in range(9):
            _, n, gap = finger.to(np.array([0.01, 0.003, way * (0.0115 - 0.003 * k)]))
            gaps.append(gap)
            assert n[2] == -way
        np.testing.assert_allclose(gaps, 0.011 - 0.003 * np.arange(9), atol=1e-15)


def shoot(name: str, count: int, seed: int, kernel: Any) -> tuple[int, int, int]:
    """Segments aimed at edges and corners, to 1e-17 ... 1e-9 m or exactly: how many, how many end inside, leaks.

    The check that would notice a finger inside a closed surface is off.
    """
    rng = np.random.default_rng(seed)
    v, f = SHAPES[name]()
    M = flatten(v, f, closed=True)
    MeshTree(M).closed = False
    pick, k = f[rng.integers(len(f), size=count)], rng.integers(3, size=count)
    a, b = v[pick[np.arange(count), k]], v[pick[np.arange(count), (k + 1) % 3]]
    target = a + np.where(rng.random(count) < 0.4, 0.0, rng.random(count))[:, None] * (b - a)
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    miss = np.where(rng.random(count) < 0.5, 0.0, 10.0 ** rng.uniform(-17, -9, count))
    off = rng.normal(size=(count, 3)) * miss[:, None]
    start = target + off - way * 10 ** rng.uniform(-6, -1.3, size=(count, 1))
    end = target + off + way * 10 ** rng.uniform(-8, -1.5, size=(count, 1))
    shots = within = leaks = 0
    for p, q in zip(start, end, strict=True):
        if winding_number(v, f, p) > 0.5:
            continue
        finger = Finger(M, kernel=kernel)
        finger.to(p)
        gap = finger.to(q)[2]
        shots += 1
        if abs(gap) > 1e-12 and winding_number(v, f, q) > 0.5:
            within += 1
            leaks += finger.mode == FREE
    return shots, within, leaks


@pytest.mark.parametrize("name", SHAPES)
def test_nothing_leaks_at_edges_and_corners(name: str, kernel: Callable[..., Any]) -> None:
    shots, within, leaks = shoot(name, 400, 7, kernel)
    assert leaks == 0
    assert shots > 150
    assert within > 50


@pytest.mark.parametrize("name", SHAPES)
def test_a_free_finger_is_never_inside(name: str, kernel: Callable[..., Any]) -> None:
    """Paths in, along and out of each shape, 0.1 to 30 mm a step, with the check that would notice switched off."""
    rng = np.random.default_rng(8)
    (v, f), _ = around(name, 1, rng)
    M = flatten(v, f, closed=True)
    MeshTree(M).closed = False
    low, high = v.min(axis=0), v.max(axis=0)
    held = 0
    for _ in range(6):
        p = high + 0.01
        finger = Finger(M, kernel=kernel, reach=0.01)
        finger.to(p)
        aim = p
        for k in range(60):
            if k % 10 == 0:
                aim = surface_point(v, f, 1, rng)[0]
                aim = aim + 0.1 * (0.5 * (low + high) - aim)
            p = p + (aim - p) * rng.uniform(0, 0.5) + rng.normal(size=3) * 10 ** rng.uniform(-4, -2)
            finger.to(p)
            if finger.mode == TOUCHING:
                held += 1
            elif brute_force(v, f, p)[1] > 1e-12:
                assert winding_number(v, f, p) < 0.5
    assert held >= 5  # a needle is hard to hit


def test_the_hollow_of_a_mug(kernel: Callable[..., Any]) -> None:
    """From the open top to the inner wall, 3 mm thick, and pressed through it: held from inside, in each direction."""
    M = flatten(*mug(), closed=True)
    for angle in np.linspace(0, 2 * np.pi, 25):
        out = np.array([math.cos(angle), math.sin(angle), 0.0])
        finger = Finger(M, kernel=kernel)
        for z in np.linspace(0.06, 0.0, 25):
            assert finger.to(np.array([0.0, 0.0, z]))[2] > 0
        for r in np.linspace(0.0, 0.0365, 25):
            assert finger.to(r * out)[2] > 0
        for r in np.linspace(0.0371, 0.05, 30):  # the wall ends at 40 mm
            _, n, gap = finger.to(r * out)
            assert n @ out > 0.99
            assert gap == pytest.approx(0.037 - r, abs=3e-5)  # 96 facets
        assert finger.to(np.array([0.0, 0.0, 0.0]))[2] == pytest.approx(0.037, abs=3e-5)


def test_in_a_concave_corner_the_contact_point_goes_where_both_walls_end() -> None:
    """Pressed into the inner corner of an L from outside: nearest is the edge, the force points out of both arms."""
    finger = Finger(flat("ell"))
    finger.to(np.array([0.021, 0.0215, 0.01]))
    c, n, gap = finger.to(np.array([0.019, 0.0185, 0.01]))
    assert gap < 0
    np.testing.assert_allclose(c, [0.02, 0.02, 0.01], atol=1e-17)
    np.testing.assert_allclose(n, np.array([-1, -1.5, 0]) / math.hypot(1, 1.5), atol=1e-12)
    assert gap == pytest.approx(-math.hypot(0.001, 0.0015), rel=1e-12)


def test_released_and_caught_in_the_same_sample() -> None:
    """Between two arms 20 mm apart: off one and 3 mm deep into the other within one tick."""
    v, f = SHAPES["ell"]()
    v2 = v.copy()
    v2[:, :2] = np.array([0.1, 0.1]) - v[:, :2]  # turned by half a turn: its arms face those of the first
    finger = Finger(flatten(np.vstack([v, v2]), np.vstack([f, f + len(v)]), closed=True))
    finger.to(np.array([0.05, 0.021, 0.01]))
    assert finger.to(np.array([0.05, 0.018, 0.01]))[2] == pytest.approx(-0.002, rel=1e-12)
    c, n, gap = finger.to(np.array([0.05, 0.083, 0.01]))
    np.testing.assert_allclose([*c, *n, gap], [0.05, 0.08, 0.01, 0, 1, 0, -0.003], atol=1e-16)


def test_a_shell_is_touched_from_its_front_and_left_over_its_border(kernel: Callable[..., Any]) -> None:
    M = flatten(*sheet(), closed=False)
    finger = Finger(M, kernel=kernel)
    assert finger.to(np.array([0.01, 0.005, 0.01]))[2] > 0
    c, n, gap = finger.to(np.array([0.01, 0.005, -0.004]))
    assert gap < -0.003
    assert n[2] < -0.9
    assert finger.to(np.array([0.06, 0.005, -0.004]))[2] > 0.009  # past the border, 50 mm from the middle
    assert finger.mode == FREE
    assert finger.to(np.array([0.01, 0.005, -0.004]))[2] > 0.003  # behind it
    c, n, gap = finger.to(np.array([0.01, 0.005, -0.001]))
    np.testing.assert_allclose(np.array([0.01, 0.005, -0.001]) - c, -gap * n, atol=1e-16)
    assert n[2] > 0.9
    assert finger.to(np.array([0.01, 0.005, 0.01]))[2] > 0.009  # through its back, unhindered


def test_reach_saves_work_and_changes_nothing_within_it() -> None:
    """Beyond it the gap is one that is exceeded; within it everything is the same to the last bit."""
    M = flat("bumpy")
    rng = np.random.default_rng(9)
    always, near = Finger(M), Finger(M, reach=0.005)
    p = np.array([0.07, 0.0, 0.0])
    beyond = skipped = within = 0
    for k in range(800):
        goal = np.array([math.cos(0.02 * k), math.sin(0.02 * k), 0.3]) * (0.045 + 0.02 * math.cos(0.031 * k))
        p = goal + rng.normal(size=3) * 0.0002
        safe = near.record.safe
        c, n, gap = always.to(p)
        found = near.to(p)
        assert always.mode == near.mode
        if gap > 0.005:
            beyond += 1
            skipped += near.record.safe < safe
            assert 0.005 < found[2] <= gap * (1 + 1e-14)
        else:
            within += 1
            np.testing.assert_allclose(c, found[0], rtol=0, atol=1e-16)
            np.testing.assert_allclose(n, found[1], rtol=0, atol=1e-13)
            assert gap == pytest.approx(found[2], abs=1e-16)
    assert within > 300
    assert skipped > 0.5 * beyond > 100


def test_outside_the_gap_changes_no_faster_than_the_finger_moves(kernel: Callable[..., Any]) -> None:
    """A distance is 1-Lipschitz, in front of concave shapes too."""
    for name in ("mug", "ell", "bumpy"):
        rng = np.random.default_rng(10)
        finger = Finger(flat(name), kernel=kernel)
        p = np.array([0.0, 0.0, 0.08])
        gap = finger.to(p)[2]
        for _ in range(800):
            q = np.clip(p + rng.normal(size=3) * 0.003, [-0.09, -0.06, -0.06], [0.09, 0.06, 0.09])
            before, new = gap, finger.to(q)[2]
            if min(before, new) > 0:
                assert abs(new - before) <= np.linalg.norm(q - p) * (1 + 1e-12) + 1e-16
            p, gap = q, new


def test_sliding_over_a_bumpy_sphere_the_contact_point_is_the_nearest_around() -> None:
    """1 mm deep, at 0.5 m/s: of the triangles at the contact point none has a nearer point.

    Seen from inside, others may: every facet has its own foot point. Here they are up to a tenth nearer.
    """
    v, f = bumpy_sphere(4)
    finger = Finger(flatten(v, f, closed=True))
    for k in range(150):
        a = 0.0125 * k
        way = np.array([math.cos(a), math.sin(a) * math.cos(0.3 * a), math.sin(a) * math.sin(0.3 * a)])
        if k == 0:
            finger.to(0.05 * way)
            skin = finger.to(0.03 * way)[0]
        p = way * (np.linalg.norm(skin) - 0.001)
        skin, _, gap = finger.to(p)
        assert finger.mode == TOUCHING
        at_skin = [row for row in f[near_rows(v, f, skin)] if brute_force(v, row[None], skin)[1] < 1e-15]
        assert at_skin
        assert -gap == pytest.approx(float(brute_force(v, np.array(at_skin), p)[1]), rel=1e-12)
        assert 1.0 - 1e-12 < -gap / float(brute_force(v, f, p)[1]) < 1.1


def near_rows(v: FloatArray, f: NDArray[np.intp], p: FloatArray) -> NDArray[np.intp]:
    """Triangles whose box is at p."""
    corners = v[f]
    return np.flatnonzero(((corners.min(axis=1) <= p + 1e-12) & (corners.max(axis=1) >= p - 1e-12)).all(axis=1))


def test_compiled_and_interpreted_are_the_same_bit_for_bit(kernel: Callable[..., Any]) -> None:
    """And so are two runs, and a mesh and a finger that stand elsewhere in their arrays."""
    for name in ("ell", "bumpy", "mug"):
        rng = np.random.default_rng(11)
        M = flat(name)
        fingers = [
            Finger(M, reach=0.01), Finger(M, reach=0.01, m=0, o=0), Finger(M, kernel=kernel, reach=0.01),
            Finger(M, kernel=kernel, reach=0.01, m=8, o=20),
        ]  # fmt: skip
        p = np.array([0.07, 0.05, 0.03])
        for _ in range(400):
            p = np.clip(p + rng.normal(size=3) * 0.003 - 0.03 * p, -0.08, 0.08)
            found = [np.hstack(finger.to(p)).tobytes() for finger in fingers]
            assert len(set(found)) == 1
            assert len({finger.state[finger.o :].tobytes() for finger in fingers}) == 1
        assert all(np.isnan(finger.state[: finger.o]).all() for finger in fingers)


def test_a_new_finger_inside_is_at_the_side_that_is_nearest() -> None:
    finger = Finger(flatten(*plate(), closed=True))
    assert finger.mode == NEW
    c, n, gap = finger.to(np.array([0.01, 0.0, -0.0002]))
    np.testing.assert_allclose([*c, *n, gap], [0.01, 0, -0.0005, 0, 0, 1, -0.0003], atol=1e-18)
    assert finger.mode == TOUCHING
    assert finger.record.last.x == 0.01
    deep = Finger(flatten(*plate(0.1, 0.1, 0.1), closed=True), reach=0.0)
    assert deep.to(np.array([0.001, 0.0, 0.0]))[2] == pytest.approx(-0.049, rel=1e-15)


def test_the_tree_holds_every_triangle_once_and_in_its_box() -> None:
    for name in ("plate", "needle", "bumpy"):
        v, f = SHAPES[name]()
        order, boxes, skip, first = tree.box_tree(v[f])
        assert sorted(order) == list(range(len(f)))
        corners = v[f][order]
        for i in range(len(boxes) - 1):
            held = corners[first[i] : first[skip[i]]]
            assert len(held) > 0
            np.testing.assert_array_equal(boxes[i], [*held.min(axis=(0, 1)), *held.max(axis=(0, 1))])
            assert skip[i] > i + 1 or len(held) <= tree.LEAF


def test_pseudonormals() -> None:
    """A cube's corner points along its diagonal however its faces are cut; a face's normal is one to the last digit."""
    v, f = plate(1.0, 1.0, 1.0)
    M = flatten(v, f, closed=True)
    rows = MeshTree(M).vertices.array(Vertex.pseudonormal)
    np.testing.assert_allclose(rows, np.sign(v) / math.sqrt(3), atol=1e-15)
    normals = tree.face_normals(np.random.default_rng(12).normal(size=(100, 3, 3)))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=3e-16)


def test_a_finger_that_is_nowhere_ends(kernel: Callable[..., Any]) -> None:
    """NaN in, no endless walk; the coupling refuses such a finger before it comes here."""
    for run in (None, kernel):
        for value in (math.nan, math.inf):
            finger = Finger(flat("ell"), kernel=run)
            finger.to(np.full(3, value))
            finger.to(np.full(3, value))


def test_kernels_do_not_know_numpy() -> None:
    assert not any(hasattr(module, "np") for module in (ball, boxes, mesh_tree, walk))
