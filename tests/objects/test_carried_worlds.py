"""Worlds of PyBullet and MuJoCo: rest without creep, friction that holds and slides, momentum, hulls, determinism."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.objects import integrators as at
from graspfx.objects.body import fill_body
from graspfx.objects.surroundings import Meeting, Member, Obstacle, place_obstacle
from graspfx.surfaces.closed_form.shape import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Plane, Sphere
from graspfx.surfaces.triangles.mesh import make_mesh
from tests.support import carriers
from tests.support.meshes import plate

Array = NDArray[np.float64]
G, M, MU = 9.81, 0.1, 0.5
CUBE = Box((0.05, 0.05, 0.05))
FLOOR = place_obstacle("floor", HalfSpace((0.0, 0.0, 1.0)), 3)
ON_ITS_SIDE = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
HULL = make_mesh(*plate(0.05, 0.05, 0.05))

# What each engine's contacts are good to. MuJoCo's give way by 0.1 um, and a box that is pushed tilts on them.
FIRM = {"bullet": 1e-12, "mujoco": 2e-7}  # how far a body that holds moves [m]
STILL = {"bullet": 1e-12, "mujoco": 1e-7}  # how fast it then is [m/s]
BALANCE = {"bullet": 1e-14, "mujoco": 1e-9}  # change of momentum against the impulses reported [N s]
TOGETHER = {"bullet": 1e-6, "mujoco": 0.05 * 0.5}  # speed with which bodies part without restitution [m/s]
ASKEW = {"bullet": 0.1, "mujoco": 1e-6}  # of friction, when a body begins to slide
DEPTH = {"bullet": 1e-5, "mujoco": 1e-7}  # how high a hull or an ellipsoid stands [m]


carrier = carriers.carrier


@pytest.fixture
def worlds(carrier: str) -> Iterator[Any]:
    """Makes worlds and closes them."""
    with carriers.maker(carriers.require(carrier).create_world) as make:

        def world(*members: Member, obstacles: tuple[Obstacle, ...] = (FLOOR,), **meeting: Any) -> Any:
            return make(members, obstacles, Meeting(**({"friction": MU} | meeting)))

        yield world


def member(shape: Any, mass: float = M, gravity: float = G, **given: Any) -> Member:
    state = np.zeros(at.SIZE)
    inertia = shape.inertia(mass, 3) if hasattr(shape, "inertia") else CUBE.inertia(mass, 3)
    fill_body(state, dimensions=3, mass=mass, inertia=inertia, gravity=(0.0, 0.0, -gravity), **given)
    return Member(state, shape)


def position(one: Member) -> Array:
    return one.state[at.POSITION : at.POSITION + 3]


def velocity(one: Member) -> Array:
    return one.state[at.VELOCITY : at.VELOCITY + 3]


def run(world: Any, T: float, seconds: float) -> None:
    for _ in range(round(seconds / T)):
        world.step(T)


@pytest.mark.parametrize("T", [0.001, 0.002, 0.005])
@pytest.mark.parametrize(
    ("shape", "height", "turn", "sunk"),
    [
        (CUBE, 0.025, (0, 0, 0, 1), 0.0),
        (Sphere(0.02), 0.02, (0, 0, 0, 1), 0.0),
        (Capsule(0.01, 0.04), 0.01, ON_ITS_SIDE, 0.0),
        (Cylinder(0.02, 0.05), 0.025, (0, 0, 0, 1), 0.0),
        (Cylinder(0.02, 0.05), 0.02, ON_ITS_SIDE, 0.0),
        (HULL, 0.025, (0, 0, 0, 1), None),
    ],
)
def test_bodies_rest_where_they_are_put(
    worlds: Any, carrier: str, T: float, shape: Any, height: float, turn: Any, sunk: float | None
) -> None:
    """In two seconds no creep beyond rounding and no sinking but that of a hull; 1e-16 m a second was measured.

    The first contacts of what is no box come one by one, a step each, which may turn and shift it by up to g T^2.
    """
    if sunk is None:
        sunk = -1e-5 if carrier == "bullet" else 0.0  # PyBullet's margin, which it rounds a hull with
    one = member(shape, position=(0.0, 0.0, height), orientation=turn)
    world = worlds(one)
    run(world, T, 0.5)
    still = one.state[at.POSITION : at.ANGLE].copy()
    run(world, T, 2.0)
    np.testing.assert_allclose(one.state[at.POSITION : at.ANGLE], still, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(position(one), [0.0, 0.0, height - sunk], rtol=0.0, atol=1e-6 + G * T * T)
    np.testing.assert_allclose(world.contact_wrench(0)[:3], [0.0, 0.0, M * G], rtol=0.0, atol=1e-9)


def test_an_ellipsoid_stands(worlds: Any, carrier: str) -> None:
    """PyBullet's hull of 2000 points stands 5 um too low, on a facet tilted by up to 0.02; MuJoCo's is an ellipsoid."""
    one = member(Ellipsoid((0.03, 0.02, 0.01)), position=(0.0, 0.0, 0.01))
    run(worlds(one), 0.001, 2.0)
    np.testing.assert_allclose(position(one), [0.0, 0.0, 0.01], rtol=0.0, atol=2e-4)
    np.testing.assert_allclose(position(one)[2], 0.01, rtol=0.0, atol=DEPTH[carrier])
    assert 1.0 - abs(one.state[at.QUATERNION + 3]) < 1e-4


@pytest.mark.parametrize("T", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("share", [0.0, 0.5, -0.5])
def test_a_moment_does_not_push_a_resting_box_along(worlds: Any, carrier: str, T: float, share: float) -> None:
    """Half of the moment that tips it over, by itself or with half of mu m g: it stays where it is, to rounding.

    PyBullet's friction overlooks a torque: given as one and not as the velocity that it makes, it moved the box by
    7 mm/s at T = 1 ms.
    """
    one = member(CUBE, position=(0.0, 0.0, 0.025), rotational_viscosity=2e-5)
    world = worlds(one)
    run(world, T, 0.2)
    one.state[at.FORCE] = share * MU * M * G
    one.state[at.MOMENT + 1] = 0.5 * M * G * 0.025
    run(world, T, 0.5)
    assert np.abs(position(one)[:2]).max() < FIRM[carrier]
    assert np.abs(velocity(one)).max() < STILL[carrier]


@pytest.mark.parametrize("T", [0.001, 0.005])
@pytest.mark.parametrize("angle", [0.0, 0.4, math.pi / 4])
def test_friction_holds_up_to_mu_m_g_and_slides_beyond(worlds: Any, carrier: str, T: float, angle: float) -> None:
    """A box holds at 0.99 of mu m g in any direction, and at 1.01 accelerates by 0.01 mu g."""
    along = np.array([math.cos(angle), math.sin(angle)])
    one = member(CUBE, position=(0.0, 0.0, 0.025))
    world = worlds(one)
    run(world, T, 0.2)
    one.state[at.FORCE : at.FORCE + 2] = 0.99 * MU * M * G * along
    run(world, T, 0.5)
    assert np.abs(position(one)[:2]).max() < FIRM[carrier]
    one.state[at.FORCE : at.FORCE + 2] = 1.5 * MU * M * G * along
    run(world, T, 0.1)
    # PyBullet's limits of the two directions of friction are a square: up to 10 % askew until one is that of sliding
    np.testing.assert_allclose(velocity(one)[:2] / 0.1, 0.5 * MU * G * along, rtol=0.0, atol=ASKEW[carrier] * MU * G)


def test_sliding_on_a_floor_slows_by_mu_g(worlds: Any) -> None:
    """A box keeps all four corners on a floor: mu to 1e-3, straight on."""
    one = member(CUBE, position=(0.0, 0.0, 0.025), velocity=(0.5 * math.cos(0.4), 0.5 * math.sin(0.4), 0.0))
    world = worlds(one)
    run(world, 0.001, 0.08)
    v = velocity(one)
    np.testing.assert_allclose(0.5 - np.linalg.norm(v[:2]), MU * G * 0.08, rtol=1e-3)
    np.testing.assert_allclose(math.atan2(v[1], v[0]), 0.4, rtol=0.0, atol=1e-3)


def test_a_sphere_rolls_down_a_slope(worlds: Any) -> None:
    """5/7 g sin(10 deg) to 1e-3."""
    angle = math.radians(10.0)
    normal = (math.sin(angle), 0.0, math.cos(angle))
    one = member(Sphere(0.02), position=0.02 * np.array(normal))
    world = worlds(one, obstacles=(place_obstacle("slope", HalfSpace(normal), 3),))
    run(world, 0.001, 0.5)
    np.testing.assert_allclose(np.linalg.norm(velocity(one)) / 0.5, 5 / 7 * G * math.sin(angle), rtol=1e-3)


def tumbling() -> list[Member]:
    box = member(Box((0.05, 0.04, 0.03)), position=(0.0, 0.0, 0.1), angular_velocity=(1.0, 2.0, 3.0))
    egg = member(Ellipsoid((0.03, 0.02, 0.01)), 0.05, position=(0.005, 0.0, 0.2), angular_velocity=(3.0, 2.0, 1.0))
    return [box, egg]


def test_the_impulses_reported_are_the_change_of_momentum_and_two_runs_are_equal(worlds: Any, carrier: str) -> None:
    """Two bodies fall on a floor and on one another: m dv = T (m g + contacts), 1e-15 of 0.06 N s in PyBullet."""
    ends = []
    for _ in range(2):
        members = tumbling()
        world = worlds(*members)
        largest = 0.0
        for _ in range(400):
            before = [velocity(one).copy() for one in members]
            world.step(0.001)
            for i, (one, v) in enumerate(zip(members, before, strict=True)):
                force = world.contact_wrench(i)[:3]
                mass = one.state[at.MASS]
                largest = max(largest, 0.001 * np.abs(force).max())
                change = mass * (velocity(one) - v)
                np.testing.assert_allclose(change, 0.001 * (force - [0, 0, mass * G]), rtol=0.0, atol=BALANCE[carrier])
        assert largest > 0.01
        ends.append([one.state.copy() for one in members])
    assert all(np.array_equal(a, b) for a, b in zip(*ends, strict=True))


def test_bodies_in_free_fall_meet_with_equal_and_opposite_impulses(worlds: Any, carrier: str) -> None:
    """Two spheres head on without gravity: momentum is kept to rounding, and without restitution they stay together."""
    left = member(Sphere(0.02), gravity=0.0, position=(-0.05, 0.0, 0.0), velocity=(0.5, 0.0, 0.0))
    right = member(Sphere(0.02), 2 * M, gravity=0.0, position=(0.05, 0.0, 0.0))
    world = worlds(left, right, obstacles=())
    run(world, 0.001, 0.3)
    total = M * velocity(left) + 2 * M * velocity(right)
    np.testing.assert_allclose(total, [0.05, 0.0, 0.0], rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(velocity(left), [0.5 / 3, 0.0, 0.0], rtol=0.0, atol=TOGETHER[carrier])


def test_restitution_is_that_of_the_pair(worlds: Any, carrier: str) -> None:
    """From 1 m/s it comes back with 0.8 m/s, and up to 0.2 more where PyBullet takes back how deep it got in a step."""
    least, most = {"bullet": (0.8 - 1e-9, 1.0), "mujoco": (0.799, 0.801)}[carrier]
    one = member(Sphere(0.02), gravity=0.0, position=(0.0, 0.0, 0.0505), velocity=(0.0, 0.0, -1.0))
    run(worlds(one, restitution=0.8), 0.001, 0.1)
    assert least <= velocity(one)[2] <= most


def test_rebounds_are_as_far_off_as_the_pages_say(worlds: Any, carrier: str) -> None:
    """Restitution 0.5 at 1 m/s, wherever in a step they meet: PyBullet gives 0.45 to 0.69, not 0.6 at most."""
    rebounds = []
    for T in (0.001, 0.005):
        for part in np.linspace(0.05, 0.95, 7):
            one = member(
                Sphere(0.02), gravity=0.0, position=(0.0, 0.0, 0.02 + (3.0 + part) * T), velocity=(0.0, 0.0, -1.0)
            )
            run(worlds(one, restitution=0.5), T, 20 * T)
            rebounds.append(velocity(one)[2])
    least, most = {"bullet": (0.44, 0.70), "mujoco": (0.4998, 0.5002)}[carrier]
    assert least < min(rebounds) <= max(rebounds) < most
    if carrier == "bullet":
        assert max(rebounds) > 0.64


def test_members_that_do_not_collide_pass_through_one_another(worlds: Any) -> None:
    left = member(Sphere(0.02), gravity=0.0, position=(-0.05, 0.0, 0.1), velocity=(0.5, 0.0, 0.0))
    right = member(Sphere(0.02), gravity=0.0, position=(0.05, 0.0, 0.1))
    run(worlds(left, right, collide=False), 0.001, 0.2)
    np.testing.assert_allclose([velocity(left)[0], velocity(right)[0]], [0.5, 0.0], rtol=0.0, atol=1e-12)


def test_a_concave_obstacle_is_met_as_it_is(worlds: Any) -> None:
    """A sphere of 5 mm falls into a well 30 mm wide that a convex hull would close."""
    trimesh = pytest.importorskip("trimesh")
    ring = trimesh.creation.annulus(r_min=0.015, r_max=0.04, height=0.04, sections=32)
    well = place_obstacle("well", make_mesh(ring.vertices, ring.faces), 3, (0.0, 0.0, 0.02))
    one = member(Sphere(0.005), position=(0.0, 0.0, 0.06))
    run(worlds(one, obstacles=(FLOOR, well)), 0.001, 0.4)
    np.testing.assert_allclose(position(one), [0.0, 0.0, 0.005], rtol=0.0, atol=1e-4)


def test_a_sheet_is_met_from_the_side_where_a_body_starts(worlds: Any) -> None:
    above = member(CUBE, position=(0.0, 0.0, 0.03))
    below = member(Sphere(0.02), gravity=-G, position=(0.2, 0.0, -0.03))
    run(worlds(above, below, obstacles=(place_obstacle("sheet", Plane((0.0, 0.0, 1.0)), 3),)), 0.001, 0.5)
    np.testing.assert_allclose([position(above)[2], position(below)[2]], [0.025, -0.02], rtol=0.0, atol=1e-6)


def test_a_locked_member_stands_and_a_turned_obstacle_is_turned(worlds: Any) -> None:
    """A sphere rolls off nothing: a plate tilted about x lets it slide off sideways, a locked box holds it up."""
    block = member(CUBE, position=(0.0, 0.0, 0.2), free=(False,) * 6)
    ball = member(Sphere(0.02), position=(0.0, 0.0, 0.2451))
    tilt = (math.sin(0.1), 0.0, 0.0, math.cos(0.1))
    plate = place_obstacle("plate", Box((0.4, 0.4, 0.02)), 3, (1.0, 0.0, 0.0), tilt)
    other = member(Sphere(0.02), position=(1.0, 0.0, 0.04))
    run(worlds(block, ball, other, obstacles=(plate,)), 0.001, 0.3)
    assert np.array_equal(position(block), [0.0, 0.0, 0.2])
    np.testing.assert_allclose(position(ball), [0.0, 0.0, 0.245], rtol=0.0, atol=1e-5)
    assert position(other)[1] < -0.02  # the plate's +y edge is up


def test_what_has_no_end_is_no_member(worlds: Any) -> None:
    with pytest.raises(InputError, match="bounded shape"):
        worlds(Member(member(CUBE).state, HalfSpace((0.0, 0.0, 1.0))))
    with pytest.raises(InputError, match="one integrator"):
        worlds(member(CUBE)).free_motion(0.001)
