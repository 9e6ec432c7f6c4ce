"""Hand whose targets are displaced by goals that may change during a run and are smoothed by followers."""

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
    """Hand whose intended positions are those of another hand, displaced by an additional squeeze and by offsets:

        r_i(t) = c + R(t) (rest_i + (s(t) + g(t)) share_i u_i - c) + x(t) + o_i(t)

    The additional squeeze g follows a goal, and the offset o_i of finger i follows another goal; the other symbols are
    those of `Hand`. Both are critically damped (`Follower`), so the targets are continuous when a goal changes, and do
    not overshoot if g and o_i were constant before.

    Args:
        hand: Hand whose motions are all motions of this package.
        lag: Time constant tau of the followers, above zero [s].
        offset: Goals of the offsets [m]: (n, d), (d,) for all fingers, or one number for all components.
        squeeze: Goal of the additional squeeze [m].
        settled: Whether g and o_i start at their goals; otherwise they start at zero.
    """

    declaration = GuidedHandState

    def __init__(
        self, hand: Hand, lag: float, offset: ArrayLike = 0.0, squeeze: float = 0.0, *, settled: bool = False
    ) -> None:
        if not isinstance(hand, plant.FusedHand) or type(hand) is not Hand:
            raise InputError("hand", hand, "a Hand whose motions are all motions of this package")
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
        """Stiffness K, (d, n, n) [N/m], read-only."""
        return self._hand.stiffness

    @property
    def operator(self) -> Operator | None:
        """Operator model in addition to spring and damper; None if there is none."""
        return self._hand.operator

    @property
    def damping(self) -> FloatArray:
        """Damping B, (d, n, n) [N s/m], read-only."""
        return self._hand.damping

    @property
    def still(self) -> bool:
        """Whether the targets never change; False, because goals may change them."""
        return False

    def adopt(self, other: GuidedHand) -> None:
        """Copy gains, rest positions, motions and goals of a hand with the same structure; keep the followers."""
        adopt_block(self, other)
        self._hand = other._hand

    def regain(self, stiffness: FloatArray, damping: FloatArray) -> None:
        """Set K [N/m] and B [N s/m], (d, n, n) each; afterwards, `hold` of the plant must be called."""
        self._hand.regain(stiffness, damping)

    def target(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return read-only intended positions r (n, d) [m] and velocities (n, d) [m/s] at a time [s].

        The followers advance to this time. They cannot return to an earlier time.
        """
        guided_target(GuidedHandState(self.state.data), time)
        return targets_of(self.state, self.ports, self.stiffness)
