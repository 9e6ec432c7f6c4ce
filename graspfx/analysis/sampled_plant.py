"""A sampled device on a wall, or with the object that it moves: its parameters, checked once for every limit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis import characteristic
from graspfx.analysis.arguments import count, lag_of_object, number, numbers, one_of, samples
from graspfx.analysis.discrete import INTEGRATORS
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]
Check = Callable[..., Any]  # `arguments.number`, or `arguments.numbers` for arrays that broadcast

ON_WALL = ("mass", "damping", "period", "spring", "spring_damping", "coupling_damping", "gain")
WITH_OBJECT = (*ON_WALL, "object_mass", "object_damping", "fingers")


@dataclass(frozen=True, eq=False)
class Plant:
    """A device m behind a hand k_s, b_s, sampled every T; numbers, or arrays that broadcast against one another.

    Attributes:
        mass, damping, period, spring, spring_damping: m [kg], b [N s/m], T [s], k_s [N/m], b_s [N s/m].
        coupling_damping: B of the wall, or of the coupling to the object [N s/m].
        delay: of the displayed force [samples].
        latency: of the displayed force besides, and of the reading, [s].
        object_mass, object_damping: m_v [kg], b_v [N s/m] of the object that n fingers move; None for a wall.
        fingers: n.
        integrator: of the object.
        object_delay: of the force on the object [samples].
        gain: k [N/m], where one is asked about.
    """

    mass: Any
    damping: Any
    period: Any
    spring: Any
    spring_damping: Any
    coupling_damping: Any
    delay: int
    object_mass: Any = None
    object_damping: Any = 0.0
    fingers: Any = 1
    integrator: str = "exact"
    object_delay: int = 0
    gain: Any = 0.0
    latency: float = 0.0

    @property
    def unit(self) -> Any:
        """The stiffness m/T^2 [N/m]."""
        return self.mass / self.period**2

    @property
    def friction(self) -> Any:
        """The damping of device and hand together [N s/m]."""
        return self.damping + self.spring_damping

    @property
    def share(self) -> tuple[Any, Any]:
        """The mass and the viscosity of the object that each finger moves, m_v/n and b_v/n."""
        return self.object_mass / self.fingers, self.object_damping / self.fingers

    @property
    def plain(self) -> bool:
        """Whether there is neither a delay nor damping of the coupling."""
        return not (self.delay or self.latency or self.object_delay or np.any(self.coupling_damping))

    def polynomials(self) -> tuple[FloatArray, FloatArray]:
        """Give D and N of the loop's characteristic polynomial D + k N."""
        hand = {
            "spring": self.spring,
            "damping": self.coupling_damping,
            "delay": self.delay,
            "latency": self.latency,
        }
        if self.object_mass is None:
            return characteristic.wall(self.mass, self.friction, self.period, **hand)
        return characteristic.external(
            self.mass, self.friction, self.period, *self.share,
            integrator=self.integrator, object_delay=self.object_delay, **hand,
        )  # fmt: skip

    @property
    def _names(self) -> tuple[str, ...]:
        return ON_WALL if self.object_mass is None else WITH_OBJECT

    @property
    def shape(self) -> tuple[int, ...]:
        """The common shape of its arrays.

        Raises:
            InputError: arrays that do not broadcast.
        """
        shapes = [np.shape(getattr(self, name)) for name in self._names]
        try:
            return np.broadcast_shapes(*shapes)
        except ValueError as error:
            text = ", ".join(str(shape) for shape in shapes if shape)
            raise InputError("parameters", f"shapes {text}", "arrays that broadcast against one another") from error

    def blocks(self, size: int) -> Iterator[tuple[int, Plant]]:
        """Divide the common shape into consecutive points: the first index of each block, and its plant.

        Numbers stay numbers, and only one block is spread out at a time.
        """
        shape = self.shape
        total = int(np.prod(shape, dtype=np.int64))
        arrays = {name: np.asarray(getattr(self, name), dtype=float) for name in self._names}
        views = {name: np.broadcast_to(a, shape) if a.size != 1 else a.reshape(()) for name, a in arrays.items()}
        if 0 < total <= size:
            whole: dict[str, Any] = {name: a.reshape(-1) if a.ndim else a for name, a in views.items()}
            yield 0, replace(self, **whole)
            return
        for start in range(0, total, size):
            index = np.unravel_index(np.arange(start, min(start + size, total)), shape)
            points: dict[str, Any] = {name: a[index] if a.ndim else a for name, a in views.items()}
            yield start, replace(self, **points)


class ObjectOptions(TypedDict, total=False):
    """Arguments of limits of devices that move an object, by name: those of `stability.external_limit`."""

    fingers: ArrayLike
    spring: ArrayLike
    integrator: str
    delay: int
    object_delay: int
    coupling_damping: ArrayLike
    spring_damping: ArrayLike
    latency: float


def plant_on_wall(
    check: Check,
    mass: Any,
    damping: Any,
    period: Any,
    spring: Any,
    wall_damping: Any,
    delay: int,
    spring_damping: Any,
    latency: float = 0.0,
) -> Plant:
    """Check the parameters of a device on a wall.

    Raises:
        InputError: naming the argument that cannot be.
    """
    return Plant(
        check("mass", mass, "kg", zero=False),
        check("damping", damping, "N s/m"),
        check("period", period, "s", zero=False),
        check("spring", spring, "N/m"),
        check("spring_damping", spring_damping, "N s/m"),
        check("wall_damping", wall_damping, "N s/m", negative=True),
        samples("delay", delay),
        latency=number("latency", latency, "s"),
    )


def plant_with_object(
    check: Check,
    mass: Any,
    damping: Any,
    period: Any,
    object_mass: Any,
    object_damping: Any,
    *,
    fingers: Any = 2,
    spring: Any = 0.0,
    integrator: str = "exact",
    delay: int = 0,
    object_delay: int = 0,
    coupling_damping: Any = 0.0,
    spring_damping: Any = 0.0,
    latency: float = 0.0,
) -> Plant:
    """Check the parameters of devices that move an object.

    Raises:
        InputError: naming the argument that cannot be; UnknownNameError: for the integrator.
    """
    device = plant_on_wall(check, mass, damping, period, spring, 0.0, 0, spring_damping, latency)
    return replace(
        device,
        object_mass=check("object_mass", object_mass, "kg", zero=False),
        object_damping=check("object_damping", object_damping, "N s/m"),
        fingers=_fingers(check, fingers),
        coupling_damping=check("coupling_damping", coupling_damping, "N s/m", negative=True),
        integrator=one_of("integrator", integrator, INTEGRATORS),
        delay=samples("delay", delay),
        object_delay=lag_of_object(object_delay, integrator),
    )


def _fingers(check: Check, fingers: Any) -> Any:
    if check is number:
        return count("fingers", fingers, 1)
    values = numbers("fingers", fingers, "fingers", zero=False)
    if (values < 1.0).any():
        raise InputError("fingers", fingers, "1 or more everywhere")
    return values
