"""Limits of stability and passivity over masses, periods, viscosities and gains: closed loops at 50 digits, units."""

from __future__ import annotations

import math
from typing import Any

import mpmath as mp
import numpy as np
import pytest

import graspfx as gx
from tests.support.exact import DIGITS
from tests.support.families import efforts, family
from tests.support.scatter import decades

WALL = family(
    "stability: wall", "spectral radius at 50 digits: below 1 up to 1e-7 under the limit, above 1 from 1e-7 over it"
)
EXTERNAL = family("stability: object", "spectral radius at 50 digits, as for a wall")
UNITS = family("stability and passivity: other units", "the same numbers")
DAMPING = family("passivity: required damping", "the supremum on a fine grid, polished")

NEAR = mp.mpf("1e-7")


def held_device(m: float, b: float, k: float, T: float) -> tuple[Any, Any]:
    """Transition (2, 2) of a device over a sample, and what a held force adds, at the working precision."""
    m, b, k, T = (mp.mpf(v) for v in (m, b, k, T))
    E = mp.expm(mp.matrix([[0, 1, 0], [-k / m, -b / m, 1 / m], [0, 0, 0]]) * T)
    return E[:2, :2], E[:2, 2]


def held_object(kind: str, m: float, b: float, T: float) -> tuple[Any, Any, Any, Any]:
    """p, q, r, s of x+ = x + p v + q f, v+ = r v + s f."""
    m, b, T = (mp.mpf(v) for v in (m, b, T))
    z = b / m * T
    E = mp.exp(-z)
    one, two = ((1 - E) / z, (z - 1 + E) / z**2) if z else (mp.mpf(1), mp.mpf(1) / 2)
    if kind == "explicit":
        return T, mp.mpf(0), 1 - z, T / m
    if kind == "semi-implicit":
        return T * (1 - z), T * T / m, 1 - z, T / m
    if kind == "bullet":
        return T * (1 - z * one), T * T * one / m, E, T * one / m
    return T * one, T * T * two / m, E, T * one / m


def radius(A: Any) -> Any:
    return max(abs(value) for value in mp.eig(A, left=False, right=False))


def wall_loop(k: Any, m: float, b: float, T: float, spring: float, B: float, delay: int) -> Any:
    """States x, v, x_(j-1), forces not yet displayed."""
    M, g = held_device(m, b, spring, T)
    size = 3 + delay
    A = mp.zeros(size)
    A[:2, :2] = M
    rate = mp.mpf(B) / mp.mpf(T)
    force = mp.matrix([[k + rate, 0, -rate] + [0] * delay])
    A[2, 0] = 1
    shown = force
    if delay:
        A[3, :] = force
        for i in range(4, size):
            A[i, i - 1] = 1
        shown = mp.zeros(1, size)
        shown[size - 1] = 1
    A[:2, :] = A[:2, :] - g * shown
    return A


def first_loss(loop: Any, limit: float, scale: float, label: str) -> int:
    """Stable below the limit, at its edge and at a dozen stiffnesses under it, and not above; how many were asked."""
    asked = [mp.mpf(limit) * (1 - NEAR)] if limit < math.inf else []
    top = limit if limit < math.inf else 1e6 * scale
    asked += [mp.mpf(top) * share for share in (1e-3, 0.03, 0.2, 0.4, 0.6, 0.8, 0.95)]
    for k in asked:
        assert radius(loop(k)) < 1, f"{label}: not stable at {float(k):.6g} N/m, below the limit {limit:.6g}"
    if limit < math.inf:
        assert radius(loop(mp.mpf(limit) * (1 + NEAR))) > 1, f"{label}: still stable above the limit {limit:.6g}"
    return len(asked) + 1


@efforts(short=4, full=80)
def test_walls(cases: int) -> None:
    rng = np.random.default_rng(51)
    with mp.workdps(DIGITS):
        for case in range(cases):
            m, T = decades(rng, 1e-6, 1e3), decades(rng, 5e-5, 2e-2)
            b = decades(rng, 1e-6, 1e3) * m / T
            spring = decades(rng, 1e-6, 1.0) * m / T**2 * (rng.random() < 0.5)
            B, delay = 0.3 * b * rng.random() * (rng.random() < 0.4), int(rng.integers(0, 3))
            label = f"case {case}: {m:.2e} kg, {1e3 * T:.2g} ms, b T/m {b * T / m:.1e}, B {B:.1e}, delay {delay}"
            limit = gx.stability.wall_limit(m, b, T, spring=spring, wall_damping=B, delay=delay)
            assert limit > 0.0
            asked = first_loss(lambda k: wall_loop(k, m, b, T, spring, B, delay), limit, b / T + m / T**2, label)  # noqa: B023
            WALL.tried(asked)


@efforts(short=4, full=80)
def test_objects(cases: int) -> None:
    rng = np.random.default_rng(52)
    with mp.workdps(DIGITS):
        for case in range(cases):
            m, T, n = decades(rng, 1e-6, 1e3), decades(rng, 5e-5, 2e-2), int(rng.integers(1, 101))
            b, heavy = decades(rng, 1e-4, 1e3) * m / T, decades(rng, 1e-2, 1e2) * m
            kind = str(rng.choice(["explicit", "semi-implicit", "exact", "bullet"]))
            viscosity = decades(rng, 1e-4, 1.5) * heavy / T
            spring = decades(rng, 1e-4, 1.0) * m / T**2
            label = (
                f"case {case}: {kind}, {m:.2e} and {heavy:.2e} kg, {n} fingers, {1e3 * T:.2g} ms, b T/m {b * T / m:.1e}"
            )
            limit = gx.stability.external_limit(m, b, T, heavy, viscosity, fingers=n, spring=spring, integrator=kind)
            M, g = held_device(m, b, spring, T)
            p, q, r, s = held_object(kind, heavy / n, viscosity / n, T)

            def loop(k: Any, M: Any = M, g: Any = g, move: Any = (p, q, r, s)) -> Any:
                p, q, r, s = move
                A = mp.zeros(4)
                A[:2, :2] = M
                A[2, 2], A[2, 3], A[3, 3] = 1, p, r
                felt = mp.matrix([[k, 0, -k, 0]])
                A[:2, :] = A[:2, :] - g * felt
                A[2, :] = A[2, :] + q * felt
                A[3, :] = A[3, :] + s * felt
                return A

            if limit > 0.0:
                EXTERNAL.tried(first_loss(loop, limit, m / T**2 + b / T, label))
            else:
                assert radius(loop(mp.mpf(1e-6) * m / T**2)) > 1, label


@efforts(short=10, full=150)
def test_units(cases: int) -> None:
    rng = np.random.default_rng(53)
    for case in range(cases):
        m, T = decades(rng, 1e-3, 1e1), decades(rng, 5e-4, 2e-2)
        b, heavy = decades(rng, 1e-3, 10.0) * m / T, decades(rng, 1e-2, 1e2) * m
        viscosity, spring = decades(rng, 1e-3, 1.5) * heavy / T, decades(rng, 1e-4, 1.0) * m / T**2
        mass, time = 2.0 ** int(rng.integers(-20, 20)), 2.0 ** int(rng.integers(-10, 10))
        label = f"case {case}: {m:.2e} and {heavy:.2e} kg, {1e3 * T:.2g} ms"
        s, p, rate, stiff = gx.stability, gx.passivity, mass / time, mass / time**2
        kind = str(rng.choice(list(s.INTEGRATORS)))
        calls: list[Any] = [
            (s.wall_limit, {"spring": spring, "wall_damping": 0.1 * b}, (m, b, T)),
            (s.external_limit, {"spring": spring, "integrator": kind}, (m, b, T, heavy, viscosity)),
            (s.stable_intervals, {"spring": spring, "integrator": kind, "upper": 100.0 * m / T**2},
             (m, b, T, heavy, viscosity)),
            (p.wall_limit, {"wall_damping": 0.1 * b, "delay": 0.3 * T}, (b, T)),
            (p.guaranteed_wall_limit, {"wall_damping": 0.1 * b, "delay": 0.3 * T}, (b, T)),
        ]  # fmt: skip
        units = {"spring": stiff, "wall_damping": rate, "upper": stiff, "delay": time}
        for call, more, numbers in calls:
            own = (rate, time) if len(numbers) == 2 else (mass, rate, time, mass, rate)
            here = np.array(call(*numbers, **more))
            there = np.array(
                call(
                    *(a * unit for a, unit in zip(numbers, own, strict=False)),
                    **{key: value * units.get(key, 1.0) if key in units else value for key, value in more.items()},
                )
            )
            assert here.shape == there.shape, label
            finite = np.isfinite(here) & (here != 0.0)
            off = np.abs(there[finite] / (stiff * here[finite]) - 1.0).max(initial=0.0)
            UNITS.check(float(off), 1e-13, f"{label}, {call.__name__}")


def needed(H: Any, T: float, angle: float) -> float:
    """T/(2 (1 - cos th)) Re{(1 - e^-jth) H} as T/2 (Re H - cot(th/2) Im H), which does not cancel."""
    value = H(complex(math.cos(angle), math.sin(angle)))
    return 0.5 * T * (value.real - value.imag / math.tan(0.5 * angle))


@efforts(short=10, full=150)
def test_required_damping(cases: int) -> None:
    rng = np.random.default_rng(54)
    for case in range(cases):
        size, T, gain = int(rng.integers(1, 4)), decades(rng, 5e-5, 2e-2), decades(rng, 1e-3, 1e6)
        A = rng.normal(size=(size, size))
        A *= rng.uniform(0.1, 0.95) / max(abs(np.linalg.eigvals(A)))
        B, C = rng.normal(size=(size, 1)), gain * rng.normal(size=(1, size))
        static = float((C @ np.linalg.solve(np.eye(size) - A, B))[0, 0])
        D = np.array([[gain * rng.random() + max(0.0, -static)]])  # H(1) >= 0: a spring that pushes back
        found = gx.passivity.required_damping((A, B, C, D), T)

        def H(z: complex, A: Any = A, B: Any = B, C: Any = C, D: Any = D) -> complex:
            return complex((C @ np.linalg.solve(z * np.eye(len(A)) - A, B) + D)[0, 0])

        angles = np.r_[np.geomspace(1e-4, math.pi, 400), np.linspace(1e-3, math.pi, 400)]
        values = [needed(H, T, angle) for angle in angles]
        best = float(angles[int(np.argmax(values))])
        for step in 0.01 * 0.5 ** np.arange(25):  # climb from the best
            best = max((min(math.pi, best * (1 + side * step)) for side in (-1, 0, 1)), key=lambda a: needed(H, T, a))
        largest = max(needed(H, T, best), max(values))
        label = (
            f"case {case}: {size} states, {gain:.1e} N/m, {1e3 * T:.2g} ms, radius {max(abs(np.linalg.eigvals(A))):.2f}"
        )
        scale = gain * T
        DAMPING.check(max(largest - found, 0.0) / scale, 1e-12, label)  # never too small
        if best > 2e-4:  # at rest the supremum is a limit
            DAMPING.check(max(found - largest, 0.0) / scale, 1e-12, label)


@pytest.mark.parametrize("k", [1e-30, 1.0, 1e30])
def test_a_spring_needs_half_its_stiffness_times_the_period(k: float) -> None:
    assert math.isclose(gx.passivity.required_damping(k, 0.001), 0.0005 * k, rel_tol=1e-12)
