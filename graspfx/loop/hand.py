"""Hands: springs and dampers that pull fingertips towards the operator's intended positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.memory import zeros
from graspfx.compile.records import entries_of, size_for
from graspfx.errors import InputError
from graspfx.loop import plant
from graspfx.loop.motion.motion import Levels, Motion, Rest, floats, lay_out, parts_of
from graspfx.loop.motion.state import HandState, JoinedHandsState
from graspfx.loop.motion.targets import guided_target, joined_guided_target, joined_target, target
from graspfx.loop.motion.turn import Turn
from graspfx.loop.operator import Operator, joined

FloatArray = NDArray[np.float64]

SYMMETRY = 1e-12  # relative tolerance for rounding of a symmetric matrix
GAIN = "one finite number of zero or more, or one such number per axis (d,)"


class _HeldByGains:
    """Base class of hands with gains K and B, and with a block that contains all parameters of the targets."""

    followers: Sequence[int] = ()  # entries of the block that `adopt` does not overwrite
    goals: Sequence[NDArray[np.intp]] = ()  # entries of the goals of a guided hand: offsets (n d), then the squeeze
    operator: Operator | None = None  # operator model in addition to spring and damper; None if there is none
    _stiffness: FloatArray
    _damping: FloatArray

    @property
    def stiffness(self) -> FloatArray:
        """Stiffness K, (d, n, n) [N/m], read-only."""
        return self._stiffness

    @property
    def damping(self) -> FloatArray:
        """Damping B, (d, n, n) [N s/m], read-only."""
        return self._damping

    def adopt(self, other: Self) -> None:
        """Copy the gains, rest positions and motions of another hand with the same structure."""
        adopt_block(self, other)
        self._stiffness, self._damping, self.operator = other.stiffness, other.damping, other.operator

    def regain(self, stiffness: FloatArray, damping: FloatArray) -> None:
        """Set K [N/m] and B [N s/m], (d, n, n) each; afterwards, `hold` of the plant must be called."""
        self._stiffness, self._damping = _frozen(stiffness), _frozen(damping)


class Hand(_HeldByGains):
    """Spring and damper that pull n fingertips towards moving intended positions r in d dimensions.

    The force on fingertips with the positions p and the velocities v is, for each axis, K (r - p) + B (r' - v) with

        r_i(t) = c + R(t) (rest_i + s(t) share_i u_i - c) + x(t)

    for finger i, where x is the motion, R the product of the turns about c, s the squeeze, and u_i the unit vector
    along row i of `inward`. The single number s closes all fingers (a synergy). The directions of the squeeze rotate
    with the hand. If all motions are motions of this package, the hand is a `FusedHand`; with a third-party motion, the
    hand has no `kernel`.

    Args:
        rest: Rest positions of the fingers, (n, d) [m].
        stiffness: Stiffness K [N/m]: a number, or one number per axis (d,), for all fingers; or for each axis one
            symmetric positive semidefinite matrix over the fingers, (d, n, n).
        damping: Damping B [N s/m], in the same forms as the stiffness.
        motion: Translation x of all fingers, which also moves the centres of the turns; None for no motion.
        squeeze: Displacement s of each finger's target along `inward` [m]: a one-dimensional motion such as
            `graspfx.loop.motion.Levels`, or a number, which is reached by one minimum-jerk step that starts at time
            zero and takes `squeeze_ramp`.
        inward: Directions of the squeeze, (n, d), of any length; a zero row excludes a finger from the squeeze. None is
            allowed if `squeeze` is zero.
        squeeze_ramp: Duration of the minimum-jerk step [s].
        share: Factor of the squeeze, one for all fingers or one per finger (n,).
        turns: Rotations, each with an axis and a centre, applied in this order.
    """

    declaration = HandState

    def __init__(
        self,
        rest: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike = 0.0,
        motion: Motion | None = None,
        squeeze: float | Motion = 0.0,
        inward: ArrayLike | None = None,
        squeeze_ramp: float = 0.5,
        share: ArrayLike = 1.0,
        turns: Sequence[Turn] = (),
    ) -> None:
        r = _rest(rest)
        n, d = r.shape
        self._stiffness = _gains("stiffness", stiffness, n, d)
        self._damping = _gains("damping", damping, n, d)
        x: Motion = Rest() if motion is None else motion
        if x.dimensions not in (None, d):
            raise InputError("motion", x.dimensions, f"a motion in {d} dimensions, as many as in `rest`")
        if any(turn.dimensions != d for turn in turns):
            given = [turn.dimensions for turn in turns]
            raise InputError("turns", given, f"turns in {d} dimensions, as many as in `rest`")
        if any(getattr(type(turn), "turned", None) is not Turn.turned for turn in turns):
            raise InputError("turns", turns, "instances of Turn", "define a rotation by the motion of its angle")
        closing = _squeeze(squeeze, squeeze_ramp)
        along = _shares(share, n)[:, None] * _directions(inward, squeeze, n, d)
        closes = along.any() and not (np.isscalar(squeeze) and squeeze == 0.0)
        squeezing = lay_out(parts_of(closing) if closes else (), 1)
        courses = [squeezing, lay_out(parts_of(x), d), *(turn.laid_out for turn in turns)]
        sizes = [len(course.entries) for course in courses]
        whole = {
            "fingers": n,
            "dimensions": d,
            "squeeze_entries": sizes[0],
            "motion_entries": sizes[1],
            "turn_entries": sum(sizes[2:]),
        }
        self.state: FloatArray = zeros(size_for(HandState, **whole))
        block = HandState(self.state)
        for name, number in {**whole, "turns": len(turns)}.items():
            setattr(block, name, number)
        for field, values in ((HandState.position, r), (HandState.rest, r), (HandState.along, along)):
            block.array(field)[:] = values.ravel()
        starts = block.squeeze.offset + np.cumsum([0, *sizes[:-1]])
        self.state[block.squeeze.offset :] = np.concatenate([course.entries for course in courses])
        placed = list(zip(starts.tolist(), courses, strict=True))
        numbers = entries_of(HandState, *whole, "turns")
        self.structure = np.concatenate([numbers, *(at + course.structure for at, course in placed)])
        self.ports = plant.HandPorts(position=block.position.offset, velocity=block.velocity.offset)
        self._plain_parts = [each for each in placed if each[1].others]  # third-party motions, which have no kernel
        if not self._plain_parts and type(self).target is Hand.target:
            self.kernel: plant.HandKernel = target  # makes it a FusedHand

    @classmethod
    def arm_and_grip(
        cls,
        rest: ArrayLike,
        *,
        arm: tuple[ArrayLike, ArrayLike],
        grip: tuple[ArrayLike, ArrayLike],
        motion: Motion | None = None,
        squeeze: float | Motion = 0.0,
        inward: ArrayLike | None = None,
        squeeze_ramp: float = 0.5,
        share: ArrayLike = 1.0,
        turns: Sequence[Turn] = (),
    ) -> Hand:
        """Make a hand with separate gains for the mean of the fingers (arm) and for their deviations (grip).

            K = k_arm 11'/n + k_grip (I - 11'/n),   B = b_arm 11'/n + b_grip (I - 11'/n)

        for each axis. With the mean x_e of r - p over the n fingers, the sum of the forces is n (k_arm x_e +
        b_arm x_e'), which is Z+ of Kawai and Yoshikawa, fig. 9. The deviation x_i of finger i from the mean adds the
        force k_grip x_i + b_grip x_i' on this finger, which is Z- of Kawai and Yoshikawa (eqs. 13-19). The grip also
        resists a rotation of the fingers about their mean, because a rotation consists of deviations.

        Args:
            rest: Rest positions of the fingers, (n, d) [m].
            arm: Stiffness k_arm [N/m] and damping b_arm [N s/m] per finger, each a number or one number per axis.
            grip: Stiffness k_grip [N/m] and damping b_grip [N s/m] per finger, in the same forms.
            motion, squeeze, inward, squeeze_ramp, share, turns: As in `Hand`.
        """
        n, d = _rest(rest).shape
        mean = np.full((n, n), 1.0 / n)
        apart = np.eye(n) - mean
        gains = []
        for name, k_arm, k_grip in zip(("stiffness", "damping"), arm, grip, strict=True):
            external = _per_axis(f"arm {name}", k_arm, d)
            internal = _per_axis(f"grip {name}", k_grip, d)
            gains.append(external[:, None, None] * mean + internal[:, None, None] * apart)
        return cls(rest, gains[0], gains[1], motion, squeeze, inward, squeeze_ramp, share, turns)

    @property
    def still(self) -> bool:
        """Whether the targets never change."""
        block = HandState(self.state)
        moves = block.turns or block.squeeze.count or block.motion.count
        return type(self).target is Hand.target and not moves

    def target(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return read-only intended positions r (n, d) [m] and velocities (n, d) [m/s] at a time [s]."""
        for at, course in self._plain_parts:
            course.ask(self.state, at, time)
        target(HandState(self.state.data), time)
        return targets_of(self.state, self.ports, self._stiffness)


class JoinedHands(_HeldByGains):
    """Several hands as one hand, without forces between fingers of different hands.

    Args:
        hands: Hands, in any order.
        order: For each finger of the joined hand, its index in the list of the fingers of all hands; None for the order
            of this list.
    """

    declaration = JoinedHandsState

    def __init__(self, hands: Sequence[plant.Hand], order: Sequence[int] | None = None) -> None:
        if not hands:
            raise InputError("hands", hands, "at least one hand")
        self._plain_parts: list[tuple[plant.Hand, int, int]] = []  # entries for r and r' of hands without a kernel
        n = sum(hand.stiffness.shape[1] for hand in hands)
        if order is not None and sorted(order) != list(range(n)):
            raise InputError("order", order, f"a permutation of the indices 0 to {n - 1}")
        where = list(range(n)) if order is None else list(order)
        rows = np.array(where)[:, None], np.array(where)
        self._stiffness = _frozen(_block_diagonal([hand.stiffness for hand in hands])[:, *rows])
        self._damping = _frozen(_block_diagonal([hand.damping for hand in hands])[:, *rows])
        self._still = all(map(plant.is_still, hands))
        own = [getattr(hand, "operator", None) for hand in hands]
        self.operator = joined(own, [hand.stiffness.shape[1] for hand in hands], where)
        d = len(self._stiffness)
        whole = {"hands": len(hands), "fingers": n, "dimensions": d}
        at = size_for(JoinedHandsState, **whole)
        front = np.zeros(at)
        block = JoinedHandsState(front)
        block.hands, block.fingers, block.dimensions = len(hands), n, d
        parts: list[FloatArray] = []
        starts, places = [], []
        structure = list(range(block.position.offset)) + list(range(block.sources.offset, at))
        for hand in hands:
            fingers = hand.stiffness.shape[1]
            if isinstance(hand, plant.FusedHand) and hand.kernel in (target, guided_target):
                starts.append(at if hand.kernel is target else -at)
                structure += (at + hand.structure).tolist()
                r, v = at + hand.ports.position, at + hand.ports.velocity
                parts.append(hand.state)
            else:
                starts.append(0)
                r, v = at, at + fingers * d
                self._plain_parts.append((hand, r, v))
                parts.append(np.zeros(2 * fingers * d))
            places += [(r + i * d, v + i * d) for i in range(fingers)]
            at += len(parts[-1])
        block.array(JoinedHandsState.starts)[:] = starts
        self._all = joined_guided_target if min(starts) < 0 else joined_target
        placed = list(zip(map(abs, starts), hands, strict=True))
        self.followers = [at + entry for at, hand in placed for entry in getattr(hand, "followers", ())]
        self.goals = [at + entries for at, hand in placed for entries in getattr(hand, "goals", ())]
        block.sources.array(n)[:] = [places[i] for i in where]
        self.state: FloatArray = zeros(at)
        self.state[:] = np.concatenate([front, *parts])
        self.structure = np.array(structure, dtype=np.intp)
        self.ports = plant.HandPorts(position=block.position.offset, velocity=block.velocity.offset)
        if not self._plain_parts and type(self).target is JoinedHands.target:
            self.kernel: plant.HandKernel = self._all  # makes it a FusedHand

    @property
    def still(self) -> bool:
        """Whether the targets of all hands never change."""
        return type(self).target is JoinedHands.target and not self._plain_parts and self._still

    def target(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return read-only intended positions r (n, d) [m] and velocities (n, d) [m/s] at a time [s]."""
        for hand, at, rate in self._plain_parts:
            r, v = hand.target(time)
            self.state[at : at + r.size] = r.ravel()
            self.state[rate : rate + v.size] = v.ravel()
        self._all(JoinedHandsState(self.state.data), time)
        return targets_of(self.state, self.ports, self._stiffness)


def join(hands: Sequence[plant.Hand], order: Sequence[int] | None = None) -> plant.Hand:
    """Join the hands that hold the fingers of one plant; the arguments are those of `JoinedHands`."""
    if len(hands) == 1 and (order is None or list(order) == sorted(order)):
        return hands[0]
    return JoinedHands(hands, order)


def adopt_block(hand: Any, other: Any) -> None:
    """Copy the block of another hand, which contains all parameters of the targets, but keep the followers' states.

    Raises:
        InputError: If the other hand has another structure, or if the hands have a motion without a kernel.
    """
    followers: Sequence[int] = hand.followers
    same = type(other) is type(hand) and other.state.shape == hand.state.shape
    same = same and np.array_equal(other.structure, hand.structure)
    if not same or not np.array_equal(other.state[other.structure], hand.state[hand.structure]):
        raise InputError("other", other, "a hand with the same numbers and kinds of motions and turns")
    if not isinstance(hand, plant.FusedHand):
        raise InputError("hand", hand, "a hand whose motions are all motions of this package")
    places = np.array(followers, dtype=np.intp)
    following = hand.state[places]
    hand.state[:] = other.state
    hand.state[places] = following


def _rest(rest: ArrayLike) -> FloatArray:
    r = floats("rest", rest)
    if r.ndim != 2 or r.shape[0] < 1 or not 1 <= r.shape[1] <= 3 or not np.isfinite(r).all():
        raise InputError("rest", rest, "finite positions (n, d) of one or more fingers in 1 to 3 dimensions [m]")
    return r


def _squeeze(squeeze: float | Motion, ramp: float) -> Motion:
    if not isinstance(squeeze, int | float | np.integer | np.floating):
        if getattr(squeeze, "dimensions", None) != 1:
            raise InputError("squeeze", squeeze, "a distance [m], or a one-dimensional motion")
        return squeeze
    if not np.isfinite(squeeze):
        raise InputError("squeeze", squeeze, "a finite distance [m]")
    if not (np.isfinite(ramp) and ramp >= 0.0):
        raise InputError("squeeze_ramp", ramp, "a finite time of zero or more [s]")
    return Levels([[squeeze, 0.0, ramp]])


def _shares(share: ArrayLike, n: int) -> FloatArray:
    k = floats("share", share)
    if k.shape not in ((), (n,)) or not np.isfinite(k).all():
        raise InputError("share", share, f"one finite number, or one per finger ({n},)")
    return np.broadcast_to(k, (n,))


def _directions(inward: ArrayLike | None, squeeze: float | Motion, n: int, d: int) -> FloatArray:
    if inward is None:
        if not isinstance(squeeze, int | float | np.integer | np.floating) or squeeze != 0.0:
            raise InputError("inward", inward, f"directions ({n}, {d}), because `squeeze` is not zero")
        return np.zeros((n, d))
    u = floats("inward", inward)
    if u.shape != (n, d) or not np.isfinite(u).all():
        raise InputError("inward", inward, f"finite directions ({n}, {d}), one per finger")
    length = np.linalg.norm(u, axis=1, keepdims=True)
    u[length[:, 0] > 0.0] /= length[length > 0.0][:, None]
    return u


def _gains(name: str, value: ArrayLike, n: int, d: int) -> FloatArray:
    K = floats(name, value)
    if K.ndim <= 1:
        return _frozen(_per_axis(name, value, d)[:, None, None] * np.eye(n))
    if K.shape != (d, n, n) or not np.isfinite(K).all():
        raise InputError(name, value, f"{GAIN}, or finite matrices ({d}, {n}, {n})")
    largest = np.abs(K).max()
    if np.abs(K - np.swapaxes(K, 1, 2)).max() > SYMMETRY * largest:
        raise InputError(name, value, "symmetric matrices", "a matrix that is not symmetric generates energy")
    K = 0.5 * (K + np.swapaxes(K, 1, 2))
    least = np.linalg.eigvalsh(K).min()
    if least < -SYMMETRY * max(n, 1) * largest:
        raise InputError(name, value, "positive semidefinite matrices", f"the smallest eigenvalue is {least:.6g}")
    return _frozen(K)


def _per_axis(name: str, value: ArrayLike, d: int) -> FloatArray:
    k = floats(name, value)
    if k.ndim > 1 or (k.ndim == 1 and k.shape != (d,)) or not np.isfinite(k).all() or (k < 0.0).any():
        raise InputError(name, value, f"{GAIN}, d = {d}")
    return np.broadcast_to(k, (d,))


def _block_diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    d = len(blocks[0])
    if any(len(block) != d for block in blocks):
        raise InputError("hands", [len(block) for block in blocks], "hands with the same number of dimensions")
    n = sum(block.shape[1] for block in blocks)
    whole = np.zeros((d, n, n))
    start = 0
    for block in blocks:
        stop = start + block.shape[1]
        whole[:, start:stop, start:stop] = block
        start = stop
    return whole


def targets_of(S: FloatArray, ports: plant.HandPorts, K: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return copies of the target positions and velocities, (n, d) each, that a hand's kernel has written to a block.

    Args:
        S: Block of the hand.
        ports: Entries at which positions and velocities start.
        K: Stiffness of the hand (d, n, n).
    """
    d, n, _ = K.shape
    both = S[ports.position : ports.position + 2 * n * d].reshape(2, n, d).copy()
    both.flags.writeable = False
    return both[0], both[1]


def _frozen(array: FloatArray) -> FloatArray:
    array.flags.writeable = False
    return array
