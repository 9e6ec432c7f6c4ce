"""Bodies over masses, sizes, viscosities, periods and speeds: closed forms at 50 digits, what is conserved, units."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from graspfx.objects import integrators as at
from graspfx.objects.body import INTEGRATORS, NativeBody, fill_body
from tests.support.exact import DIGITS
from tests.support.exact_bodies import exact_step, spinning
from tests.support.families import efforts, family
from tests.support.scatter import decades

FloatArray = NDArray[np.float64]

PATH = family("bodies: translation, plane rotation", "50 digits, of the path so far")
SPIN = family("bodies: spin under a held moment, equal moments of inertia", "50 digits, of the largest spin")
TURN = family("bodies: orientation, equal moments of inertia", "scipy DOP853, per radian turned", "rad")
KEPT = family("bodies: energy and momentum of a free box, 'exact'", "their initial values")
UNIT = family("bodies: other units", "the same bits")
PREDICTED = family("bodies: implicit prediction", "the step taken afterwards, of the path")
NORM = family("bodies: quaternion", "norm 1")

EPS = np.finfo(float).eps
STEPS = 40


def random_body(rng: np.random.Generator, d: int, integrator: str, **more: Any) -> tuple[FloatArray, float, str]:
    """A block, T and what they are: 1e-6 to 1e3 kg, 1 um to 1 km, 0.05 to 20 ms, up to 10 m/s, viscosity b T/m."""
    m, size, T = decades(rng, 1e-6, 1e3), decades(rng, 1e-6, 1e3), decades(rng, 5e-5, 2e-2)
    most = 1.9 if integrator in ("explicit", "semi-implicit") else 1e3
    z = decades(rng, 1e-9, most) if rng.random() < 0.8 else 0.0
    away = 1e3 * (rng.random() < 0.5)
    state = np.zeros(at.SIZE)
    inertia: Any = None
    if d == 2:
        inertia = 0.2 * m * size**2
    if d == 3:
        a, b, c = rng.uniform(0.3, 1.0, 3) * size
        inertia = m / 5.0 * np.array([b * b + c * c, c * c + a * a, a * a + b * b])
    given: dict[str, Any] = {
        "dimensions": d, "mass": m, "inertia": inertia, "viscosity": z * m / T, "integrator": integrator,
        "rotational_viscosity": 0.0 if inertia is None else z * float(np.min(inertia)) / T,
        "velocity": rng.uniform(-10.0, 10.0, d), "position": away * rng.normal(size=d),
        "gravity": 9.81 * rng.normal(size=d),
    }  # fmt: skip
    fill_body(state, **{**given, **more})
    label = f"{integrator}, {d}-D, {m:.1e} kg, {size:.1e} m, {1e3 * T:.2g} ms, b T/m {z:.1e}, {away:g} m away"
    return state, T, label


@efforts(short=8, full=400)
def test_translation_and_plane_rotation(cases: int) -> None:
    rng = np.random.default_rng(21)
    for case in range(cases):
        kind = list(INTEGRATORS)[case % 4]
        d = int(rng.integers(1, 3))
        state, T, label = random_body(rng, d, kind)
        if d == 2:
            state[at.ANGULAR_VELOCITY + 2] = rng.uniform(-1.0, 1.0) / T
        body = NativeBody(state)
        freedoms = [(at.POSITION + a, at.VELOCITY + a, at.FORCE + a, at.MASS, at.VISCOSITY) for a in range(d)]
        if d == 2:
            freedoms.append((at.ANGLE, at.ANGULAR_VELOCITY + 2, at.MOMENT + 2, at.INERTIA + 2, at.ROTATIONAL_VISCOSITY))
        with mp.workdps(DIGITS):
            kept = [(mp.mpf(float(state[x])), mp.mpf(float(state[v]))) for x, v, *_ in freedoms]
            path = [abs(float(x)) for x, _ in kept]
            for _ in range(STEPS):
                for _, v, f, m, _ in freedoms:
                    state[f] = rng.normal() * (abs(state[v]) + 1.0) * state[m] / T
                before = state[[x for x, *_ in freedoms]]
                for i, (_, _, f, m, b) in enumerate(freedoms):
                    mass = mp.mpf(float(state[m]))
                    g = mp.mpf(float(state[at.GRAVITY + i])) if i < d else mp.mpf(0)
                    u, z = mp.mpf(float(state[f])) / mass + g, mp.mpf(float(state[b])) / mass * mp.mpf(T)
                    kept[i] = exact_step(kind, *kept[i], u, z, mp.mpf(T))
                body.step(T)
                for i, (x, v, *_) in enumerate(freedoms):
                    path[i] += abs(float(state[x] - before[i])) + T * abs(float(state[v]))
            for (x, _, *_), (at_end, _), length in zip(freedoms, kept, path, strict=True):
                error = abs(float(mp.mpf(float(state[x])) - at_end)) / length
                PATH.check(error, STEPS * EPS, f"case {case}: {label}")


@efforts(short=4, full=200)
def test_bodies_with_equal_moments_of_inertia(cases: int) -> None:
    rng = np.random.default_rng(22)
    for case in range(cases):
        inertia = decades(rng, 1e-18, 1e6)
        state, T, label = random_body(rng, 3, "exact", inertia=inertia)
        z = decades(rng, 1e-6, 1e3) if case % 4 else 0.0
        state[at.ROTATIONAL_VISCOSITY] = z * inertia / T
        turned = rng.uniform(0.01, 0.5)  # per sample [rad]
        w0 = rng.normal(size=3)
        w0 *= turned / T / np.linalg.norm(w0)
        state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3] = w0
        moment = rng.normal(size=3) * turned * inertia / T**2 * 0.3 * max(1.0, z)
        state[at.MOMENT : at.MOMENT + 3] = moment
        body, b = NativeBody(state), float(state[at.ROTATIONAL_VISCOSITY])
        for _ in range(5):
            body.step(T)
        w = state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3]
        with mp.workdps(DIGITS):
            t, J = 5 * mp.mpf(T), mp.mpf(inertia)
            rate = mp.mpf(b) / J
            E = mp.exp(-rate * t)
            over = (1 - E) / rate if b else t
            pairs = zip(w0.tolist(), moment.tolist(), strict=True)
            exact = [float(mp.mpf(p) * E + mp.mpf(q) / J * over) for p, q in pairs]
        largest = max(np.abs(w0).max(), np.abs(exact).max())
        SPIN.check(float(np.abs(w - exact).max()) / largest, 40.0 * EPS, f"case {case}: b_w T/I {z:.1e}, {label}")
        if z < 10.0:
            q = reference(w0 * T, moment * T * T / inertia, z, 5)
            wrong = 2.0 * min(float(np.abs(state[at.QUATERNION : at.QUATERNION + 4] - s * q).max()) for s in (1, -1))
            # what Magnus leaves out are commutators of three velocities
            turned = max(np.abs(w0).max(), np.abs(w).max()) * T
            told = f"case {case}: {turned:.2g} rad a sample, b_w T/I {z:.1e}"
            TURN.check(wrong / 5.0, 5e-3 * turned**3 + 1e-13, told)
        NORM.check(abs(float(np.linalg.norm(state[at.QUATERNION : at.QUATERNION + 4])) - 1.0), 4.0 * EPS, label)


def reference(w0: FloatArray, acceleration: FloatArray, z: float, duration: int) -> FloatArray:
    """The quaternion after `duration` samples, time in samples, by an integrator of eighth order."""

    def rate(_: float, y: FloatArray) -> FloatArray:
        q, w = y[:4], y[4:]
        turning = 0.5 * np.r_[w * q[3] + np.cross(w, q[:3]), -w @ q[:3]]
        return np.r_[turning, acceleration - z * w]

    found = solve_ivp(rate, (0.0, duration), np.r_[0.0, 0.0, 0.0, 1.0, w0], method="DOP853", rtol=1e-13, atol=1e-15)
    q: FloatArray = found.y[:4, -1]
    return q / np.linalg.norm(q)


@efforts(short=3, full=100)
def test_a_free_box_keeps_its_energy_and_momentum(cases: int) -> None:
    rng = np.random.default_rng(23)
    for case in range(cases):
        state, T, label = random_body(rng, 3, "exact", viscosity=0.0, rotational_viscosity=0.0)
        turned = decades(rng, 1e-4, 1.0)
        w = rng.normal(size=3)
        state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3] = w * turned / T / np.linalg.norm(w)
        body, before = NativeBody(state), spinning(state)
        for _ in range(200):
            body.step(T)
        after = spinning(state)
        energy = abs(after[0] - before[0]) / before[0]
        momentum = float(np.linalg.norm(after[1] - before[1]) / np.linalg.norm(before[1]))
        # fourth order in strides of at most 0.1 rad
        allowed = 200.0 * (2e-2 * min(turned, 0.1) ** 4 * turned + 4.0 * EPS)
        KEPT.check(max(energy, momentum), allowed, f"case {case}: {turned:.2g} rad a sample, {label}")
        NORM.check(abs(float(np.linalg.norm(state[at.QUATERNION : at.QUATERNION + 4])) - 1.0), 4.0 * EPS, label)


@efforts(short=6, full=400)
def test_units_do_not_matter_to_the_last_bit(cases: int) -> None:
    # lengths, masses and times in units that are powers of two: every number of the motion scales, none is rounded
    rng = np.random.default_rng(24)
    for case in range(cases):
        d, kind = int(rng.integers(1, 4)), list(INTEGRATORS)[case % 4]
        state, T, label = random_body(rng, d, kind)
        state[at.ROTATIONAL_VISCOSITY] = min(state[at.ROTATIONAL_VISCOSITY], state[at.INERTIA + 2] / T)
        if d > 1:
            spin = rng.normal(size=3) * [d == 3, d == 3, True]
            state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3] = spin * rng.uniform(0.0, 0.1) / T
        length, weight, time = (2.0 ** int(rng.integers(-20, 20)) for _ in range(3))
        units = unit_of(length, weight, time)
        other = state * units
        for _ in range(STEPS // 4):
            push = rng.normal(size=6) * np.r_[np.full(3, state[at.MASS]), np.full(3, state[at.INERTIA + 2])] / T
            push[d:3] = 0.0
            push[3:] *= [d == 3, d == 3, d > 1]
            state[at.FORCE : at.FORCE + 6] = push
            other[at.FORCE : at.FORCE + 6] = push * units[at.FORCE : at.FORCE + 6]
            NativeBody(state).step(T)
            NativeBody(other).step(T * time)
        UNIT.check(0.0 if np.array_equal(state * units, other) else 1.0, 0.0, f"case {case}: {label}")


def unit_of(length: float, weight: float, time: float) -> FloatArray:
    """Give the factor of each entry of a block in other units."""
    units = np.ones(at.SIZE)
    force = weight * length / time**2
    for first, count, unit in (
        (at.MASS, 1, weight), (at.INERTIA, 3, weight * length**2), (at.VISCOSITY, 1, weight / time),
        (at.ROTATIONAL_VISCOSITY, 1, weight * length**2 / time), (at.GRAVITY, 3, length / time**2),
        (at.POSITION, 3, length), (at.VELOCITY, 3, length / time), (at.ANGULAR_VELOCITY, 3, 1.0 / time),
        (at.FORCE, 3, force), (at.MOMENT, 3, force * length),
    ):  # fmt: skip
        units[first : first + count] = unit
    return units


@efforts(short=5, full=500)
def test_the_implicit_prediction_is_the_step(cases: int) -> None:
    rng = np.random.default_rng(25)
    for case in range(cases):
        state, T, label = random_body(rng, 1, "implicit")
        state[at.FORCE] = rng.normal() * state[at.MASS] * 10.0 / T
        body = NativeBody(state)
        body.free_motion(T)
        predicted = state[at.NEXT_POSITION] + state[at.COMPLIANCE] * state[at.FORCE]
        body.step(T)
        size = abs(state[at.POSITION]) + abs(state[at.COMPLIANCE] * state[at.FORCE])
        PREDICTED.check(abs(float(predicted - state[at.POSITION])) / size, 2.0 * EPS, f"case {case}: {label}")
