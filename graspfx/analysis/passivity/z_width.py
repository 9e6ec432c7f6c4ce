"""Z-width: the stiffnesses and dampings of a wall that a display shows passively, or at least stably."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx import plugins
from graspfx.analysis.arguments import number, numbers
from graspfx.analysis.passivity.requirement import guaranteed_wall_limit
from graspfx.analysis.stability.one_gain import wall_limit as stable_wall_limit
from graspfx.card import Card, Carded
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

COUNT = 161  # dampings of the wall


@dataclass(frozen=True, eq=False, repr=False)
class ZWidth(Carded):
    """The largest stiffness of a wall over its damping.

    Attributes:
        wall_damping: B, (k,) [N s/m].
        passive: the largest K that is passive to every operator, (k,) [N/m]; zero where B alone is not.
        stable: the largest K that is stable with the device let go of, (k,) [N/m], zero where none is; None without a
            mass.
    """

    wall_damping: FloatArray
    passive: FloatArray
    stable: FloatArray | None

    def plot(self, *, width: str = "screen") -> Any:
        """Draw the region; the figure is shown by a notebook, `.save(path)` writes it."""
        return plugins.upward("ZWidth.plot")(self, width=width)

    def _card(self) -> Card:
        low, high = self.wall_damping[0], self.wall_damping[-1]
        stable = "not computed: no mass" if self.stable is None else f"up to {self.stable.max():.4g} N/m"
        rows = [
            ("wall damping", f"{low:.4g} to {high:.4g} N s/m, {len(self.wall_damping)} of them"),
            ("passive", f"up to {self.passive.max():.4g} N/m"),
            ("stable", stable),
        ]
        return Card("Z-width: stiffness of a wall over its damping", rows, ".plot(), .wall_damping, .passive, .stable")


def z_width(
    damping: float,
    period: float,
    *,
    mass: float | None = None,
    delay: int = 0,
    wall_damping: ArrayLike | None = None,
    latency: float = 0.0,
) -> ZWidth:
    """Compute the largest stiffness of a wall K x + B (x_k - x_(k-1))/T over B (Colgate and Brown 1994).

    Passive: `guaranteed_wall_limit`, safe for every operator. Stable: `gx.stability.wall_limit`, of the device that
    nobody holds, which takes its mass.

    Args:
        damping: b of the device [N s/m].
        period: T [s].
        mass: m of the device [kg]; without it there is no `stable`.
        delay: whole samples until the force acts.
        latency: besides, of reading and force, any time [s].
        wall_damping: B, rising [N s/m]; if None up to where no stiffness is passive or, with a mass, stable.

    Raises:
        InputError: naming the argument that cannot be.
    """
    b, T = number("damping", damping, "N s/m"), number("period", period, "s", zero=False)
    late = Late(delay=delay, latency=number("latency", latency, "s"))
    if wall_damping is None:
        top = b if mass is None else max(b, _largest_damping(number("mass", mass, "kg", zero=False), b, T, late))
        top = 1.02 * top if top > 0.0 else 1.0
        B = np.linspace(0.0, top, COUNT) if mass is None else np.geomspace(1e-2 * (min(b, top) or top), top, COUNT)
    else:
        B = numbers("wall_damping", wall_damping, "N s/m")
    if B.ndim != 1 or not len(B) or (np.diff(B) <= 0.0).any():
        raise InputError("wall_damping", wall_damping, "rising numbers [N s/m]")
    passive = np.array(
        [guaranteed_wall_limit(b, T, wall_damping=each, delay=delay * T + latency) for each in B.tolist()]
    )
    stable = None
    if mass is not None:
        stable = np.array([stable_wall_limit(mass, b, T, wall_damping=each, **late) for each in B.tolist()])
    return ZWidth(B, passive, stable)


class Late(TypedDict):
    """Delay of a wall's force: whole samples, and seconds besides."""

    delay: int
    latency: float


def _largest_damping(m: float, b: float, T: float, late: Late) -> float:
    """Find about where the wall's damping alone is not stable any more, by doubling and halving."""
    high = max(b, m / T) * 1e-3
    while stable_wall_limit(m, b, T, wall_damping=high, **late) > 0.0 and high < 1e3 * m / T:
        high *= 2.0
    low = 0.5 * high
    for _ in range(20):
        middle = 0.5 * (low + high)
        if stable_wall_limit(m, b, T, wall_damping=middle, **late) > 0.0:
            low = middle
        else:
            high = middle
    return high
