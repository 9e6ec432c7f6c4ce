"""Balls on meshes against the closed form and brute force in long double; creases, thin plates, shells."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.compile.records import numbers
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form.proxy import BOX, closest_to_ball
from graspfx.surfaces.triangles.ball import ball_contact
from graspfx.surfaces.triangles.mesh import STATE, Mesh, make_mesh, new_fingers
from graspfx.surfaces.triangles.mesh_tree import TOUCHING, MeshFinger, MeshTree
from graspfx.surfaces.triangles.tree import flatten
from tests.support.brute_force import brute_force
from tests.support.meshes import SHAPES, ell, flat, plate, sheet

FloatArray = np.ndarray
R = 0.004  # radius of the balls [m]


class Ball:
    """A ball on a mesh: its contact, its proxy and whether it is held, for one centre after the other."""

    def __init__(self, M: FloatArray, radius: float = R, reach: float = np.inf) -> None:
        self.mesh, self.radius = MeshTree(memoryview(M)), radius
        self.record = MeshFinger(memoryview(np.zeros(STATE)))
        self.record.reach = reach

    def at(self, g: FloatArray) -> FloatArray:
        """Contact point, normal and gap of a centre at g."""
        return np.array(
            list(numbers(ball_contact(self.mesh, self.record, self.radius, Vector(*np.asarray(g).tolist()))))[1:]
        )

    def along(self, path: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """e = g - q, (k, 3), gaps and which are held."""
        rows, held = [], []
        for g in path:
            rows.append(self.at(g))
            held.append(self.record.mode == TOUCHING)
        found = np.array(rows)
        return path - (found[:, :3] - self.radius * found[:, 3:6]), found[:, 6], np.array(held)

    @property
    def proxy(self) -> FloatArray:
        return np.array(list(numbers(self.record.last)))


def wandering(rng: np.random.Generator, half: FloatArray, steps: int) -> FloatArray:
    """A centre that comes to a face from outside, goes deep in, wanders over edges and turns back."""
    axis, side = rng.integers(3), rng.choice([-1.0, 1.0])
    p = rng.uniform(-0.8, 0.8, 3) * half
    p[axis] = side * (half[axis] + R + 0.003)
    v = np.zeros(3)
    v[axis] = -1e-4 * side
    path = [p]
    for _ in range(steps):
        v = v + rng.normal(size=3) * 3e-5
        p = p + v
        if side * p[axis] < half[axis] - 0.012:
            v[axis] = 2e-4 * side
        path.append(p)
    return np.array(path)


def test_on_a_box_of_triangles_it_is_the_closed_form() -> None:
    """4000 positions, a third of them in contact, to 12 mm deep, over faces, diagonals, edges and corners: 1e-15 m."""
    half = np.array([0.05, 0.04, 0.03])
    M = flatten(*plate(*(2.0 * half)), closed=True)
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(20):
        path = wandering(rng, half, 200)
        e, gaps, _ = Ball(M).along(path)
        face, c = -1, np.zeros(3)
        for g, ours, gap in zip(path, e, gaps, strict=True):
            found = closest_to_ball(BOX, 3, Vector(*half), R, Vector(*g), face, Vector(*c))
            face, c, n = found.face, np.array(list(numbers(found.point))), np.array(list(numbers(found.normal)))
            np.testing.assert_allclose(ours, g - c + R * n, atol=1e-15)
            assert gap == pytest.approx(found.gap, abs=1e-15)
            held += gap < 0.0
    assert held > 1400


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_the_proxy_is_never_nearer_than_the_radius(name: str) -> None:
    """Wherever the centre goes, through walls too: by brute force in long double, to 1e-15 m."""
    v, f = SHAPES[name]()
    rng = np.random.default_rng(3)
    b = Ball(flat(name))
    low, high = v.min(axis=0) - 0.01, v.max(axis=0) + 0.01
    g = goal = high + 0.005
    for k in range(240):
        goal = rng.uniform(low, high) if k % 30 == 0 else goal
        g = g + (goal - g) * 0.1 + rng.normal(size=3) * 1e-4
        b.at(g)
        if k % 4 == 0:
            assert float(brute_force(v, f, b.proxy)[1]) >= R - 1e-15, k


def test_in_a_crease_the_force_does_not_jump() -> None:
    """Across the diagonal of a right angle, 1.5 mm deep in both walls, by 1 um a sample.

    The way to the nearest wall turns by 90 degrees in one of them, which is 2.1 mm; the proxy's moves by 1 um.
    """
    t = np.linspace(-1e-3, 1e-3, 2001)
    corner = np.array([0.02, 0.02, 0.015])
    path = corner + np.stack([0.0025 + t, 0.0025 - t, 0.0 * t], axis=1)
    start = np.linspace(corner + 0.02, path[0], 50)
    M = flatten(*ell(), closed=True)
    e, _, held = Ball(M).along(np.vstack([start, path]))
    assert held[50:].all()
    assert np.abs(np.diff(e[50:], axis=0)).max() < 1.001e-6
    np.testing.assert_allclose(e[1050], [-0.0015, -0.0015, 0.0], atol=1e-15)

    S = new_fingers(1)
    mesh = make_mesh(*ell())
    nearest = np.array([(R - c.gap[0]) * c.normal[0] for c in (mesh.contact(g[None], S) for g in path)])
    assert np.linalg.norm(np.diff(nearest, axis=0), axis=1).max() == pytest.approx(2.12e-3, rel=0.01)


def test_it_never_pops_through_a_thin_plate() -> None:
    """A plate of 1 mm, the centre up to 20 mm beyond its far side, moving sideways: held by the side it came from."""
    M = flatten(*plate(), closed=True)
    t = np.linspace(0.0, 1.0, 400)
    path = np.stack([0.03 * np.sin(9.0 * t), 0.02 * np.cos(7.0 * t), 0.006 - 0.026 * np.sin(np.pi * t)], axis=1)
    e, gaps, held = Ball(M).along(path)
    top = 0.0005 + R
    depth = np.minimum(path[:, 2] - top, 0.0)
    np.testing.assert_allclose(e[held][:, 2], depth[held], atol=1e-16)
    np.testing.assert_allclose(e[held][:, :2], 0.0, atol=1e-15)
    assert np.array_equal(held, depth < 0.0) and gaps.min() == pytest.approx(-0.020 - top, abs=1e-4)


def test_it_goes_round_an_edge_and_is_free_again() -> None:
    """Pressed on the top of a plate, past its border and down: the way out is a quarter turn about the edge."""
    M = flatten(*plate(), closed=True)
    path = np.vstack([
        np.linspace([0.03, 0.0, 0.006], [0.03, 0.0, 0.0025], 30),
        np.linspace([0.03, 0.0, 0.0025], [0.056, 0.0, 0.0025], 120),
        np.linspace([0.056, 0.0, 0.0025], [0.056, 0.0, -0.01], 60),
    ])  # fmt: skip
    e, gaps, held = Ball(M).along(path)
    assert held[40] and not held[-1] and gaps[-1] > 0.0
    steps, moved = np.abs(np.diff(e, axis=0)).max(axis=1), np.abs(np.diff(path, axis=0)).max(axis=1)
    contact = held[1:] & held[:-1]
    assert (steps[contact] <= 3.0 * moved[contact]).all()


def test_a_slot_narrower_than_the_ball_keeps_it_out() -> None:
    """Two walls 6 mm apart, a ball of 8 mm pushed 10 mm in from above: it stays on both rims, and is pushed back up."""
    walls = [plate(0.02, 0.02, 0.02), plate(0.02, 0.02, 0.02)]
    v = np.vstack([walls[0][0] + [0.013, 0.0, 0.0], walls[1][0] - [0.013, 0.0, 0.0]])
    M = flatten(v, np.vstack([walls[0][1], walls[1][1] + 8]), closed=True)
    path = np.linspace([0.0, 0.0, 0.02], [0.0005, 0.0, 0.0], 100)
    e, gaps, held = Ball(M).along(path)
    sits = 0.01 + np.sqrt(R**2 - 0.003**2)  # above the rims, 3 mm to each side
    np.testing.assert_allclose(path[held][-1] - e[held][-1], [0.0, 0.0, sits], atol=1e-12)
    assert held[-1] and gaps[-1] == pytest.approx(-np.hypot(sits, 0.0005), abs=1e-12)


def test_a_shell_is_touched_from_its_front_only() -> None:
    M = flatten(*sheet(), closed=False)
    down = np.linspace([0.01, 0.0, 0.02], [0.01, 0.0, -0.01], 100)
    e, _, held = Ball(M).along(down)
    assert held[-1] and np.linalg.norm(e[-1]) > 0.013
    e, gaps, held = Ball(M).along(down[::-1])
    assert not held[-1] and (gaps[~held] >= 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(e[~held], axis=1), gaps[~held], atol=1e-15)  # no displacement, no force
    assert np.abs(e[held]).max(initial=0.0) < 1e-3  # once it is off, it may touch again as it leaves


def test_far_away_it_knows_a_gap_that_it_exceeds() -> None:
    """With a reach of 10 mm and the radius: beyond it a lower bound, within it the distance."""
    M = flatten(*plate(), closed=True)
    b = Ball(M, reach=0.01 + R)
    for z in np.linspace(0.2, 0.006, 300):
        gap = b.at(np.array([0.01, 0.0, z]))[6]
        true = z - 0.0005 - R
        assert gap <= true + 1e-15 and (true > 0.0102 or gap == pytest.approx(true, abs=1e-15))


def test_a_leap_that_takes_longer_than_a_sample_makes_no_force() -> None:
    """70 mm along the plate in one sample: the proxy is there some samples later, and e is zero until then."""
    M = flatten(*plate(), closed=True)
    b = Ball(M)
    b.at(np.array([-0.04, 0.0, 0.0046]))
    far = np.array([0.04, 0.0, 0.0046])
    for _ in range(5):
        found = b.at(far)
        np.testing.assert_allclose(far - (found[:3] - R * found[3:6]), found[6] * -found[3:6], atol=1e-15)
        assert found[6] >= 0.0
    np.testing.assert_array_equal(b.proxy, far)


def test_mesh_contact_takes_a_radius() -> None:
    mesh: Mesh = make_mesh(*plate(0.1, 0.08, 0.06))
    state = new_fingers(2)
    points = np.array([[0.0, 0.0, 0.036], [0.06, 0.0, 0.0]])
    assert mesh.contact(points, state, radius=R).gap == pytest.approx([0.002, 0.006])
    found = mesh.contact(points - [[0.0, 0.0, 0.01], [0.015, 0.0, 0.0]], state, radius=R)
    assert found.gap == pytest.approx([-0.008, -0.009]) and found.normal[1] == pytest.approx([-1.0, 0.0, 0.0])
