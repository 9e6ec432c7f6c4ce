"""Sampled device on a wall or with an object, and the exact stability limits of the stiffness between them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.checked_arguments import lag_of_object, number, numbers, one_of, samples
from graspfx.analysis.critical import Limits, edges, first_loss, limits_of
from graspfx.analysis.discrete import INTEGRATORS, ONE_PLUS, S, late_device, object_response, plus, power, times
from graspfx.errors import InputError
from graspfx.numeric import count

FloatArray = NDArray[np.float64]

LATEST = 20  # largest delay [samples]; beyond, roots lose digits (4e-9 of |z| at 20, 1e-4 at 25)
BLOCK = 8192  # number of points of a map whose intermediate arrays fit into the processor's cache
UNITS = {
    "mass": "kg", "damping": "N s/m", "period": "s", "spring": "N/m", "spring_damping": "N s/m",
    "coupling_damping": "N s/m", "object_mass": "kg", "object_damping": "N s/m", "fingers": "fingers", "gain": "N/m",
}  # fmt: skip
OF_OBJECT = ("object_mass", "object_damping", "fingers")
ABOVE_ZERO = ("mass", "period", "object_mass", "fingers")


class WallOptions(TypedDict, total=False):
    """Keyword options of `stability.wall_limit`, which documents them, and of related functions."""

    spring: ArrayLike
    wall_damping: ArrayLike
    delay: int
    spring_damping: ArrayLike
    latency: float


class ObjectOptions(TypedDict, total=False):
    """Keyword options of `stability.external_limit`, which documents them, and of related functions."""

    fingers: ArrayLike
    spring: ArrayLike
    integrator: str
    delay: int
    object_delay: int
    coupling_damping: ArrayLike
    spring_damping: ArrayLike
    latency: float


@dataclass(frozen=True, eq=False)
class Plant:
    """A sampled device with an operator's hand, coupled by a stiffness k to a wall or to an object.

        m x'' + (b + b_s) x' + k_s x = -f,    m_v/n x_v'' + b_v/n x_v' = f
        f = k (x - x_v) + B ((x_j - x_(j-1))/T - x_v')                             x_v = 0 for a wall

    The force f is held over each sample j. Parameters are numbers or arrays that broadcast against one another.

    Attributes:
        mass, damping: Mass m [kg] and damping b [N s/m] of the device.
        period: Sampling period T [s].
        spring, spring_damping: Stiffness k_s [N/m] and damping b_s [N s/m] of the hand.
        coupling_damping: Damping B of the wall, or of the coupling to the object [N s/m].
        delay: Delay of the displayed force [samples].
        latency: Sum of the additional delays of the displayed force and of the reading [s].
        object_mass, object_damping: Mass m_v [kg] and viscosity b_v [N s/m] of the object that n fingers move; the mass
            is None for a wall.
        fingers: Number n of fingers.
        integrator: Integrator of the object.
        object_delay: Delay of the force on the object [samples].
        gain: Stiffness k to be tested for stability [N/m]; limits of k do not depend on it.
    """

    mass: Any
    damping: Any
    period: Any
    spring: Any = 0.0
    spring_damping: Any = 0.0
    coupling_damping: Any = 0.0
    delay: int = 0
    latency: float = 0.0
    object_mass: Any = None
    object_damping: Any = 0.0
    fingers: Any = 1
    integrator: str = "exact"
    object_delay: int = 0
    gain: Any = 0.0

    @property
    def _names(self) -> list[str]:
        return [name for name in UNITS if self.object_mass is not None or name not in OF_OBJECT]

    def checked(self, *, single: bool = False) -> Plant:
        """Check every parameter, and convert those with a unit in `UNITS` to arrays, or to numbers if `single`.

        Raises:
            InputError: If a parameter is invalid; the message names the parameter.
            UnknownNameError: If `integrator` is not one of `INTEGRATORS`.
        """
        check: Any = number if single else numbers
        values: dict[str, Any] = {}
        for name in self._names:
            called = "wall_damping" if name == "coupling_damping" and self.object_mass is None else name
            signed, above = name == "coupling_damping", name in ABOVE_ZERO
            values[name] = check(called, getattr(self, name), UNITS[name], zero=not above, negative=signed)
        if single:
            values["fingers"] = count("fingers", self.fingers, 1)
        elif (np.asarray(values.get("fingers", 1.0)) < 1.0).any():
            raise InputError("fingers", self.fingers, "1 or more in every entry")
        return replace(
            self,
            **values,
            delay=samples("delay", self.delay),
            latency=number("latency", self.latency, "s"),
            integrator=one_of("integrator", self.integrator, INTEGRATORS),
            object_delay=lag_of_object(self.object_delay, self.integrator),
        )

    @property
    def unit(self) -> Any:
        """Reference stiffness, device mass over squared period [N/m]."""
        return self.mass / self.period**2

    def polynomials(self) -> tuple[FloatArray, FloatArray]:
        """Return the polynomials D and N of the characteristic polynomial D + k N, in ascending powers of s = z - 1.

        On a wall, the characteristic polynomial is z^L [den + z^-delay (k + B (1 - 1/z)/T) num]. Here num/den is the
        transfer function of the device with its latency (`late_device`), and L is the smallest exponent that leaves no
        negative powers. With an object, B acts on the object's velocity state, not on a difference of its positions;
        the integrator "implicit" uses position and velocity at the end of the sample. Without a spring, no force
        opposes a common motion of device and object, so that D and N have a common root z = 1. This root is moved to z
        = 0, where it does not affect stability.
        """
        friction = self.damping + self.spring_damping
        late, numerator, denominator = late_device(self.mass, friction, self.spring, self.period, self.latency)
        delay, lag = self.delay + late, self.object_delay
        for name, samples_ in (("delay", delay), ("object_delay", lag)):
            if samples_ > LATEST:
                do = "`spectral_radius` of a Linearisation accepts longer delays"
                raise InputError(name, samples_, f"at most {LATEST} samples", do)
        B, per_period = (np.asarray(each, dtype=float)[None] for each in (self.coupling_damping, 1.0 / self.period))
        more = int(B.any())
        if self.object_mass is None:
            D, N = times(denominator, power(delay + more)), times(numerator, power(more))
            if more:
                D = plus(D, times(numerator, S, per_period, B))
            return D, plus(N, np.zeros_like(D))
        share = self.object_mass / self.fingers, self.object_damping / self.fingers
        position, velocity, body = object_response(*share, self.integrator, self.period)
        L = max(delay + more, lag)
        D = times(denominator, body, power(L))
        N = plus(times(numerator, body, power(L - delay)), times(position, denominator, power(L - lag)))
        if more:
            swing = times(numerator, S, body, power(L - delay - 1), per_period)
            D = plus(D, times(plus(swing, times(velocity, denominator, power(L - lag))), B))
        return _without_drift(D, plus(N, np.zeros_like(D)))

    def limits(self) -> Limits:
        """Compute all stable stiffnesses k of a plant whose parameters are numbers."""
        return limits_of(*self.polynomials(), self.unit, self.period)

    @property
    def shape(self) -> tuple[int, ...]:
        """Common shape of the parameters.

        Raises:
            InputError: If the arrays do not broadcast.
        """
        shapes = [np.shape(getattr(self, name)) for name in self._names]
        try:
            return np.broadcast_shapes(*shapes)
        except ValueError as error:
            text = ", ".join(str(shape) for shape in shapes if shape)
            raise InputError("parameters", f"shapes {text}", "arrays that broadcast against one another") from error

    def blocks(self) -> Iterator[tuple[int, Plant]]:
        """Yield blocks of consecutive points of the common shape: the first flat index of each block, and its plant.

        Numbers are not expanded to arrays, and other parameters are expanded for one block at a time.
        """
        shape = self.shape or (1,)
        total = int(np.prod(shape, dtype=np.int64))
        arrays = {name: np.asarray(getattr(self, name), dtype=float) for name in self._names}
        views = {name: np.broadcast_to(a, shape) if a.size != 1 else a.reshape(()) for name, a in arrays.items()}
        for start in range(0, total, BLOCK):
            index = np.unravel_index(np.arange(start, min(start + BLOCK, total)), shape)
            points: dict[str, Any] = {name: a[index] if a.ndim else a for name, a in views.items()}
            yield start, replace(self, **points)

    def limit_blocks(self) -> Iterator[tuple[int, FloatArray]]:
        """Yield each block's first flat index, and the smallest unstable stiffness k at each of its points [N/m]."""
        for start, block in self.blocks():
            yield start, np.asarray(first_loss(*edges(*block.polynomials(), block.unit))[0].ravel())

    def limit_map(self) -> FloatArray:
        """Compute the smallest unstable stiffness k at each point [N/m], in the common shape of the parameters."""
        limit = np.empty(self.shape)
        flat = limit.reshape(-1)
        for start, values in self.limit_blocks():
            flat[start : start + len(values)] = values
        return limit


def _without_drift(D: FloatArray, N: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Move common roots of D and N at z = 1 to z = 0; a common root at z = 1 gives D[0] = N[0] = 0 exactly."""
    while True:
        common = (D[0] == 0.0) & (N[0] == 0.0)
        if not common.any():
            return D, N
        D, N = (np.where(common, times(A[1:], ONE_PLUS), A) for A in (D, N))
