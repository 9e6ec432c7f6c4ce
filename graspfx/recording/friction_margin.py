"""Friction margin of a recorded grip, and the coefficient of friction that its forces need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.recording.header import Header, KeyChange

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def grip(
    normal: FloatArray, force: FloatArray, touching: BoolArray, friction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute the friction margin (r,) [N], and the coefficient |f_t| / f_n that each finger needs (n, r).

    The margin is the smallest mu_i f_n - |f_t| of the touching fingers, NaN if none touches.

    Args:
        normal: Unit normals into the object, (n, d, r).
        force: Forces of the fingers on the object, (n, d, r) [N].
        touching: Whether each finger touches, (n, r).
        friction: Coefficients mu, (n, r) or (n, 1); NaN for a finger without a coefficient, which is left out.
    """
    push = (normal * force).sum(axis=1)
    tangent = np.sqrt(((force - push[:, None] * normal) ** 2).sum(axis=1))
    counts = touching & ~np.isnan(friction)
    margin = np.where(counts, friction * push - tangent, np.inf).min(axis=0, initial=np.inf)
    needed = np.divide(tangent, push, out=np.zeros(push.shape), where=counts & (push > 0.0))
    return np.where(np.isinf(margin), np.nan, margin), needed


def coefficients(header: Header, changes: Sequence[KeyChange], fingers: int) -> list[tuple[int, FloatArray]]:
    """List the fingers' coefficients of friction (n,) with the row from which they hold; NaN for zero or "stick"."""
    table = header.scene_table
    common = _coefficient(table.get("coupling", {}).get("friction", 0.0))
    tables: Sequence[Mapping[str, Any]] = _listed(table.get("finger", ()))
    own = [each.get("friction") for each in tables] or [None] * fingers
    found = [(0, _of_fingers(common, own))]
    for change in changes:
        first, *rest = change.key.split(".")
        if change.key == "coupling.friction":
            common = _coefficient(change.value)
        elif first == "finger" and rest[-1:] == ["friction"] and len(rest) == 2:
            own = [change.value if rest[0] in ("*", str(i)) else mu for i, mu in enumerate(own)]
        else:
            continue
        found.append((header.rows_before(change.tick), _of_fingers(common, own)))
    return found


def rows_of(found: Sequence[tuple[int, FloatArray]], start: int, count: int) -> FloatArray:
    """Return the coefficients for `count` rows from row `start` of the recording, (n, count)."""
    first = np.array([row for row, _ in found])
    at = np.searchsorted(first, np.arange(start, start + count), side="right") - 1
    return np.array([mu for _, mu in found])[at].T


def _of_fingers(common: float, own: Sequence[Any]) -> FloatArray:
    values = np.array([common if mu is None else _coefficient(mu) for mu in own])
    return np.where(values > 0.0, values, np.nan)


def _coefficient(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


def _listed(tables: Any) -> Sequence[Mapping[str, Any]]:
    return [tables] if isinstance(tables, Mapping) else list(tables)
