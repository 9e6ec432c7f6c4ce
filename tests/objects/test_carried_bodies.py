"""Bodies that PyBullet and MuJoCo move: native semi-implicit motion, exact viscosity, locked freedoms, no limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.objects import integrators as at
from graspfx.objects.body import Body, NativeBody, fill_body
from tests.support import carriers
from tests.support.carriers import PushAndDrift

Array = NDArray[np.float64]
T = 0.005
CUBE = 0.1 * 0.05**2 / 6
CROOKED = (3e-5, 5e-5, 6e-5)


carrier = carriers.carrier


@pytest.fixture
def bodies(carrier: str) -> Iterator[Any]:
    """Makes bodies from fill_body's arguments and closes them."""
    with carriers.maker(carriers.require(carrier).create) as make:
        yield lambda **given: make(block(**given))


def block(**given: Any) -> Array:
    state = np.zeros(at.SIZE)
    fill_body(state, **given)
    return state


def native_body(**given: Any) -> Any:
    return NativeBody(block(**given))


def push(body: Body, force: Any = (), moment: Any = ()) -> None:
    body.state[at.FORCE : at.FORCE + len(force)] = force
    body.state[at.MOMENT : at.MOMENT + len(moment)] = moment


def wrench(k: int) -> tuple[Array, float]:
    """A push in the plane that varies from sample to sample: up to 0.3 N and 3e-4 N m."""
    t = T * k
    return np.array([0.2 * math.sin(3 * t) + 0.1 * math.cos(11 * t), 0.15 * math.cos(2 * t)]), 2e-4 * (
        math.sin(5 * t) + 0.5
    )


def test_ten_seconds_in_the_plane_agree_with_native_semi_implicit(bodies: Any) -> None:
    """Viscosity passed in as the force -b v, the body's own zero: 1e-9 m and 1e-9 rad over 10 s."""
    given = {"dimensions": 2, "mass": 0.1, "inertia": CUBE, "integrator": "semi-implicit", "gravity": (0.0, -0.2)}
    ours, native = bodies(**given), native_body(**given)
    worst = np.zeros(2)
    for k in range(2000):
        f, moment = wrench(k)
        for body in (ours, native):
            push(body, f - 0.8 * body.velocity, (0.0, 0.0, moment - 3e-4 * body.angular_velocity))
            body.step(T)
        worst[0] = max(worst[0], np.abs(ours.position - native.position).max())
        worst[1] = max(worst[1], abs(ours.orientation - native.orientation))
    assert np.abs(native.position).max() > 0.05
    assert abs(native.orientation) > 3.2  # more than half a turn
    assert (worst < 1e-9).all()


def test_own_viscosity_is_exact(bodies: Any) -> None:
    """v+ = E v + (1 - E)/b (f + m g), E = exp(-b T/m), x+ = x + T v+; rotation likewise: 1e-9 over 10 s."""
    m, b, bw = 0.1, 0.8, 3e-4
    body = bodies(dimensions=2, mass=m, inertia=CUBE, viscosity=b, rotational_viscosity=bw, gravity=(0.0, -0.2))
    E, Ew = math.exp(-b * T / m), math.exp(-bw * T / CUBE)
    x, v, angle, w = np.zeros(2), np.zeros(2), 0.0, 0.0
    for k in range(2000):
        f, moment = wrench(k)
        push(body, f, (0.0, 0.0, moment))
        body.step(T)
        v = E * v + (1 - E) / b * (f + m * np.array([0.0, -0.2]))
        w = Ew * w + (1 - Ew) / bw * moment
        x, angle = x + T * v, angle + T * w
        assert np.abs(body.position - x).max() < 1e-9
        assert abs(body.orientation - angle) < 1e-9


def test_strong_viscosity_is_stable(bodies: Any) -> None:
    """b T/m = 1000: at rest at once but for f/b."""
    body = bodies(dimensions=1, mass=0.1, viscosity=2e4, velocity=[1.0])
    push(body, [2.0])
    for _ in range(10):
        body.step(T)
        assert body.velocity[0] == pytest.approx(1e-4, rel=1e-9)


def test_tumbling_in_space_is_native(bodies: Any, carrier: str) -> None:
    """Crooked body, 3 rad/s, moments in world axes.

    PyBullet's own gyroscopic term is that of the explicit step; MuJoCo's body drifts exactly after each push.
    """
    q = np.array([0.1, -0.7, 0.5, 0.5])
    given = {
        "dimensions": 3, "mass": 0.1, "inertia": CROOKED, "orientation": q, "angular_velocity": (1.0, 2.0, -2.0),
        "velocity": (0.1, 0.2, 0.3), "integrator": "semi-implicit" if carrier == "bullet" else "exact",
    }  # fmt: skip
    ours = bodies(**given)
    native = NativeBody(block(**given)) if carrier == "bullet" else PushAndDrift(block(**given))
    for k in range(400):
        f, moment = wrench(k)
        for body in (ours, native):
            push(body, (*f, 0.1), (moment, -moment, 0.5 * moment))
            body.step(T)
        assert np.abs(ours.position - native.position).max() < 1e-9
        assert np.abs(ours.orientation - native.orientation).max() < 1e-9
        rows = slice(at.ROTATION, at.ROTATION + 9)
        assert np.abs(ours.state[rows] - native.state[rows]).max() < 1e-9


def test_own_viscosity_in_space_goes_by_principal_axes(bodies: Any) -> None:
    """About one principal axis, turned away from the world's: w = exp(-b_w t/I) w0."""
    s = math.sqrt(0.5)
    for i, axis in enumerate(np.eye(3)):
        world = np.array([axis[0], -axis[2], axis[1]])  # by a quarter turn about x
        body = bodies(
            dimensions=3, mass=0.1, inertia=CROOKED, rotational_viscosity=1e-3, orientation=(s, 0, 0, s),
            angular_velocity=2.0 * world,
        )  # fmt: skip
        for _ in range(20):
            body.step(T)
        np.testing.assert_allclose(body.angular_velocity, 2.0 * math.exp(-0.1 * 1e-3 / CROOKED[i]) * world, atol=1e-12)


@pytest.mark.parametrize("free", [(1, 0, 1, 0, 0, 0), (0, 1, 0, 0, 0, 1), (0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 0, 0)])
def test_locked_freedoms_stay_exactly_still(bodies: Any, free: tuple[int, ...]) -> None:
    q = np.array([0.1, -0.7, 0.5, 0.5])
    body = bodies(
        dimensions=3, mass=0.1, inertia=CROOKED, free=free, position=(1, 2, 3), orientation=q, gravity=(1, 1, 1)
    )
    first = body.state.copy()
    for k in range(200):
        push(body, (0.1, -0.2, 0.3), (1e-4, 2e-4 * math.sin(k), -1e-4))
        body.step(T)
    locked = np.flatnonzero(np.array(free) == 0)
    position, spin = locked[locked < 3], locked[locked >= 3] - 3
    np.testing.assert_array_equal(body.position[position], first[at.POSITION + position])
    np.testing.assert_array_equal(body.velocity[position], 0.0)
    np.testing.assert_array_equal(body.state[at.ANGULAR_VELOCITY + spin], 0.0)
    if not any(free[3:]):
        np.testing.assert_array_equal(body.orientation, first[at.QUATERNION : at.QUATERNION + 4])
    for a in np.flatnonzero(free[:3]):
        assert abs(body.velocity[a]) > 0.1


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_knob_turns_as_native(bodies: Any, axis: int) -> None:
    """One free rotation of a crooked, turned body pushed across it too: the moment about that axis counts."""
    free = np.eye(6, dtype=bool)[3 + axis]
    given = {
        "dimensions": 3, "mass": 0.1, "inertia": CROOKED, "orientation": (0.1, -0.7, 0.5, 0.5), "free": free,
        "angular_velocity": 2.0 * np.eye(3)[axis], "integrator": "semi-implicit",
    }  # fmt: skip
    ours, native = bodies(**given), native_body(**given)
    for _ in range(400):
        for body in (ours, native):
            push(body, (), (1e-5, 1e-5, 1e-5))
            body.step(T)
        np.testing.assert_allclose(ours.orientation, native.orientation, atol=1e-11)
        np.testing.assert_allclose(ours.angular_velocity, native.angular_velocity, atol=1e-11)


def test_the_angle_is_unwrapped_from_where_it_began(bodies: Any) -> None:
    """100 rad/s for 1 s, backwards too, from 7 rad."""
    for w in (100.0, -100.0):
        body = bodies(dimensions=2, mass=1.0, inertia=1.0, orientation=7.0, angular_velocity=w)
        for _ in range(200):
            body.step(T)
        assert body.orientation == pytest.approx(7.0 + w, abs=1e-10)


def test_speed_is_not_clamped(bodies: Any) -> None:
    """PyBullet alone would hold 100 m/s."""
    body = bodies(dimensions=1, mass=1.0, velocity=[5000.0])
    body.step(T)
    assert (body.position[0], body.velocity[0]) == pytest.approx((25.0, 5000.0))


def test_a_resting_body_does_not_fall_asleep(bodies: Any) -> None:
    """A micronewton after 10 s of nothing: T f/m."""
    body = bodies(dimensions=1, mass=0.1)
    for _ in range(2000):
        body.step(T)
    push(body, [1e-6])
    body.step(T)
    assert body.velocity[0] == pytest.approx(5e-8, rel=1e-12)


def test_the_step_may_change(bodies: Any) -> None:
    """v = exp(-b t/m) v0 whatever the steps."""
    body = bodies(dimensions=1, mass=0.1, viscosity=0.8, velocity=[1.0])
    for step in (0.005, 0.001, 0.02):
        body.step(step)
    assert body.velocity[0] == pytest.approx(math.exp(-8.0 * 0.026), rel=1e-12)
    for wrong in (0.0, -0.005, math.nan, math.inf):
        with pytest.raises(InputError, match="T: given"):
            body.step(wrong)


def test_bodies_do_not_share_a_world(bodies: Any) -> None:
    """One is closed, and one step of another moves it alone."""
    a, b, c = (bodies(dimensions=1, mass=0.1, velocity=[1.0]) for _ in range(3))
    a.close()
    a.close()
    b.step(T)
    assert (a.position[0], b.position[0], c.position[0]) == (0.0, pytest.approx(T), 0.0)


def test_it_has_one_integrator(bodies: Any) -> None:
    with pytest.raises(InputError, match="has one integrator"):
        bodies(dimensions=1, mass=0.1).free_motion(T)


def test_two_free_rotations_of_equal_moments_turn_about_those_axes(bodies: Any) -> None:
    even = bodies(dimensions=3, mass=0.1, inertia=CUBE, free=(1, 1, 1, 1, 1, 0))
    push(even, (), (1e-4, 1e-4, 1e-4))
    even.step(T)
    np.testing.assert_allclose(even.angular_velocity, [T * 1e-4 / CUBE, T * 1e-4 / CUBE, 0.0], rtol=1e-13)
