"""Native bodies on fixed planes: rest, sliding, tipping and rolling in closed form; momentum, energy, free flight."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.compile.records import size_for
from graspfx.errors import InputError
from graspfx.objects import integrators as at
from graspfx.objects.body import INTEGRATORS, NativeBody, fill_body
from graspfx.objects.body_state import BodyState
from graspfx.objects.floor import rest
from graspfx.objects.floor.floor import FloorBody, clearance, features, hull_points
from graspfx.objects.floor.planes import MOST, FloorState, lowest, thin
from graspfx.objects.surroundings import Meeting, Member, Obstacle, place_obstacle
from graspfx.spatial import Matrix, Vector
from graspfx.surfaces.closed_form.shape import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Plane, Sphere
from graspfx.surfaces.triangles.mesh import make_mesh
from tests.support.meshes import plate

Array = NDArray[np.float64]
G, M, K, MU = 9.81, 0.1, 1e5, 0.5
CUBE = Box((0.05, 0.05, 0.05))


def made(
    shape: Any, *, d: int = 3, normal: Any = None, walls: tuple[Obstacle, ...] = (), mu: float = MU, **given: Any
) -> tuple[Array, FloorBody]:
    """A body of 0.1 kg over a half-space through the origin under gravity along the last axis."""
    state = np.zeros(at.SIZE)
    gravity = np.zeros(d)
    gravity[-1] = -G
    inertia = {1: None, 2: shape.inertia(M, d)[2], 3: shape.inertia(M, d)}[d]
    fill_body(state, **({"dimensions": d, "mass": M, "inertia": inertia, "gravity": gravity} | given))
    floor = place_obstacle("floor", HalfSpace(tuple(normal) if normal is not None else (0.0,) * (d - 1) + (1.0,)), d)
    return state, FloorBody(Member(state, shape), [floor, *walls], Meeting(friction=mu, stiffness=K))


def slope(degrees: float) -> tuple[Array, tuple[float, float, float, float]]:
    """The normal of a plane that falls along x, and the turn that lays a body's z axis along it."""
    angle = math.radians(degrees)
    return np.array([math.sin(angle), 0.0, math.cos(angle)]), (0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2))


def run(body: FloorBody, T: float, seconds: float) -> None:
    for _ in range(round(seconds / T)):
        body.step(T)


def position(state: Array) -> Array:
    return state[at.POSITION : at.POSITION + 3]


def velocity(state: Array) -> Array:
    return state[at.VELOCITY : at.VELOCITY + 3]


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("T", [0.001, 0.005])
def test_a_dropped_box_comes_to_rest_and_stays(integrator: str, T: float) -> None:
    """It sinks by m g/(4 k) = 2.45 um on four corners, then moves no more than rounding.

    The first contact is up to a sample's fall from the floor: from there the height only goes down to the floor, and
    within 2e-4 m, a share of the 0.31 m/s after 5 mm, below it.
    """
    state, body = made(CUBE, position=(0.0, 0.0, 0.03), integrator=integrator)
    heights: list[Any] = []
    for _ in range(round(0.4 / T)):
        body.step(T)
        if body.touching or heights:
            heights.append(position(state)[2] - 0.025)
    still = state[at.POSITION : at.ANGLE].copy()
    run(body, T, 100 * T)
    assert heights[0] < 0.32 * T and max(heights[1:]) <= max(heights[0], 0.0) and min(heights) > -2e-4
    np.testing.assert_allclose(position(state)[2], 0.025 - M * G / (4 * K), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(state[at.POSITION : at.ANGLE], still, rtol=0.0, atol=1e-16)
    assert np.abs(state[at.VELOCITY : at.ROTATION]).max() < 1e-13
    np.testing.assert_allclose(body.contact_wrench, [0, 0, M * G, 0, 0, 0], rtol=0.0, atol=1e-12)
    assert body.touching == 4 and body.associated == 0


def test_no_creep_on_a_slope_inside_the_friction_cone() -> None:
    """26 degrees, where atan 0.5 is 26.57: a minute is 3e-15 m (measured); here three seconds."""
    normal, turn = slope(26.0)
    state, body = made(Box((0.05, 0.05, 0.02)), normal=normal, position=0.01 * normal, orientation=turn)
    run(body, 0.005, 0.5)
    still = state[at.POSITION : at.ANGLE].copy()
    run(body, 0.005, 3.0)
    np.testing.assert_allclose(state[at.POSITION : at.ANGLE], still, rtol=0.0, atol=2e-15)


def test_outside_the_cone_it_slides_as_coulomb_says() -> None:
    """a = g (sin 30 - mu cos 30), to rounding once the corners' springs have settled."""
    normal, turn = slope(30.0)
    state, body = made(Box((0.05, 0.05, 0.02)), normal=normal, position=0.01 * normal, orientation=turn)
    run(body, 0.001, 0.3)
    before = np.linalg.norm(velocity(state))
    run(body, 0.001, 0.2)
    a = (np.linalg.norm(velocity(state)) - before) / 0.2
    np.testing.assert_allclose(a, G * (math.sin(math.pi / 6) - MU * math.cos(math.pi / 6)), rtol=1e-9)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_sliding_slows_by_mu_g_in_its_own_direction(integrator: str) -> None:
    v = np.array([0.5, 0.2, 0.0])
    start = (0.0, 0.0, 0.025 - M * G / (4 * K))
    state, body = made(CUBE, position=start, velocity=v, integrator=integrator)
    run(body, 0.001, 0.03)
    before = velocity(state).copy()
    run(body, 0.001, 0.04)
    slowed = (before - velocity(state)) / 0.04
    np.testing.assert_allclose(np.linalg.norm(slowed), MU * G, rtol=1e-7)
    np.testing.assert_allclose(slowed[:2] / np.linalg.norm(slowed), v[:2] / np.linalg.norm(v), rtol=0.0, atol=1e-7)


@pytest.mark.parametrize(("share", "falls"), [(0.99, False), (1.01, True)])
def test_a_box_tips_at_the_force_that_statics_gives(share: float, falls: bool) -> None:
    """F h/2 = m g w/2 about the far edge: a pull at the centre of 0.99 of that holds, 1.01 tips it over."""
    w, h = 0.02, 0.08
    state, body = made(Box((w, 0.03, h)), position=(0.0, 0.0, h / 2), mu=1.0)
    for k in range(500):
        state[at.FORCE] = share * M * G * w / h * min(1.0, k / 250)
        body.step(0.004)
        if abs(state[at.QUATERNION + 1]) > 0.1:
            break
    assert bool(abs(state[at.QUATERNION + 1]) > 0.1) is falls
    if not falls:
        assert abs(state[at.QUATERNION + 1]) < 2e-4  # it leans on its edge's springs


@pytest.mark.parametrize("integrator", ["exact", "semi-implicit", "implicit"])
@pytest.mark.parametrize(
    ("shape", "factor"), [(Sphere(0.02), 5 / 7), (Capsule(0.02, 0.05), None), (Cylinder(0.02, 0.05), 2 / 3)]
)
def test_round_bodies_roll_without_slipping(integrator: str, shape: Any, factor: float | None) -> None:
    """g sin(10 deg)/(1 + I/(m r^2)), 5/7 and 2/3 of g sin: linear in time, so every integrator has it to rounding."""
    normal, _ = slope(10.0)
    across = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # their axis along y
    state, body = made(shape, normal=normal, position=0.02 * normal, orientation=across, integrator=integrator)
    about_own_axis = shape.inertia(M, 3)[2]
    expected = G * math.sin(math.radians(10.0)) / (1.0 + about_own_axis / (M * 0.02**2))
    if factor is not None:
        np.testing.assert_allclose(expected, factor * G * math.sin(math.radians(10.0)), rtol=1e-12)
    run(body, 0.002, 0.2)
    before = np.linalg.norm(velocity(state))
    run(body, 0.002, 0.2)
    np.testing.assert_allclose((np.linalg.norm(velocity(state)) - before) / 0.2, expected, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(velocity(state)), 0.02 * state[at.ANGULAR_VELOCITY + 1], rtol=1e-12)


def energy(state: Array, body: FloorBody, T: float) -> float:
    """Kinetic, of gravity, and of the springs at the contacts, from the state alone."""
    floor = FloorState(body.buffer)
    R = state[at.ROTATION : at.ROTATION + 9].reshape(3, 3)
    v, w = velocity(state), state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3]
    total = 0.5 * M * v @ v + 0.5 * (state[at.INERTIA : at.INERTIA + 3] * (R.T @ w) ** 2).sum()
    total += M * G * position(state)[2]
    ahead = rest.lookahead(int(state[at.INTEGRATOR]), T)
    for f, feature in enumerate(floor.features):
        share, lever = lowest(BodyState(state), feature, Vector(0.0, 0.0, 1.0))
        arm = np.array([lever.x, lever.y, lever.z])
        gap = position(state)[2] + arm[2] + ahead * (v + np.cross(w, arm))[2]
        stretch = np.array([floor.memory[f, 0], floor.memory[f, 1]])
        total += share * 0.5 * K * (min(gap, 0.0) ** 2 + stretch @ stretch)
    return float(total)


@pytest.mark.parametrize(
    ("shape", "most"),
    [
        (Sphere(0.02), 1e-16),
        # these turn about the contact or it runs through them: the gap has a term of second order in T
        (Box((0.05, 0.03, 0.02)), 2e-6),
        (Capsule(0.01, 0.04), 2e-6),
        (Cylinder(0.03, 0.01), 2e-5),
        (Ellipsoid((0.03, 0.02, 0.01)), 2e-5),
    ],
)
def test_energy_never_grows_at_contact(shape: Any, most: float) -> None:
    """A tumbling body falls by 0.15 m, 0.16 J in all, slides, rolls and comes down; most is what a sample may gain."""
    turn = np.array([0.3, -0.5, 0.2, 0.8])
    state, body = made(
        shape,
        position=(0.0, 0.0, 0.06),
        orientation=turn / np.linalg.norm(turn),
        velocity=(0.5, 0.2, -1.3),
        angular_velocity=(10.0, 5.0, -7.0),
    )
    before, gain = energy(state, body, 0.001), 0.0
    for _ in range(250):
        in_air = body.touching == 0
        body.step(0.001)
        now = energy(state, body, 0.001)
        if not in_air or body.touching:
            gain = max(gain, now - before)
        before = now
    assert gain < most
    assert before < 0.05 and body.associated == 0


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_free_flight_above_a_floor_is_that_without_one(integrator: str) -> None:
    """Bit by bit, tumbling with viscosity."""
    given: dict[str, Any] = {
        "position": (0.0, 0.0, 5.0),
        "velocity": (0.1, 0.2, 0.3),
        "angular_velocity": (3.0, 2.0, 1.0),
        "viscosity": 0.2,
        "rotational_viscosity": 1e-5,
        "integrator": integrator,
    }
    state, body = made(Box((0.05, 0.03, 0.02)), **given)
    alone = NativeBody(state.copy())
    run(body, 0.002, 0.5)
    for _ in range(250):
        alone.step(0.002)
    assert np.array_equal(state, alone.state)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_momentum_is_the_impulse_of_all_forces(integrator: str) -> None:
    """m dv = T (f + m g + lambda) and, of a sphere, I dw = T (moment of the fingers and the floor), in every sample."""
    state, body = made(
        Sphere(0.02), position=(0, 0, 0.05), velocity=(0.3, 0.1, 0), angular_velocity=(5, -3, 8), integrator=integrator
    )
    J, T, touched = shape_moment(), 0.001, 0
    for k in range(300):
        state[at.FORCE : at.FORCE + 6] = [0.1 * math.sin(k), 0.2, -0.1, 1e-4, 2e-4, math.cos(k) * 1e-4]
        v, w = velocity(state).copy(), state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3].copy()
        body.step(T)
        touched += body.touching
        wrench = state[at.FORCE : at.FORCE + 6] + body.contact_wrench + [0, 0, -M * G, 0, 0, 0]
        np.testing.assert_allclose(M * (velocity(state) - v), T * wrench[:3], rtol=0.0, atol=1e-15)
        change = J * (state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3] - w)
        np.testing.assert_allclose(change, T * wrench[3:], rtol=0.0, atol=1e-17)
    assert touched > 100


def shape_moment() -> float:
    return float(Sphere(0.02).inertia(M, 3)[0])


def test_a_line_and_a_plane_are_the_same_code() -> None:
    """On the line one point bears the weight, in the plane two; a box in the plane slides by g (sin - mu cos)."""
    state, body = made(Sphere(0.02), d=1, position=(0.03,))
    run(body, 0.001, 0.3)
    np.testing.assert_allclose(state[at.POSITION], 0.02 - M * G / K, rtol=0.0, atol=1e-14)
    state, body = made(Box((0.05, 0.02)), d=2, position=(0.0, 0.015), orientation=0.2)
    run(body, 0.001, 0.4)
    np.testing.assert_allclose(state[at.POSITION + 1], 0.01 - M * G / (2 * K), rtol=0.0, atol=1e-14)
    angle = math.pi / 6
    normal = np.array([-math.sin(angle), math.cos(angle)])
    state, body = made(Box((0.05, 0.02)), d=2, normal=normal, position=0.01 * normal, orientation=angle)
    run(body, 0.001, 0.2)
    before = np.linalg.norm(velocity(state))
    run(body, 0.001, 0.2)
    expected = G * (math.sin(angle) - MU * math.cos(angle))
    np.testing.assert_allclose((np.linalg.norm(velocity(state)) - before) / 0.2, expected, rtol=1e-9)


def test_a_corner_of_two_planes_holds_from_both_sides() -> None:
    """Pushed into a wall with 2 N: the wall gives 2 N, the floor the weight; friction shares cannot be told apart."""
    wall = place_obstacle("wall", Plane((1.0, 0.0, 0.0)), 3, (0.1, 0.0, 0.0))
    state, body = made(CUBE, position=(0.07, 0.0, 0.026), walls=(wall,))
    state[at.FORCE] = 2.0
    run(body, 0.002, 0.4)
    np.testing.assert_allclose(body.contact_wrench[:3], [-2.0, 0.0, M * G], rtol=0.0, atol=1e-9)
    assert 0.075 < position(state)[0] < 0.0751  # the sheet keeps it on the side where it began
    assert np.abs(velocity(state)).max() < 1e-10


def test_locked_freedoms_stay_locked_on_a_floor() -> None:
    """Only z and the turn about x are free: a leaning box falls flat without moving along x or y."""
    free = (False, False, True, True, False, False)
    lean = (math.sin(0.2), 0.0, 0.0, math.cos(0.2))
    state, body = made(CUBE, position=(0.0, 0.0, 0.04), orientation=lean, free=free, mu=0.1)
    run(body, 0.001, 0.5)
    assert not position(state)[:2].any() and not state[at.QUATERNION + 1 : at.QUATERNION + 3].any()
    np.testing.assert_allclose(position(state)[2], 0.025 - M * G / (4 * K), rtol=0.0, atol=1e-10)


def test_a_mesh_rests_on_the_corners_of_its_hull() -> None:
    """The triangles of a box move as the box does."""
    mesh = make_mesh(*plate(0.05, 0.05, 0.05))
    lean = (0.1, 0.2, 0.0, math.sqrt(0.95))
    whole, body = made(CUBE, position=(0, 0, 0.05), orientation=lean)
    state = whole.copy()
    other = FloorBody(Member(state, mesh), [place_obstacle("floor", HalfSpace((0, 0, 1)), 3)], Meeting(MU, 0.0, K))
    run(body, 0.002, 0.3)
    run(other, 0.002, 0.3)
    np.testing.assert_allclose(state[: at.FORCE], whole[: at.FORCE], rtol=0.0, atol=1e-12)


def test_of_many_points_near_a_plane_nine_are_kept() -> None:
    """The deepest, and the outermost in eight directions: of a ring of 40 with one deep point inside."""
    angles = 2.0 * np.pi * np.arange(40) / 40
    block = FloorState(np.zeros(size_for(FloorState, plane_count=1, feature_count=41, problem_entries=0)))
    block.plane_count, block.feature_count = 1, 41
    contacts, [plane] = block.contacts, block.planes
    plane.frame = Matrix(0, 0, 1, 1, 0, 0, 0, 1, 0)
    for i, angle in enumerate(angles.tolist()):
        contacts[i].pair, contacts[i].arm = i, Vector(math.cos(angle), math.sin(angle), 0.0)
    contacts[40].pair, contacts[40].arm, contacts[40].gap = 40, Vector(0.1, 0.1, 0.0), -1.0
    assert thin(contacts, 0, 41, plane) == MOST
    assert [contacts[i].pair for i in range(MOST)] == [0, 5, 10, 15, 20, 25, 30, 35, 40]
    assert thin(contacts, 0, MOST, plane) == MOST


@pytest.mark.parametrize(
    "shape",
    [CUBE, Sphere(0.02), Capsule(0.01, 0.04), Cylinder(0.02, 0.05), Ellipsoid((0.03, 0.02, 0.01))],
)
def test_the_lowest_point_is_the_least_of_the_surface(shape: Any) -> None:
    """Against the support of a dense set of surface points, for random turns and normals."""
    rng = np.random.default_rng(3)
    u = rng.normal(size=(40_000, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    a, b, c = shape.parameters
    round_off = np.stack([np.cos(t := np.linspace(0, 2 * np.pi, 5000)), np.sin(t), 0 * t], axis=1)
    kinds: dict[Any, Any] = {
        Box: np.sign(u) * [a, b, c],
        Sphere: a * u,
        Capsule: a * u + np.sign(u[:, 2:]) * [0, 0, b],
        Cylinder: np.concatenate([a * round_off + [0, 0, b], a * round_off - [0, 0, b]]),
        Ellipsoid: u * [a, b, c],
    }
    surface = kinds[type(shape)]
    for _ in range(20):
        turn, normal = rng.normal(size=4), rng.normal(size=3)
        state, _ = made(shape, position=rng.normal(size=3), orientation=turn / np.linalg.norm(turn))
        obstacle = place_obstacle("wall", HalfSpace(tuple(normal)), 3, rng.normal(size=3))
        n = normal / np.linalg.norm(normal)
        R = state[at.ROTATION : at.ROTATION + 9].reshape(3, 3)
        least = ((position(state) + surface @ R.T - obstacle.position) @ n).min()
        height = clearance(shape, 3, state, obstacle)
        assert -2e-5 < height - least < 1e-15  # the surface is sampled


def test_the_implicit_prediction_rests_where_the_body_rests() -> None:
    """With fingers' forces held up by the floor: x+ of no further force differs from x by that of the fingers only."""
    state, body = made(CUBE, position=(0, 0, 0.025), integrator="implicit")
    state[at.FORCE : at.FORCE + 6] = [0.1, 0.0, -0.5, 1e-3, -2e-3, 1e-3]
    run(body, 0.001, 0.5)
    body.free_motion(0.001)
    C = state[at.COMPLIANCE]
    moved = state[at.NEXT_POSITION : at.NEXT_POSITION + 3] + C * state[at.FORCE : at.FORCE + 3]
    np.testing.assert_allclose(moved, position(state), rtol=0.0, atol=1e-15)
    turn = state[at.ROTATIONAL_COMPLIANCE : at.ROTATIONAL_COMPLIANCE + 9].reshape(3, 3) @ state[at.MOMENT : at.SIZE][:3]
    R = state[at.ROTATION : at.ROTATION + 9].reshape(3, 3)
    N = state[at.NEXT_ROTATION : at.NEXT_ROTATION + 9].reshape(3, 3)
    skew = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    np.testing.assert_allclose(N + skew @ N, R, rtol=0.0, atol=1e-8)  # second order of a turn of 5e-5


def test_what_a_native_body_cannot_meet_is_refused() -> None:
    state, _ = made(CUBE)
    floor = place_obstacle("floor", HalfSpace((0, 0, 1)), 3)
    with pytest.raises(InputError, match="does not bounce"):
        FloorBody(Member(state, CUBE), [floor], Meeting(restitution=0.5))
    with pytest.raises(InputError, match=r"obstacle block.*half-space or a plane"):
        FloorBody(Member(state, CUBE), [place_obstacle("block", CUBE, 3)], Meeting())
    with pytest.raises(InputError, match="bounded shape"):
        features(HalfSpace((0, 0, 1)), 3)


@pytest.mark.parametrize(("mass", "stiffness"), [(1e40, 1e5), (1e40, 1e40)])
def test_numbers_at_the_end_of_their_range_are_faults_and_no_tracebacks(mass: float, stiffness: float) -> None:
    """Whatever the sample then says: that it did not settle, or that something is not finite."""
    import graspfx as gx

    finger = {"device": {"name": "simulated", "mass": 0.1, "damping": 1.0}, "start": [0.0, 1.0]}
    rec = gx.run(
        gx.Scene(
            dimensions=2,
            period=0.001,
            duration=0.01,
            gravity=[0.0, -9.81],
            object={
                "mass": mass,
                "viscosity": 0.0,
                "rotational_viscosity": 0.0,
                "shape": {"kind": "box", "size": [0.05, 0.05]},
                "position": [0.0, 0.025],
            },
            obstacle=[{"shape": {"kind": "half-space", "normal": [0.0, 1.0]}}],
            world={"stiffness": stiffness},
            coupling={"external": {"stiffness": 10.0}, "internal": {"stiffness": 10.0}},
            finger=[finger],
        )
    )
    assert len(rec) == 10 and not rec.finger_force.any()


def test_a_sheet_without_thickness_rests_on_its_corners() -> None:
    """A shell of two triangles has no hull with a volume: its corners carry it, m g / 4 k deep."""
    L = 0.05
    square = [[-L, -L, 0.0], [L, -L, 0.0], [L, L, 0.0], [-L, L, 0.0], [0.0, 0.0, 0.0]]
    sheet = make_mesh(square, [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)], shell=True)
    turned = sheet.vertices @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0].T
    for vertices in (sheet.vertices, turned):
        assert len(hull_points(vertices)) == 4
    state, _ = made(CUBE, position=(0.0, 0.0, 0.001))
    body = FloorBody(Member(state, sheet), [place_obstacle("floor", HalfSpace((0, 0, 1)), 3)], Meeting(MU, 0.0, K))
    run(body, 0.002, 1.0)
    np.testing.assert_allclose(state[at.POSITION + 2], -0.1 * 9.81 / (4 * K), rtol=1e-6)
