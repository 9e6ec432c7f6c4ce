"""Hand whose targets are offset by goals that change during a run, each smoothed by a follower."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.memory import zeros
from graspfx.compile.records import entries_of, size_for
from graspfx.errors import InputError
from graspfx.loop import plant
from graspfx.loop.hand import Hand, adopt_block, targets_of
from graspfx.loop.motion.motion import floats
from graspfx.loop.motion.state import GuidedHandState
from graspfx.loop.motion.targets import guided_target
from graspfx.loop.operator import Operator

FloatArray = NDArray[np.float64]


class GuidedHand:
    """A hand whose intended positions are those of another hand plus offsets that follow goals:

        r_i(t) = c + R(t) (rest_i + (s(t) + g(t)) share_i u_i - c) + x(t) + o_i(t)

    g follows the goal of the squeeze, and o_i follows the goal of finger i's offset; the other symbols are those of
    `Hand`. Both followers are critically damped (`Follower`), so targets never jump when goals change, and do not
    overshoot if the followers were at rest.

    Args:
        hand: Hand with motions of this package only.
        lag: Time constant tau of the followers, above zero [s].
        offset: Goal of the offsets: (d,) for all fingers, (n, d), or a number for all components [m].
        squeeze: Goal of the squeeze [m].
        settled: Whether the followers start at their goals; otherwise they start at rest at zero.
    """

    declaration = GuidedHandState

    def __init__(
        self, hand: Hand, lag: float, offset: ArrayLike = 0.0, squeeze: float = 0.0, *, settled: bool = False
    ) -> None:
        if not isinstance(hand, plant.FusedHand) or type(hand) is not Hand:
            raise InputError("hand", hand, "a hand with motions of this package only")
        if not (math.isfinite(lag) and lag > 0.0):
            raise InputError("lag", lag, "a finite time above zero [s]")
        if not math.isfinite(squeeze):
            raise InputError("squeeze", squeeze, "a finite distance [m]")
        d, n, _ = hand.stiffness.shape
        goal = floats("offset", offset)
        if goal.shape not in ((), (d,), (n, d)) or not np.isfinite(goal).all():
            raise InputError("offset", offset, f"finite components ({d},), or one vector per finger ({n}, {d}) [m]")
        self._hand = hand
        whole = {"fingers": n, "dimensions": d, "hand_entries": len(hand.state)}
        self.state: FloatArray = zeros(size_for(GuidedHandState, **whole))
        block = GuidedHandState(self.state)
        for name, number in {**whole, "lag": lag, "squeeze_goal": squeeze}.items():
            setattr(block, name, number)
        block.array(GuidedHandState.goal)[:] = np.broadcast_to(goal, (n, d)).ravel()
        at = block.hand.offset
        self.state[at:] = hand.state
        self.structure = np.concatenate([entries_of(GuidedHandState, *whole), at + hand.structure])
        self.ports = plant.HandPorts(position=at + hand.ports.position, velocity=at + hand.ports.velocity)
        self.kernel: plant.HandKernel = guided_target
        first, count = block.goal.offset, n * d
        self.goals = [np.append(np.arange(first, first + count), entries_of(GuidedHandState, "squeeze_goal"))]
        offsets = range(block.lead.offset, block.lead.offset + 2 * count)
        self.followers = [*entries_of(GuidedHandState, "time", "squeeze", "squeeze_rate"), *offsets]
        if settled:
            block.squeeze = squeeze
            block.array(GuidedHandState.lead)[:] = block.array(GuidedHandState.goal)

    @property
    def stiffness(self) -> FloatArray:
        """K, (d, n, n) [N/m], read-only."""
        return self._hand.stiffness

    @property
    def operator(self) -> Operator | None:
        """Operator model in addition to spring and damper; None without one."""
        return self._hand.operator

    @property
    def damping(self) -> FloatArray:
        """B, (d, n, n) [N s/m], read-only."""
        return self._hand.damping

    @property
    def still(self) -> bool:
        """False, because goals may change the targets."""
        return False

    def adopt(self, other: GuidedHand) -> None:
        """Adopt gains, rest positions, motions and goals of a hand of the same structure, but not its followers."""
        adopt_block(self, other)
        self._hand = other._hand

    def regain(self, stiffness: FloatArray, damping: FloatArray) -> None:
        """Set K and B, (d, n, n) each [N/m, N s/m]; afterwards the plant's `hold` must be called again."""
        self._hand.regain(stiffness, damping)

    def target(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return read-only intended positions r (n, d) [m] and velocities (n, d) [m/s] at a time [s].

        The followers advance to that time; they never return to an earlier time.
        """
        guided_target(GuidedHandState(self.state.data), time)
        return targets_of(self.state, self.ports, self.stiffness)
