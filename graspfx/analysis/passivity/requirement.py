"""The damping of a device that a display requires, and how stiff a wall may be, for any operator."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.arguments import number
from graspfx.analysis.passivity.display import Display, StateSpace, display, never_passive, symmetric
from graspfx.analysis.passivity.frequency import required_at, worst_on_grid
from graspfx.analysis.passivity.pencil import PositiveReal

FloatArray = NDArray[np.float64]


def wall_limit(damping: float, period: float, *, wall_damping: float = 0.0, delay: float = 0.0) -> float:
    """Compute K = (b - |B|)/(T/2 + t_d): b > K (T/2 + t_d) + |B| [N/m] (Colgate, Schenkel 1997; Diolaiti et al. 2006).

    The wall's force K x + B (x_k - x_{k-1})/T is held over a sample and reaches the device t_d late.

    | delay t_d | B | the limit is |
    |---|---|---|
    | none | any | exact: passive below, not above |
    | whole samples | B <= 0 | exact |
    | whole samples | B > 0 | safe, and low: its two terms are worst at different frequencies |
    | part of a sample | any | up to 7.7 % too high; `guaranteed_wall_limit` is safe |

    Args:
        damping: b of the device [N s/m].
        period: T [s].
        wall_damping: B [N s/m].
        delay: t_d [s].

    Returns:
        The largest stiffness, 0 where B alone takes all of the device's damping.

    Raises:
        InputError: a period that is not positive, a negative damping or delay, numbers that are not finite.
    """
    b, T, t = _wall(damping, period, wall_damping, delay)
    return max(0.0, (b - abs(wall_damping)) / (T / 2 + t))


def guaranteed_wall_limit(damping: float, period: float, *, wall_damping: float = 0.0, delay: float = 0.0) -> float:
    """Compute K = 2 (b - |B|)/(T [a + sqrt(a^2 + p (1 - p))]) [N/m], a = 1/2 + t_d/T, p the part of a sample in t_d.

    Safe for every operator, delay and B, and exact for B = 0: an operator may move fast while the force is still the
    old one and slowly afterwards, which costs up to 7.2 % of the stiffness of `wall_limit` (at t_d = T/4). For delays
    of whole samples the two are equal.

    Args and errors: as `wall_limit`.
    """
    b, T, t = _wall(damping, period, wall_damping, delay)
    p = t / T - math.floor(t / T)
    a = 0.5 + t / T
    return max(0.0, 2 * (b - abs(wall_damping)) / (T * (a + math.sqrt(a * a + p * (1 - p)))))


def required_damping(H: object, period: float) -> float:
    """Compute sup over w in (0, pi/T] of T/(2 (1 - cos wT)) Re{(1 - e^{-jwT}) H(e^{jwT})} [N s/m].

    A device of mass and damping b that shows H through a hold is passive to every operator iff b exceeds this
    (Colgate and Schenkel 1997). With n channels: largest eigenvalue of the Hermitian part, for devices of equal b.

    Matrices are searched without a grid, to about 1e-9 (`PositiveReal`); a function of z by an adaptive grid, to about
    1e-9 where H has no time constant above 10000 samples and no resonance much narrower than pi/256.

    Args:
        H: force that opposes the motion over position [N/m]: a function of z, a number or (n, n); (A, B, C, D); an
            object with these, as of python-control or SciPy; or a constant stiffness.
        period: T [s].

    Returns:
        The damping; infinity where none is enough: H unstable (a function's stability is the caller's word), or the
        static stiffness H(1) not symmetric or negative. Negative where H itself takes energy at every frequency.

    Raises:
        InputError: matrices that do not fit, a continuous system, another sampling period than `period`.
    """
    system = display(H, period)
    return _lack(system, np.zeros((system.channels, system.channels)), period)


def damping_margin(H: object, damping: ArrayLike, period: float) -> float:
    """Compute the least eigenvalue over th of B - T/(2 (1 - cos th)) Herm{(1 - e^{-j th}) H(e^{j th})} [N s/m].

    Not negative iff a device with damping B shows H passively at all its channels together (the Loewner order), to
    every operator who may hold all of them; minus infinity where no damping is enough.

    Args:
        H, period: as `required_damping`.
        damping: B, one number, (n,) or a symmetric (n, n) [N s/m].
    """
    system = display(H, period)
    return -_lack(system, symmetric("damping", damping, system.channels), period)


def _lack(system: Display, B: FloatArray, T: float) -> float:
    scale = float(np.abs(required_at(system, np.array([np.pi]), T)).max()) / T
    if never_passive(system, scale):
        return math.inf
    if isinstance(system, StateSpace):
        return PositiveReal(system, B, T).worst()[0]
    return worst_on_grid(system, B, T)[0]


def _wall(damping: float, period: float, wall_damping: float, delay: float) -> tuple[float, float, float]:
    number("wall_damping", wall_damping, "N s/m", negative=True)
    return (
        number("damping", damping, "N s/m"),
        number("period", period, "s", zero=False),
        number("delay", delay, "s"),
    )
