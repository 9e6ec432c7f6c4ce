"""Safety chain of a scene: limits, memory and fault messages."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.memory import zeros
from graspfx.compile.records import entries_of, size_for
from graspfx.coupling.block_entries import compliant_entry, has_problems
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.feedback.host_record import reason
from graspfx.loop.safety.safety_state import FingerLimits, Goal, Pace, SafetyState, Scale, Tank
from graspfx.loop.safety.trust import CAUSES, DEADMAN, DECAY, HOST, QUICK, STALE

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

GAINS = ("external_stiffness", "external_damping", "internal_stiffness", "internal_damping")
CHOICES = ("equal", "damped", "singular", "gradual", "rays")  # switches that depend on the gains
MOVES = ("kep_moves", "ked_moves", "kip_moves", "kid_moves")


@dataclass(frozen=True, eq=False)
class SafetyLimits:
    """Limits of the safety chain for n fingers; infinity means that there is no limit.

    Attributes:
        force: Largest force of each finger (n,) [N].
        rate: Largest rate of increase of each finger's force (n,) [N/s].
        speed: Largest speed of each finger (n,) [m/s].
        lower, upper: Lower and upper corner of each finger's workspace (n, d) [m].
        hold: Largest number of successive samples without a new reading.
        soft_start: Duration of the soft start [s].
    """

    force: FloatArray
    rate: FloatArray
    speed: FloatArray
    lower: FloatArray
    upper: FloatArray
    hold: int
    soft_start: float


class SafetyChain:
    """Memory of the safety chain of a scene: one buffer for the scene, and one for each object.

    Args:
        limits: Limits of all fingers.
        grasped: Objects, each with the indices of its fingers; `GraspState.guarded` of each object is set.
        devices: Number of devices.
        period: Sampling period T [s].
        live: Names of the fields of `GraspState` that may change during a run.

    Attributes:
        limits: Limits of all fingers.
        pace: Memory for the scene, `Pace`.
        buffers: Memory for each object, `SafetyState`.
        where: Indices of entries in the memory of an object, by the names of columns in recordings.
    """

    def __init__(
        self,
        limits: SafetyLimits,
        grasped: Sequence[tuple[GraspedObject, Index]],
        devices: int,
        period: float,
        *,
        live: Collection[str] = (),
    ) -> None:
        self.limits = limits
        self.silence = 0.0  # longest time without data from the host before forces decay [s]
        self.pace = zeros(size_for(Pace, devices=devices))
        pace = Pace(self.pace)
        pace.devices, pace.hold, pace.trust, pace.elapsed = devices, float(limits.hold), 1.0, 1.0
        pace.ramp, pace.fading = limits.soft_start / period, min(period / DECAY, 1.0)
        self.buffers = [self._buffer(each, fingers, period, live) for each, fingers in grasped]
        empty = SafetyState(np.zeros(size_for(SafetyState, count=0)))
        self.where = {
            "scale": np.array(entries_of(Scale, "soft", "trust", "squeeze", "outer", at=empty.scale.offset), np.intp),
            "tank": np.array(entries_of(Tank, "level", at=empty.tank.offset), np.intp),
        }

    def _buffer(self, grasped: GraspedObject, fingers: Index, period: float, live: Collection[str]) -> FloatArray:
        buffer = zeros(size_for(SafetyState, count=grasped.fingers))
        safety, grasp, limits, d = SafetyState(buffer), grasped.state, self.limits, grasped.dimensions
        grasp.guarded = True
        safety.count, safety.posed = grasped.fingers, has_problems(grasp)
        safety.apart = not (grasp.friction or grasp.attached or grasp.stick or grasp.dense)
        for name, gain in zip(MOVES, GAINS, strict=True):
            setattr(safety, name, gain in live and not grasp.dense)
        own = safety.fingers
        own.array(FingerLimits.number)[:] = fingers
        own.array(FingerLimits.force)[:] = limits.force[fingers]
        own.array(FingerLimits.growth)[:] = limits.rate[fingers] * period
        own.array(FingerLimits.speed)[:] = limits.speed[fingers]
        own.array(FingerLimits.stride)[:] = limits.speed[fingers] * period
        own.array(FingerLimits.lower)[:], own.array(FingerLimits.upper)[:] = -np.inf, np.inf
        own.array(FingerLimits.lower)[:, :d] = limits.lower[fingers]
        own.array(FingerLimits.upper)[:, :d] = limits.upper[fingers]
        safety.scale.squeeze = safety.scale.outer = 1.0
        fill_tank(grasped, safety)
        return buffer

    def rest(self) -> None:
        """Let the forces decay from the next tick on, because the run ends."""
        Pace(self.pace).resting = True

    def is_steered(self, i: int) -> bool:
        """Return whether scalar gains of object i may change during a run."""
        safety = SafetyState(self.buffers[i])
        return any(getattr(safety, name) for name in MOVES)

    def fault_text(self, code: int, fingers: Sequence[str], devices: Sequence[str]) -> str:
        """Return the message for a fault code of the chain (`graspfx.loop.safety.trust`)."""
        number, cause = divmod(code, CAUSES)
        if cause == STALE:
            return f"no new reading of {devices[number]} for more than {self.limits.hold} samples; all forces are zero"
        if cause == QUICK:
            most = self.limits.speed[number]
            return f"{fingers[number]} exceeded safety.speed, {most:g} m/s; all forces are zero"
        if cause == HOST:
            return reason(number, self.silence)
        if cause == DEADMAN:
            return f"the deadman switch of {devices[number]} was released; all forces are zero"
        return "a force or one of its inputs is not finite; all forces are zero"


def fill_tank(grasped: GraspedObject, safety: SafetyState) -> None:
    """Fill the energy tank, and set the target gains to the present gains, so that no gain is changing.

    The energy is sum L_i^2/(2 k) [J], the energy of springs with the smallest stiffness k at the force limits L_i.
    """
    stiffness = least_stiffness(grasped)
    forces = grasped.array(FingerState.limit)
    forces = np.minimum(forces, safety.fingers.array(FingerLimits.force))
    most = float((forces**2).sum()) / (2.0 * stiffness) if stiffness > 0.0 else 0.0
    safety.tank.level = safety.tank.most = most
    for name in GAINS:
        setattr(safety.goal, name, getattr(grasped.state, name))
    safety.changing = False


def least_stiffness(grasped: GraspedObject) -> float:
    """Return the smallest positive eigenvalue of the stiffnesses kep and kip [N/m]; 0 if there is none."""
    values = []
    for part in (grasped.law.external, grasped.law.internal):
        gain = np.asarray(part.stiffness, dtype=float)
        values.append(np.linalg.eigvalsh(gain).ravel() if gain.ndim > 1 else np.atleast_1d(gain))
    every = np.concatenate(values)
    above = every[every > 1e-12 * every.max(initial=0.0)]
    return float(above.min(initial=math.inf)) if len(above) else 0.0


def goal_entries() -> list[int]:
    """Return the indices of the target gains in the memory of an object."""
    return entries_of(Goal, *GAINS, at=SafetyState(np.zeros(size_for(SafetyState, count=0))).goal.offset)


def changing_entry() -> list[int]:
    """Return the index, as a list, of the entry in the memory of an object that says whether gains are changing."""
    return entries_of(SafetyState, "changing")


def steered_entries(grasped: GraspedObject) -> list[int]:
    """Return the indices of the entries in the block of an object that the chain writes while scalar gains change."""
    grasp = grasped.state
    entries = entries_of(GraspState, *GAINS, *CHOICES)
    return [*entries, compliant_entry(grasp.damping_problem)] if has_problems(grasp) else entries
