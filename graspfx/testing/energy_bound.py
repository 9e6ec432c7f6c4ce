"""Where the energy of a run comes from at most: fingers, gravity, springs at first, forces held over a sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.objects import integrators as body

if TYPE_CHECKING:
    from graspfx.recording.history import ObjectMotion
    from graspfx.recording.record import Recording
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Account:
    """An energy account over time: the gain and what there was for it, (N,) [J].

    Attributes:
        gained: so far.
        had: what there was to be gained.
        scale: the largest of the terms so far, to measure a difference by.
    """

    gained: FloatArray
    had: FloatArray
    scale: FloatArray


def accounts(scene: Scene, recording: Recording, bodies: Sequence[FloatArray]) -> tuple[Account, Account]:
    """Keep the coupling's account, A against S_0 + W + H, and the objects', E against E_0 + A + U + J.

    Args:
        bodies: the objects' blocks (`graspfx.objects.integrators`), for their masses and moments of inertia.
    """
    N, d = len(recording), scene.dimensions
    k = _stiffest(scene)
    f, p, c = recording.finger_force, recording.finger_position, recording.contact_position
    e = p - c  # (N, n, d) [m]
    put_in = _summed((f[:-1] * np.diff(p, axis=0)).sum(axis=(1, 2)))
    stored = 0.5 * k * _summed((np.diff(e, axis=0) ** 2).sum(axis=(1, 2)))
    at_first = 0.5 * k * float((e[0] ** 2).sum())
    kinetic, work, weight_work, stepped = (np.zeros(N) for _ in range(4))
    g = np.zeros(d) if scene.gravity is None else np.array(scene.gravity)
    for table, motion, block in zip(scene.object, recording.objects.values(), bodies, strict=True):
        m, largest = float(block[body.MASS]), float(block[body.INERTIA : body.INERTIA + 3].max())
        x, v, w = motion.position, motion.velocity, motion.angular_velocity
        kinetic += 0.5 * m * (v**2).sum(axis=1) + _turning(motion, block)
        weight_work += m * (x - x[0]) @ g
        work += _summed((motion.wrench[:-1, :d] * np.diff(x, axis=0)).sum(axis=1))
        if motion.orientation is not None:
            work += _summed((motion.wrench[:-1, d:] * _turns(motion.orientation)).sum(axis=1))
        if table.dynamics == "native" and table.integrator == "explicit":
            stepped += 0.5 * m * _summed((np.diff(v, axis=0) ** 2).sum(axis=1))
            if w is not None:
                stepped += 0.5 * largest * _summed((np.diff(w.reshape(N, -1), axis=0) ** 2).sum(axis=1))
    coupling = Account(work, at_first + put_in + stored, _largest(work, put_in, stored, at_first))
    objects = Account(kinetic, kinetic[0] + work + weight_work + stepped, _largest(kinetic, work, weight_work, stepped))
    return coupling, objects


def _largest(*terms: FloatArray | float) -> FloatArray:
    return np.maximum.accumulate(np.max(np.abs(np.broadcast_arrays(*terms)), axis=0))


def _summed(steps: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(steps)])


def _stiffest(scene: Scene) -> float:
    """Find the largest gain in any direction [N/m]."""
    largest = 0.0
    for gains in (scene.coupling.external.stiffness, scene.coupling.internal.stiffness):
        values = np.asarray(gains, dtype=float)
        largest = max(largest, float(values.max() if values.ndim < 2 else np.linalg.eigvalsh(values).max()))
    return largest


def _turns(orientation: FloatArray) -> FloatArray:
    """Compute rotations from tick to tick, (N - 1, 1 | 3) [rad], in world axes: exact about an axis that stays."""
    if orientation.ndim == 1:
        return np.diff(orientation)[:, None]
    a, b = orientation[:-1], orientation[1:]
    v = a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(b[:, :3], a[:, :3])  # of b a'
    w = (a * b).sum(axis=1)
    s = np.linalg.norm(v, axis=1)
    angle = 2.0 * np.arctan2(s * np.sign(w), np.abs(w))
    return v * np.where(s > 0.0, angle / np.where(s > 0.0, s, 1.0), 0.0)[:, None]


def _turning(motion: ObjectMotion, block: FloatArray) -> FloatArray:
    """Compute 1/2 w'R I R'w, (N,) [J]."""
    w, q = motion.angular_velocity, motion.orientation
    moments = block[body.INERTIA : body.INERTIA + 3]
    if w is None or q is None:
        return np.zeros(len(motion.position))
    if w.ndim == 1:
        return 0.5 * float(moments[2]) * w**2
    turn = 2.0 * np.cross(-q[:, :3], w)
    own = w + q[:, 3:] * turn + np.cross(-q[:, :3], turn)  # in the body's axes
    return 0.5 * np.asarray(own**2 @ moments)
