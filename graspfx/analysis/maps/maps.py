"""Limits over arrays of parameters, all points at once or block by block."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis import characteristic
from graspfx.analysis.arguments import lag_of_object, numbers, one_of, samples
from graspfx.analysis.critical import edges, first_loss, is_stable
from graspfx.analysis.discrete import INTEGRATORS
from graspfx.analysis.maps import map_compiled
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

BLOCK = 8192  # points whose intermediate arrays stay in the processor's cache


def wall_limit_map(
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    *,
    spring: ArrayLike = 0.0,
    wall_damping: ArrayLike = 0.0,
    delay: int = 0,
    spring_damping: ArrayLike = 0.0,
    engine: str = "auto",
) -> FloatArray:
    """Compute `wall_limit` for arrays of parameters that broadcast against one another, in their common shape.

    Args:
        engine: as in `external_limit_map`.
    """
    arrays = _device(mass, damping, period, spring, spring_damping)
    arrays.append(numbers("wall_damping", wall_damping, "N s/m", negative=True))
    lag = samples("delay", delay)
    shape = _common_shape(arrays)
    limit = np.empty(shape).reshape(-1)
    if map_compiled.is_compiled(engine, limit.size, covered=not lag and not arrays[-1].any()):
        for start, (m, b, T, k_s, b_s, _) in _blocks(arrays, shape, map_compiled.BLOCK):
            limit[start : start + map_compiled.BLOCK] = map_compiled.wall_limits(m, b + b_s, T, k_s)
        return limit.reshape(shape)
    for start, (m, b, T, k_s, b_s, B) in _blocks(arrays, shape):
        D, N = characteristic.wall(m, b + b_s, T, spring=k_s, damping=B, delay=lag)
        limit[start : start + BLOCK] = first_loss(*edges(D, N, m / T**2))[0].ravel()
    return limit.reshape(shape)


def external_limit_map(
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    *,
    fingers: ArrayLike = 2,
    spring: ArrayLike = 0.0,
    integrator: str = "exact",
    delay: int = 0,
    object_delay: int = 0,
    coupling_damping: ArrayLike = 0.0,
    spring_damping: ArrayLike = 0.0,
    engine: str = "auto",
) -> FloatArray:
    """Compute `external_limit` for arrays of parameters that broadcast against one another, in their common shape.

    Args:
        engine: "numpy", or "compiled", which is compiled once on a machine and takes a fraction of the time from then
            on, for maps without delay and damping of the coupling; "auto" compiles only for maps of millions of points.
    """
    arrays = _external(
        mass, damping, period, object_mass, object_damping, fingers, spring, coupling_damping, spring_damping
    )
    shape = _common_shape(arrays)
    limit = np.empty(shape).reshape(-1)
    kind, lag, object_lag = _names(integrator, delay, object_delay)
    covered = not lag and not object_lag and not np.any(coupling_damping)
    if map_compiled.is_compiled(engine, limit.size, covered=covered):
        place = INTEGRATORS.index(kind)
        for start, (m, b, T, m_v, b_v, n, k_s, _, b_s) in _blocks(arrays, shape, map_compiled.BLOCK):
            limit[start : start + map_compiled.BLOCK] = map_compiled.external_limits(
                m, b + b_s, T, k_s, m_v / n, b_v / n, integrator=place
            )
        return limit.reshape(shape)
    blocks = external_limit_blocks(
        mass,
        damping,
        period,
        object_mass,
        object_damping,
        fingers=fingers,
        spring=spring,
        integrator=integrator,
        delay=delay,
        object_delay=object_delay,
        coupling_damping=coupling_damping,
        spring_damping=spring_damping,
    )
    for start, values in blocks:
        limit[start : start + len(values)] = values
    return limit.reshape(shape)


def external_limit_blocks(
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    *,
    fingers: ArrayLike = 2,
    spring: ArrayLike = 0.0,
    integrator: str = "exact",
    delay: int = 0,
    object_delay: int = 0,
    coupling_damping: ArrayLike = 0.0,
    spring_damping: ArrayLike = 0.0,
) -> Iterator[tuple[int, FloatArray]]:
    """Compute `external_limit_map` a block at a time, as (first index, values) in the order of the flat array.

    Whatever the number of points, only one block is held: parameters that broadcast are not spread out.
    """
    arrays = _external(
        mass, damping, period, object_mass, object_damping, fingers, spring, coupling_damping, spring_damping
    )
    kind, lag, object_lag = _names(integrator, delay, object_delay)
    shape = _common_shape(arrays)
    for start, (m, b, T, m_v, b_v, n, k_s, B, b_s) in _blocks(arrays, shape):
        D, N = characteristic.external(
            m, b + b_s, T, m_v / n, b_v / n, spring=k_s, damping=B, integrator=kind, delay=lag, object_delay=object_lag
        )
        yield start, first_loss(*edges(D, N, m / T**2))[0].ravel()


def external_stable_map(
    gain: ArrayLike,
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    *,
    fingers: ArrayLike = 2,
    spring: ArrayLike = 0.0,
    integrator: str = "exact",
    delay: int = 0,
    object_delay: int = 0,
    coupling_damping: ArrayLike = 0.0,
    spring_damping: ArrayLike = 0.0,
) -> NDArray[np.bool_]:
    """Tell whether given k_ep [N/m] are stable: Jury's conditions, by Routh's array in w = (z - 1)/(z + 1)."""
    arrays = _external(
        mass, damping, period, object_mass, object_damping, fingers, spring, coupling_damping, spring_damping
    )
    arrays.append(numbers("gain", gain, "N/m"))
    kind, lag, object_lag = _names(integrator, delay, object_delay)
    shape = _common_shape(arrays)
    stable = np.empty(shape, dtype=bool).reshape(-1)
    for start, (m, b, T, m_v, b_v, n, k_s, B, b_s, k) in _blocks(arrays, shape):
        D, N = characteristic.external(
            m, b + b_s, T, m_v / n, b_v / n, spring=k_s, damping=B, integrator=kind, delay=lag, object_delay=object_lag
        )
        stable[start : start + BLOCK] = is_stable(D, N, k).ravel()
    return stable.reshape(shape)


def _device(m: ArrayLike, b: ArrayLike, T: ArrayLike, k_s: ArrayLike, b_s: ArrayLike) -> list[FloatArray]:
    return [
        numbers("mass", m, "kg", zero=False),
        numbers("damping", b, "N s/m"),
        numbers("period", T, "s", zero=False),
        numbers("spring", k_s, "N/m"),
        numbers("spring_damping", b_s, "N s/m"),
    ]


def _external(
    m: ArrayLike,
    b: ArrayLike,
    T: ArrayLike,
    m_v: ArrayLike,
    b_v: ArrayLike,
    n: ArrayLike,
    k_s: ArrayLike,
    B: ArrayLike,
    b_s: ArrayLike,
) -> list[FloatArray]:
    mass, damping, period, spring, spring_damping = _device(m, b, T, k_s, b_s)
    fingers = numbers("fingers", n, "fingers", zero=False)
    if (fingers < 1.0).any():
        raise InputError("fingers", n, "1 or more everywhere")
    return [
        mass,
        damping,
        period,
        numbers("object_mass", m_v, "kg", zero=False),
        numbers("object_damping", b_v, "N s/m"),
        fingers,
        spring,
        numbers("coupling_damping", B, "N s/m", negative=True),
        spring_damping,
    ]


def _names(integrator: str, delay: int, object_delay: int) -> tuple[str, int, int]:
    kind = one_of("integrator", integrator, INTEGRATORS)
    return kind, samples("delay", delay), lag_of_object(object_delay, kind)


def _common_shape(arrays: list[FloatArray]) -> tuple[int, ...]:
    shapes = [a.shape for a in arrays]
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError as error:
        text = ", ".join(str(shape) for shape in shapes if shape)
        raise InputError("parameters", f"shapes {text}", "arrays that broadcast against one another") from error


def _blocks(
    arrays: list[FloatArray], shape: tuple[int, ...], size: int = BLOCK
) -> Iterator[tuple[int, list[FloatArray]]]:
    """Divide the common shape into consecutive points: the first index, and each parameter, constants as numbers."""
    total = int(np.prod(shape, dtype=np.int64))
    views = [np.broadcast_to(a, shape) if a.size != 1 else a.reshape(()) for a in arrays]
    if 0 < total <= size:
        yield 0, [a.reshape(-1) if a.ndim else a for a in views]
        return
    for start in range(0, total, size):
        stop = min(start + size, total)
        index = np.unravel_index(np.arange(start, stop), shape)
        yield start, [a[index] if a.ndim else a for a in views]
