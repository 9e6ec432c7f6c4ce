"""Hands: springs and dampers that pull fingertips to where an operator means them to be."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.loop import plant
from graspfx.loop.motion import Levels, Motion, Rest, floats
from graspfx.loop.turn import Turn

FloatArray = NDArray[np.float64]

SYMMETRY = 1e-12  # relative; rounding of a matrix that was meant to be symmetric
GAIN = "one finite number of zero or more, or one per axis (d,)"


class Hand:
    """Force on the fingertips K (r - p) + B (r' - v) per axis, with the intended positions

        r_i(t) = c + R(t) (rest_i + s(t) share_i u_i - c) + x(t)

    x the motion, R the turns about c, one after another, s the squeeze and u_i the unit vector along `inward`: one
    number s closes all fingers, a synergy, and its directions turn with the hand. With nothing that moves this is a
    plain spring and damper to `rest`; with zero gains it is no hand at all.

    Args:
        rest: (n, d), where the fingers rest [m].
        stiffness: K [N/m]: a number or one per axis (d,), the same for each finger by itself; or matrices (d, n, n),
            symmetric and positive semidefinite, over the fingers for each axis.
        damping: B [N s/m], in the same forms.
        motion: x, of all fingers together; the centres of the turns go along with it.
        squeeze: s, how far each finger's target goes along `inward` [m]: a number, taken up by one minimum-jerk step
            over `squeeze_ramp` from time zero, or a motion of one dimension, as `graspfx.loop.motion.Levels` is.
        inward: (n, d) directions of the squeeze, of any length; a row of zeros is a finger that stays out of it.
        squeeze_ramp: [s].
        share: of the squeeze, a number or one per finger (n,).
        turns: R and c; each turns what the ones before it give, about an axis that stays.
    """

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
        self._rest = r
        self._stiffness = _gains("stiffness", stiffness, n, d)
        self._damping = _gains("damping", damping, n, d)
        self._motion: Motion = Rest() if motion is None else motion
        if self._motion.dimensions not in (None, d):
            raise InputError("motion", self._motion.dimensions, f"a motion in {d} dimensions, as rest has")
        self._turns = tuple(turns)
        if any(turn.dimensions != d for turn in turns):
            raise InputError("turns", [turn.dimensions for turn in turns], f"turns in {d} dimensions, as rest has")
        self._squeeze = _squeeze(squeeze, squeeze_ramp)
        self._along = _shares(share, n)[:, None] * _directions(inward, squeeze, n, d)
        self._still = _frozen(np.zeros((n, d)))
        levels = self._squeeze if isinstance(self._squeeze, Levels) else None
        self._closed = levels.end if levels is not None else math.inf  # from then on the squeeze is constant
        self._settled = _frozen(r + levels.last * self._along) if levels is not None else r
        self._resting = isinstance(self._motion, Rest) and not turns

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
        """A hand whose arm moves the fingers' mean and whose grip moves them against each other.

            K = k_arm 11'/n + k_grip (I - 11'/n), B alike, on each axis

        so that on the mean x_e the fingers' forces add up to n (k_arm x_e + b_arm x_e'), Z+ of Kawai and Yoshikawa,
        fig. 9, and on the deviations x_i each finger feels k_grip and b_grip, their Z- (eqs. 13-19). A rotation of the
        fingers about their mean is part of the deviations: the grip holds it.

        Args:
            arm: stiffness [N/m] and damping [N s/m] per finger, each a number or one per axis.
            grip: the same.
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
    def stiffness(self) -> FloatArray:
        """K, (d, n, n) [N/m], read-only."""
        return self._stiffness

    @property
    def damping(self) -> FloatArray:
        """B, (d, n, n) [N s/m], read-only."""
        return self._damping

    def target(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Intended positions r (n, d) [m] and velocities (n, d) [m/s] at a time [s]; not to be written to."""
        if time >= self._closed:
            r, v = self._settled, self._still
        else:
            s, ds = self._squeeze.at(time)
            r, v = self._rest + s * self._along, ds * self._along
        if self._resting:
            return r, v
        for turn in self._turns:
            r, v = turn.turned(time, r, v)
        x, dx = self._motion.at(time)
        return r + x, v + dx


class JoinedHands:
    """Several hands as one, with no force between fingers of different hands.

    Args:
        hands: in any order.
        order: the place of each finger of the whole among the hands' fingers, one after another; as they come if None.
    """

    def __init__(self, hands: Sequence[plant.Hand], order: Sequence[int] | None = None) -> None:
        if not hands:
            raise InputError("hands", hands, "one hand at least")
        self._hands = tuple(hands)
        n = sum(hand.stiffness.shape[1] for hand in hands)
        if order is not None and sorted(order) != list(range(n)):
            raise InputError("order", order, f"each of the {n} fingers once")
        self._order = np.arange(n) if order is None else np.array(order)
        rows = self._order[:, None], self._order
        self._stiffness = _frozen(_block_diagonal([hand.stiffness for hand in hands])[:, *rows])
        self._damping = _frozen(_block_diagonal([hand.damping for hand in hands])[:, *rows])

    @property
    def stiffness(self) -> FloatArray:
        """K, (d, n, n) [N/m], read-only."""
        return self._stiffness

    @property
    def damping(self) -> FloatArray:
        """B, (d, n, n) [N s/m], read-only."""
        return self._damping

    def target(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Intended positions r (n, d) [m] and velocities (n, d) [m/s] at a time [s]."""
        targets = [hand.target(time) for hand in self._hands]
        r, v = np.concatenate([r for r, _ in targets]), np.concatenate([v for _, v in targets])
        return r[self._order], v[self._order]


def join(hands: Sequence[plant.Hand], order: Sequence[int] | None = None) -> plant.Hand:
    """One hand of all these, for a plant that several of them share; `order` as in JoinedHands."""
    if len(hands) == 1 and (order is None or list(order) == sorted(order)):
        return hands[0]
    return JoinedHands(hands, order)


def _rest(rest: ArrayLike) -> FloatArray:
    r = floats("rest", rest)
    if r.ndim != 2 or r.shape[0] < 1 or not 1 <= r.shape[1] <= 3 or not np.isfinite(r).all():
        raise InputError("rest", rest, "finite positions (n, d) of one or more fingers in 1 to 3 dimensions [m]")
    return r


def _squeeze(squeeze: float | Motion, ramp: float) -> Motion:
    if not isinstance(squeeze, int | float | np.integer | np.floating):
        if getattr(squeeze, "dimensions", None) != 1:
            raise InputError("squeeze", squeeze, "a distance [m], or a motion of one dimension")
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
            raise InputError("inward", inward, f"directions ({n}, {d}) for the squeeze")
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
        raise InputError(name, value, "symmetric matrices", "a hand that is not symmetric makes energy")
    K = 0.5 * (K + np.swapaxes(K, 1, 2))
    least = np.linalg.eigvalsh(K).min()
    if least < -SYMMETRY * max(n, 1) * largest:
        raise InputError(name, value, f"positive semidefinite matrices, found the eigenvalue {least:.6g}")
    return _frozen(K)


def _per_axis(name: str, value: ArrayLike, d: int) -> FloatArray:
    k = floats(name, value)
    if k.ndim > 1 or (k.ndim == 1 and k.shape != (d,)) or not np.isfinite(k).all() or (k < 0.0).any():
        raise InputError(name, value, f"{GAIN}, d = {d}")
    return np.broadcast_to(k, (d,))


def _block_diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    d = len(blocks[0])
    if any(len(block) != d for block in blocks):
        raise InputError("hands", [len(block) for block in blocks], "hands of the same number of dimensions")
    n = sum(block.shape[1] for block in blocks)
    whole = np.zeros((d, n, n))
    start = 0
    for block in blocks:
        stop = start + block.shape[1]
        whole[:, start:stop, start:stop] = block
        start = stop
    return whole


def _frozen(array: FloatArray) -> FloatArray:
    array.flags.writeable = False
    return array
