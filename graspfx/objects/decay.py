"""Step of one degree of freedom with linear viscosity, for each integrator: v' = u - a v with u constant."""

from __future__ import annotations

from dataclasses import dataclass

from graspfx import elementary
from graspfx.compile.kernel import inline, kernel
from graspfx.objects.body_state import EXACT, EXPLICIT, IMPLICIT, SEMI_IMPLICIT, Decay


@dataclass(frozen=True, slots=True)
class Coefficients:
    """Coefficients of the step x+ = x + p v + q u, v+ = r v + s u, which all four integrators share."""

    p: float
    q: float
    r: float
    s: float


def decay_integrals(z: float) -> tuple[float, float, float, float]:
    """Compute E = exp(-z) and its integrals (1 - E)/z, (z - 1 + E)/z^2, (z + z E - 2 + 2 E)/(2 z^3), to rounding.

    The integrals determine velocity, displacement and the rotation of the axis under a constant wrench. For small z a
    series avoids cancellation.
    """
    if z >= 1.0:
        E = elementary.exp(-z)
        return E, (1.0 - E) / z, (z - 1.0 + E) / (z * z), (z + z * E - 2.0 + 2.0 * E) / (2.0 * z * z * z)
    term = 0.5  # (-z)^(k - 2)/k!
    two = term
    turn = 0.0
    k = 3
    while abs(term) > 1e-18:
        turn += 0.5 * (k - 2) * term / k  # (k - 2) (-z)^(k - 3)/(2 k!)
        term *= -z / k
        two += term
        k += 1
    return elementary.exp(-z), 1.0 - z * two, two, turn


@kernel
def update_decay(decay: Decay, z: float) -> None:
    """Compute the integrals for z, unless the block already contains them."""
    if decay.z != z or decay.exponential == 0.0:
        decay.z = z
        decay.exponential, decay.first, decay.second, decay.turn = decay_integrals(z)


@kernel
def coefficients(kind: int, a: float, T: float) -> Coefficients:
    """Compute the coefficients of an integrator's step of T [s] at the decay rate a [1/s]."""
    if kind == EXPLICIT:
        return Coefficients(T, 0.0, 1.0 - T * a, T)
    if kind == SEMI_IMPLICIT:
        r = 1.0 - T * a
        return Coefficients(T * r, T * T, r, T)
    if kind == IMPLICIT:
        r = 1.0 / (1.0 + T * a)
        return Coefficients(T * r, T * T * r, r, T * r)
    E, one, two, _ = decay_integrals(a * T)
    return exact_coefficients(T, E, one, two)


@inline
def exact_coefficients(T: float, E: float, one: float, two: float) -> Coefficients:
    """Return the coefficients of the exact integrator from the integrals of the decay."""
    return Coefficients(T * one, T * T * two, E, T * one)


@kernel
def step_coefficients(decay: Decay, kind: int, a: float, T: float) -> Coefficients:
    """Compute the coefficients of any integrator; for the exact one, use the integrals in the block."""
    if kind != EXACT:
        return coefficients(kind, a, T)
    update_decay(decay, a * T)
    return exact_coefficients(T, decay.exponential, decay.first, decay.second)
