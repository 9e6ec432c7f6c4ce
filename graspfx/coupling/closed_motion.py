"""Energy that a coupling generates in a closed motion of the object with fixed fingers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx import elementary
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.objects.body_state import BodyState, Motion
from graspfx.spatial import ZERO, Vector, exponential, quaternion_matrix

FloatArray = NDArray[np.float64]

TURN = 0.5  # amplitude of the rotation [rad]
SAMPLES = 24  # samples per motion; the mean of a smooth force over one period converges faster than any power
CREATES = 1e-6  # smallest share of generated energy that exceeds rounding


@dataclass(frozen=True)
class LoopEnergy:
    """Energies of a closed motion of the object.

    Attributes:
        created: Energy delivered to the object minus the work done by the fingers [J].
        peak: Largest energy 1/2 f'e stored in the springs [J].
    """

    created: float
    peak: float

    @property
    def share(self) -> float:
        """Ratio of the generated energy to the peak energy; 0 if the peak energy is zero."""
        return self.created / self.peak if self.peak > 0.0 else 0.0


def worst_turn(grasped: GraspedObject, fingers: FloatArray) -> LoopEnergy:
    """Find the closed motion with the largest `share` in magnitude, among a few motions in the free directions.

    The contacts are fixed in the object, and the fingers are fixed in the world. In each motion, the object rotates by
    +-0.5 rad about a free axis. At the same time the object moves sideways and back, along a free direction or the
    diagonal of two free directions. The amplitude of the translation is half of 0.5 rad times the rms distance of the
    fingers from the object's centre. The generated energy is the integral of wrench'(v, w) over the motion, with the
    object's velocity v and angular velocity w. The block of `grasped` is restored afterwards.

    Args:
        grasped: Grasped object whose contacts have been set by `meet` or `attach`.
        fingers: Finger positions (n, d) [m].
    """
    block, worst = grasped.block.copy(), LoopEnergy(0.0, 0.0)
    state = GraspState(grasped.block)
    state.attached = True
    state.implicit = state.damped = state.observed = False
    state.body.motion.angular_velocity = ZERO
    start = grasped.block.copy()
    try:
        for axis, way in list(_motions(grasped, fingers)):
            grasped.block[:] = start
            worst = max(worst, _round(grasped, fingers, axis, way), key=lambda each: abs(each.share))
    finally:
        grasped.block[:] = block
    return worst


def _motions(grasped: GraspedObject, fingers: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Yield each motion as its axis of rotation (0 to 2) and the amplitude (d,) of its translation [m]."""
    d, body = grasped.dimensions, BodyState(grasped.body_state)
    free = np.concatenate([body.array(BodyState.free_translation), body.array(BodyState.free_rotation)]) != 0.0
    centre = body.motion.array(Motion.position)[:d]
    arm = math.sqrt(float(((fingers - centre) ** 2).sum(axis=1).mean()))
    units = [np.eye(3)[a] for a in range(d) if free[a]]
    units += [(a + s * b) / math.sqrt(2.0) for i, a in enumerate(units) for b in units[i + 1 :] for s in (1.0, -1.0)]
    for axis in np.flatnonzero(free[3:]).tolist():
        for unit in units:
            yield axis, 0.5 * TURN * arm * unit[:d]


def _round(grasped: GraspedObject, fingers: FloatArray, axis: int, way: FloatArray) -> LoopEnergy:
    d, body = grasped.dimensions, BodyState(grasped.body_state)
    motion = body.motion
    position, force, moment = motion.array(Motion.position), body.array(BodyState.force), body.array(BodyState.moment)
    centre, start = position[:d].copy(), motion.quaternion
    created = peak = 0.0
    for phase in 2.0 * math.pi * np.arange(SAMPLES) / SAMPLES:
        sine, cosine = elementary.sin_cos(phase)
        turn = [0.0, 0.0, 0.0]
        turn[axis] = TURN * sine
        position[:d] = centre + (1.0 + cosine) * way
        motion.quaternion = exponential(Vector(*turn)) @ start
        motion.rotation = quaternion_matrix(motion.quaternion)
        grasped.finger_position[:] = fingers
        grasped.sample()
        power = -sine * float(force[:d] @ way) + TURN * cosine * float(moment[axis])
        created += 2.0 * math.pi / SAMPLES * power
        peak = max(peak, 0.5 * float((grasped.force * (fingers - grasped.contact_position)).sum()))
    return LoopEnergy(created, peak)
