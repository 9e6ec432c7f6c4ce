"""Orders of the integrators by a fit of error against step, and rounding where a solution is exact."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from graspfx.objects import integrators as at
from graspfx.objects.body import NativeBody, fill_body
from graspfx.objects.integrators import decay_integrals

Array = NDArray[np.float64]
CROOKED, EVEN = (3e-5, 5e-5, 6e-5), (4e-5, 4e-5, 4e-5)
QUATERNION = np.array([0.1, -0.7, 0.5, 0.5])
SPIN = np.array([0.7, -1.2, 0.9])
MOMENT = np.array([2e-5, 4e-5, -3e-5])


def order(steps: list[float], errors: list[float]) -> float:
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def body(T: float, duration: float, force: Any = (), moment: Any = (), **given: Any) -> Any:
    """A body after `duration` under a held wrench."""
    state = np.zeros(at.SIZE)
    fill_body(state, **given)
    state[at.FORCE : at.FORCE + len(force)] = force
    state[at.MOMENT : at.MOMENT + len(moment)] = moment
    made = NativeBody(state)
    for _ in range(round(duration / T)):
        made.step(T)
    return made


# Translation and plane rotation --------------------------------------------------------------------------------------


def viscous(x: float, v: float, u: float, a: float, t: float) -> tuple[float, float]:
    """x, v after t of v' = u - a v, at 60 digits."""
    with mpmath.workdps(60):
        x, v, u, a, t = (mpmath.mpf(value) for value in (x, v, u, a, t))
        if a == 0:
            return float(x + v * t + u * t * t / 2), float(v + u * t)
        one = (1 - mpmath.exp(-a * t)) / a
        return float(x + one * v + (t - one) / a * u), float(v * mpmath.exp(-a * t) + one * u)


@pytest.mark.parametrize("integrator", ["explicit", "semi-implicit", "implicit"])
def test_first_order_in_translation_and_plane_rotation(integrator: str) -> None:
    """b/m = 8 1/s over 0.5 s from 0.3 m/s at 0.2 N: errors go with T."""
    steps = [0.01, 0.005, 0.0025, 0.00125]
    x, v = viscous(0.1, 0.3, 2.0 - 1.5, 8.0, 0.5)
    angle, w = viscous(0.2, 3.0, 1e-4 / 4e-5, 7.5, 0.5)
    errors = []
    for T in steps:
        made = body(
            T, 0.5, (0.2, 0.0), (0.0, 0.0, 1e-4), dimensions=2, mass=0.1, inertia=4e-5, viscosity=0.8,
            gravity=(-1.5, 0.0), rotational_viscosity=3e-4, position=(0.1, 0.0), velocity=(0.3, 0.0), orientation=0.2,
            angular_velocity=3.0, integrator=integrator,
        )  # fmt: skip
        motion = [made.position[0], made.velocity[0], made.orientation, made.angular_velocity]
        errors.append(np.abs(np.array(motion, dtype=float) - [x, v, angle, w]))
    for k, what in enumerate(("x", "v", "angle", "w")):
        found = order(steps, [e[k] for e in errors])
        assert found == pytest.approx(1.0, abs=0.06), what


@pytest.mark.parametrize("z", [0.0, 1e-12, 1e-6, 1e-3, 0.04, 0.3, 0.999, 1.0, 3.0, 30.0, 1e3])
def test_exact_is_rounding_for_held_forces_at_any_viscosity(z: float) -> None:
    """One step of b T/m = z against 60 digits: 1e-15 of the terms that make it up."""
    T, m, x0, v0, f, g = 0.005, 0.1, 0.02, -0.7, 0.3, 9.81
    made = body(T, T, (f,), dimensions=1, mass=m, viscosity=z * m / T, gravity=[g], position=[x0], velocity=[v0],
                integrator="exact")  # fmt: skip
    x, v = viscous(x0, v0, f / m + g, z / T, T)
    assert made.position[0] == pytest.approx(x, abs=1e-15 * (abs(x0) + T * abs(v0)))
    assert made.velocity[0] == pytest.approx(v, abs=1e-15 * (abs(v0) + T * (f / m + g)))


def test_exact_equals_the_matrix_exponential_after_200_steps() -> None:
    """Forces that change every sample, x and v carried on by scipy's expm: 1e-14 of the largest."""
    rng = np.random.default_rng(0)
    T, m, b = 0.005, 0.1, 0.8
    E = expm(T * np.array([[0, 1, 0], [0, -b / m, 1 / m], [0, 0, 0]]))
    state = np.zeros(at.SIZE)
    fill_body(state, dimensions=1, mass=m, viscosity=b, position=[0.01], integrator="exact")
    made, y, largest = NativeBody(state), np.array([0.01, 0.0]), np.zeros(2)
    for _ in range(200):
        f = rng.normal()
        state[at.FORCE] = f
        made.step(T)
        y = (E @ np.append(y, f))[:2]
        largest = np.maximum(largest, np.abs(y))
        assert abs(made.position[0] - y[0]) <= 1e-14 * largest[0]
        assert abs(made.velocity[0] - y[1]) <= 1e-14 * largest[1]


@pytest.mark.parametrize("z", [0.0, 1e-9, 1e-3, 0.04, 0.5, 0.999, 1.0, 1.5, 20.0, 1e3])
def test_the_integrals_of_the_exponential(z: float) -> None:
    """Each to 1e-14 relative of 60 digits, over the seam between series and closed form."""
    E, one, two, turn = decay_integrals(z)
    with mpmath.workdps(60):
        x = mpmath.mpf(z)
        if z == 0.0:
            expected = [1.0, 1.0, 0.5, 1 / 12]
        else:
            e = mpmath.exp(-x)
            expected = [e, (1 - e) / x, (x - 1 + e) / x**2, (x + x * e - 2 + 2 * e) / (2 * x**3)]
        np.testing.assert_allclose([E, one, two], [float(v) for v in expected[:3]], rtol=1e-15)
        assert turn == pytest.approx(float(expected[3]), rel=1e-14)


# Rotation in space ---------------------------------------------------------------------------------------------------


@cache
def turned(inertia: tuple[float, ...], free: tuple[int, ...], viscosity: float, duration: float) -> tuple[Array, Array]:
    """Quaternion and angular velocity by Euler's equations in world axes, DOP853 with rtol 1e-13.

    With some rotations locked: the equations of the free axes, the others held still.
    """
    axes = np.flatnonzero(free)

    def rate(_: float, y: Array) -> Array:
        x, y_, z, s = y[:4] / np.linalg.norm(y[:4])
        R = np.array(
            [
                [1 - 2 * (y_ * y_ + z * z), 2 * (x * y_ - z * s), 2 * (x * z + y_ * s)],
                [2 * (x * y_ + z * s), 1 - 2 * (x * x + z * z), 2 * (y_ * z - x * s)],
                [2 * (x * z - y_ * s), 2 * (y_ * z + x * s), 1 - 2 * (x * x + y_ * y_)],
            ]
        )
        w, world = y[4:], R @ np.diag(inertia) @ R.T
        right = MOMENT - viscosity * w - np.cross(w, world @ w)
        change = np.zeros(3)
        change[axes] = np.linalg.solve(world[np.ix_(axes, axes)], right[axes])
        v = y[:3]
        return np.concatenate([0.5 * (w * y[3] + np.cross(w, v)), [-0.5 * w @ v], change])

    first = np.concatenate([QUATERNION, SPIN * free])
    found = solve_ivp(rate, (0.0, duration), first, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    return found[:4] / np.linalg.norm(found[:4]), found[4:]


def angle_between(p: Array, q: Array) -> float:
    """The angle [rad] of the rotation from one quaternion to another, accurate when it is small."""
    v = p[3] * q[:3] - q[3] * p[:3] - np.cross(q[:3], p[:3])
    return 2.0 * math.asin(min(1.0, float(np.linalg.norm(v))))


def errors_in_space(
    integrator: str, T: float, inertia: tuple[float, ...], free: tuple[int, ...], viscosity: float, duration: float
) -> tuple[float, float]:
    made = body(
        T, duration, (), MOMENT, dimensions=3, mass=0.1, inertia=inertia, rotational_viscosity=viscosity,
        free=(1, 1, 1, *free), orientation=QUATERNION, angular_velocity=SPIN * free, integrator=integrator,
    )  # fmt: skip
    q, w = turned(inertia, free, viscosity, duration)
    found = made.state[at.QUATERNION : at.QUATERNION + 4]
    spin = made.state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3]
    return angle_between(found, q), float(np.linalg.norm(spin - w))


@pytest.mark.parametrize("integrator", ["explicit", "semi-implicit", "implicit"])
@pytest.mark.parametrize("free", [(1, 1, 1), (1, 1, 0), (0, 1, 0)])
def test_first_order_in_space(integrator: str, free: tuple[int, ...]) -> None:
    steps = [0.005, 0.0025, 0.00125, 0.000625]
    errors = [errors_in_space(integrator, T, CROOKED, free, 1e-4, 0.5) for T in steps]
    assert order(steps, [e[0] for e in errors]) == pytest.approx(1.0, abs=0.08)
    assert order(steps, [e[1] for e in errors]) == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("free", [(1, 1, 1), (1, 1, 0), (0, 1, 1)])
@pytest.mark.parametrize("viscosity", [0.0, 1e-4])
def test_exact_is_of_fourth_order_for_any_inertia(free: tuple[int, ...], viscosity: float) -> None:
    """Runge-Kutta-Munthe-Kaas; steps that are not divided further (|w| T and b T/I below 0.1)."""
    steps = [0.025, 0.0125, 0.00625]
    errors = [errors_in_space("exact", T, CROOKED, free, viscosity, 0.5) for T in steps]
    assert order(steps, [e[0] for e in errors]) == pytest.approx(4.0, abs=0.25)
    assert order(steps, [e[1] for e in errors]) == pytest.approx(4.0, abs=0.25)


@pytest.mark.parametrize("viscosity", [0.0, 1e-4, 4e-3])
def test_isotropic_inertia_has_an_exact_velocity_and_a_turn_of_fourth_order(viscosity: float) -> None:
    """Also at b_w T/I = 2.5 and with one axis locked, where nothing but the moment changes."""
    steps = [0.025, 0.0125, 0.00625]
    for free in ((1, 1, 1), (1, 0, 1)):
        errors = [errors_in_space("exact", T, EVEN, free, viscosity, 0.5) for T in steps]
        assert max(e[1] for e in errors) < 5e-13  # the reference's own
        if viscosity < 1e-3:
            assert order(steps, [e[0] for e in errors]) == pytest.approx(4.0, abs=0.2)
        assert errors[-1][0] < 1e-10


def test_one_free_axis_is_exact() -> None:
    for T in (0.1, 0.005):
        turn, spin = errors_in_space("exact", T, CROOKED, (0, 0, 1), 1e-4, 0.5)
        assert turn < 1e-12  # the reference's own
        assert spin < 1e-12


@pytest.mark.parametrize("viscosity", [0.0, 3e-4])
def test_a_second_of_tumbling_at_five_milliseconds(viscosity: float) -> None:
    """Less than 2e-9 rad, the figure that a fourth-order step is good for here; semi-implicit is 1e-3 off and more."""
    assert errors_in_space("exact", 0.005, CROOKED, (1, 1, 1), viscosity, 1.0)[0] < 2e-9
    assert errors_in_space("semi-implicit", 0.005, CROOKED, (1, 1, 1), viscosity, 1.0)[0] > 1e-3


def test_strong_viscosity_is_divided_until_it_is_stable() -> None:
    """b_w T/I = 50 with a crooked inertia: a plain fourth-order step would grow by 2e5 each time; w ends at m/b_w."""
    T, b = 0.005, 50 * 3e-5 / 0.005
    made = body(
        T, 0.1, (), MOMENT, dimensions=3, mass=0.1, inertia=CROOKED, rotational_viscosity=b, orientation=QUATERNION,
        angular_velocity=SPIN, integrator="exact",
    )  # fmt: skip
    np.testing.assert_allclose(made.angular_velocity, MOMENT / b, rtol=1e-6)
    assert errors_in_space("exact", T, CROOKED, (1, 1, 1), b, 0.1)[0] < 1e-7
