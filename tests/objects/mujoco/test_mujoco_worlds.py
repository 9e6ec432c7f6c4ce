"""MuJoCo's worlds: planes and lines, locked freedoms among contacts, Coulomb's cone, hollow meshes, memory."""

from __future__ import annotations

import gc
import math
import tracemalloc
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("mujoco", reason="MuJoCo is not installed")

from graspfx.errors import InputError
from graspfx.objects import integrators as at
from graspfx.objects.body import fill_body
from graspfx.objects.mujoco.geometry import is_hollow, pieces
from graspfx.objects.mujoco.mujoco import MujocoBody
from graspfx.objects.mujoco.mujoco_world import MujocoWorld
from graspfx.objects.surroundings import Meeting, Member, Obstacle, place_obstacle
from graspfx.surfaces.closed_form.shape import Box, Capsule, Ellipsoid, HalfSpace, Sphere
from tests.support.meshes import plate

Array = NDArray[np.float64]
G, M, MU = 9.81, 0.1, 0.5
FLOOR = place_obstacle("floor", HalfSpace((0.0, 0.0, 1.0)), 3)
GROUND = place_obstacle("ground", HalfSpace((0.0, 1.0)), 2)


def member(d: int, shape: Any, **given: Any) -> Member:
    state = np.zeros(at.SIZE)
    inertia = shape.inertia(M, d) if d > 1 else None
    fill_body(state, dimensions=d, mass=M, inertia=inertia, **given)
    return Member(state, shape)


def world(*members: Member, obstacles: tuple[Obstacle, ...] = (), **meeting: Any) -> MujocoWorld:
    return MujocoWorld(members, obstacles, Meeting(**({"friction": MU} | meeting)))


def run(given: MujocoWorld, T: float, seconds: float) -> None:
    for _ in range(round(seconds / T)):
        given.step(T)


def position(one: Member) -> Array:
    return one.state[at.POSITION : at.POSITION + 3]


def velocity(one: Member) -> Array:
    return one.state[at.VELOCITY : at.VELOCITY + 3]


def test_a_rectangle_in_the_plane_rests_slides_and_tips() -> None:
    """It slows by mu g, stays in the plane, and tips over a corner under more than m g w/h at its centre."""
    box = Box((0.04, 0.04))
    sliding = member(2, box, position=(0.0, 0.02), gravity=(0.0, -G), velocity=(0.5, 0.0))
    run(world(sliding, obstacles=(GROUND,)), 0.001, 0.08)
    np.testing.assert_allclose(velocity(sliding)[:2], [0.5 - MU * G * 0.08, 0.0], rtol=0.0, atol=1e-5)
    assert velocity(sliding)[2] == position(sliding)[2] == 0.0
    for share, tips in ((0.98, False), (1.02, True)):
        pushed = member(2, box, position=(0.0, 0.02), gravity=(0.0, -G))
        given = world(pushed, obstacles=(GROUND,), friction=3.0)
        pushed.state[at.FORCE] = share * M * G
        run(given, 0.001, 0.5)
        assert (abs(pushed.state[at.ANGLE]) > 0.01) == tips


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.2, 0.5 * math.pi])
def test_shapes_in_the_plane_rest_at_their_lowest_point_at_any_angle(angle: float) -> None:
    """With its rotation locked the centre rests at the support function of the shape, in closed form."""
    r, half, a, b = 0.01, 0.02, 0.03, 0.01
    heights = (
        (Box((2.0 * a, 2.0 * b)), a * math.sin(angle) + b * math.cos(angle)),
        (Capsule(r, 2.0 * half), r + half * math.sin(angle)),
        (Ellipsoid((a, b)), math.hypot(a * math.sin(angle), b * math.cos(angle))),
    )
    for shape, height in heights:
        one = member(2, shape, position=(0.0, height), orientation=angle, gravity=(0.0, -G), free=(1, 1, 0))
        run(world(one, obstacles=(GROUND,)), 0.001, 0.2)
        np.testing.assert_allclose(position(one), [0.0, height, 0.0], rtol=0.0, atol=1e-6)


def test_a_disc_rests_on_an_upright_capsule_in_the_plane() -> None:
    post = place_obstacle("post", Capsule(0.01, 0.04), 2, (0.0, 0.0), 0.5 * math.pi)
    disc = member(2, Sphere(0.02), position=(0.0, 0.05), gravity=(0.0, -G), free=(0, 1, 0))
    run(world(disc, obstacles=(post,)), 0.001, 0.2)
    np.testing.assert_allclose(position(disc), [0.0, 0.05, 0.0], rtol=0.0, atol=1e-6)


def test_ellipses_in_the_plane_meet_at_their_ends() -> None:
    """With restitution 1 equal bodies exchange their velocities where the gap between their long ends is gone."""
    left = member(2, Ellipsoid((0.02, 0.01)), position=(0.0, 0.0), velocity=(1.0, 0.0))
    right = member(2, Ellipsoid((0.02, 0.01)), position=(0.05, 0.0))
    given = world(left, right, restitution=1.0)
    run(given, 0.001, 0.008)
    np.testing.assert_allclose(velocity(right)[0], 0.0, rtol=0.0, atol=1e-9)
    run(given, 0.001, 0.05)
    np.testing.assert_allclose([velocity(left)[0], velocity(right)[0]], [0.0, 1.0], rtol=0.0, atol=1e-3)


def test_discs_in_the_plane_and_beads_on_a_line_meet_head_on() -> None:
    """With restitution 1 equal bodies exchange their velocities."""
    for d, shape in ((2, Sphere(0.01)), (1, Sphere(0.01)), (1, Box((0.02,)))):
        left = member(d, shape, position=np.zeros(d), velocity=np.eye(d)[0])
        right = member(d, shape, position=0.05 * np.eye(d)[0])
        run(world(left, right, restitution=1.0), 0.001, 0.1)
        np.testing.assert_allclose([velocity(left)[0], velocity(right)[0]], [0.0, 1.0], rtol=0.0, atol=1e-3)


def test_a_bead_on_a_line_rests_on_a_wall() -> None:
    bead = member(1, Box((0.02,)), position=(0.011,), gravity=(-G,))
    given = world(bead, obstacles=(place_obstacle("wall", HalfSpace((1.0,)), 1),))
    run(given, 0.001, 0.5)
    np.testing.assert_allclose(position(bead), [0.01, 0.0, 0.0], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(given.contact_wrench(0)[:3], [M * G, 0.0, 0.0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    "free", [(1, 0, 1, 0, 1, 0), (1, 0, 1, 0, 0, 0), (1, 1, 1, 0, 0, 0), (1, 1, 0, 1, 1, 1), (0, 0, 1, 0, 0, 0)]
)
def test_locked_freedoms_bear_what_a_contact_gives_them(free: tuple[int, ...]) -> None:
    """A capsule on its way across a floor, pushed sideways and turned: what is locked is as it was, to the bit."""
    q = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
    one = member(3, Capsule(0.01, 0.04), position=(0.0, 0.0, 0.01), orientation=q, gravity=(0.0, 0.0, -G), free=free)
    first = one.state.copy()
    given = world(one, obstacles=(FLOOR,), friction=0.2)
    one.state[at.FORCE : at.FORCE + 3] = 0.5, 0.5, 0.0
    one.state[at.MOMENT : at.MOMENT + 3] = 1e-3, -1e-3, 1e-3
    run(given, 0.001, 0.1)
    locked = np.flatnonzero(np.array(free) == 0)
    shifts, turns = locked[locked < 3], locked[locked >= 3] - 3
    np.testing.assert_array_equal(position(one)[shifts], first[at.POSITION + shifts])
    np.testing.assert_array_equal(one.state[at.ANGULAR_VELOCITY + turns], 0.0)
    if free[0]:
        rolls = bool(free[4])  # a hoop's inertia more slows what rolls
        slide = (0.5 - 0.2 * M * G * free[2]) / M * 0.1
        assert velocity(one)[0] > 0.5 * slide if rolls else velocity(one)[0] == pytest.approx(slide, rel=0.5)


def test_two_of_three_rotations_are_refused_among_contacts_only() -> None:
    free = (1, 1, 1, 1, 1, 0)
    with pytest.raises(InputError, match="none, one or three for a body with contacts"):
        world(member(3, Box((0.05, 0.04, 0.03)), free=free), obstacles=(FLOOR,))
    state = member(3, Box((0.05, 0.04, 0.03)), free=free).state
    body = MujocoBody(state)
    for _ in range(100):
        state[at.MOMENT : at.MOMENT + 3] = 1e-5, 2e-5, 3e-5
        body.step(0.001)
    assert state[at.ANGULAR_VELOCITY + 2] == 0.0 and state[at.ANGULAR_VELOCITY] > 0.0


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.0])
def test_friction_is_coulomb_s_round_cone_and_a_slide_does_not_lift(angle: float) -> None:
    """Decelerates by mu g straight on, to 1e-4, and stays on the floor: MuJoCo's own law hops 2 mm high."""
    along = np.array([math.cos(angle), math.sin(angle), 0.0])
    shape = Box((0.05, 0.05, 0.05))
    one = member(3, shape, position=(0.0, 0.0, 0.025), gravity=(0.0, 0.0, -G), velocity=0.5 * along)
    given, highest = world(one, obstacles=(FLOOR,)), 0.0
    for _ in range(80):
        given.step(0.001)
        highest = max(highest, position(one)[2] - 0.025)
    np.testing.assert_allclose(velocity(one), (0.5 - MU * G * 0.08) * along, rtol=0.0, atol=5e-5)
    assert highest < 1e-7


def test_without_friction_nothing_is_held() -> None:
    one = member(3, Box((0.05, 0.05, 0.05)), position=(0.0, 0.0, 0.025), gravity=(0.0, 0.0, -G), velocity=(0.1, 0, 0))
    run(world(one, obstacles=(FLOOR,), friction=0.0), 0.001, 0.1)
    np.testing.assert_allclose(velocity(one), [0.1, 0.0, 0.0], rtol=0.0, atol=1e-5)


RING = [(0.015, 0.0), (0.04, 0.0), (0.04, 0.04), (0.015, 0.04)]  # radius and height of a ring's profile


def ring(sections: int = 24) -> tuple[Array, NDArray[np.intp]]:
    """A ring about z with a hole of 30 mm."""
    angles = 2.0 * np.pi * np.arange(sections) / sections
    vertices = np.array([[r * math.cos(a), r * math.sin(a), z] for a in angles for r, z in RING])
    faces = []
    for k in range(sections):
        for j in range(4):
            a, b = 4 * k + j, 4 * k + (j + 1) % 4
            c, d = (4 * (k + 1) + (j + 1) % 4) % (4 * sections), (4 * (k + 1) + j) % (4 * sections)
            faces += [(a, d, c), (a, c, b)]
    return vertices, np.array(faces)


def test_a_hollow_mesh_is_told_from_a_convex_one_and_cut_into_tetrahedra_within_it() -> None:
    vertices, faces = ring()
    corners = vertices[faces]
    volume = float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0)
    assert volume > 0.0 and is_hollow(vertices, faces)
    assert not is_hollow(*plate(0.05, 0.05, 0.05))
    cut = list(pieces(vertices, faces))
    assert len(cut) == len(faces)
    for points in cut:
        below = points[3]
        radius = math.hypot(below[0], below[1])
        assert 0.0149 < radius < 0.04 and 0.0 < below[2] < 0.04
        assert np.linalg.det(points[:3] - below) > 0.0


def test_a_mesh_of_too_many_triangles_is_refused_by_name() -> None:
    vertices, faces = ring(700)
    with pytest.raises(InputError, match="at most 5000 with MuJoCo"):
        list(pieces(vertices, faces))


def test_a_flat_body_is_taken_though_rounding_breaks_the_rule_of_its_moments() -> None:
    """A plate without thickness: one moment is the sum of the others."""
    a, b = 1.1e-5, 2.3e-5
    state = np.zeros(at.SIZE)
    fill_body(state, dimensions=3, mass=M, inertia=(a, b, (a + b) * (1.0 + 5e-10)), angular_velocity=(1.0, 0.0, 0.0))
    body = MujocoBody(state)
    body.step(0.001)
    assert state[at.ANGULAR_VELOCITY] == pytest.approx(1.0)


def test_fast_turns_are_followed() -> None:
    """300 degrees a step, which PyBullet would cut short."""
    state = np.zeros(at.SIZE)
    fill_body(state, dimensions=2, mass=1.0, inertia=1.0, angular_velocity=5.0 / 0.005)
    body = MujocoBody(state)
    for _ in range(10):
        body.step(0.005)
    assert state[at.ANGLE] == pytest.approx(50.0, rel=1e-12)


def test_what_diverges_is_told_and_leaves_no_file(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond 1e10 MuJoCo would begin anew, and write a log where it stands."""
    monkeypatch.chdir(tmp_path)
    state = np.zeros(at.SIZE)
    fill_body(state, dimensions=1, mass=1.0, velocity=[9e9])
    body = MujocoBody(state)
    state[at.FORCE] = 1e12
    with pytest.raises(InputError, match="out of range"):
        body.step(0.01)
    assert list(tmp_path.iterdir()) == []


def test_worlds_are_given_back() -> None:
    """Thirty worlds of their own leave no Python memory behind, nor files or processes."""
    for _ in range(3):
        world(member(2, Box((0.04, 0.04)), position=(0.0, 0.02)), obstacles=(GROUND,)).step(0.001)
    gc.collect()
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(30):
        world(member(2, Box((0.04, 0.04)), position=(0.0, 0.02)), obstacles=(GROUND,)).step(0.001)
    gc.collect()
    left = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert left < 60_000  # the binding itself remembers some 100 bytes of each
