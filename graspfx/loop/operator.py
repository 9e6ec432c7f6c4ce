"""Operator model beyond the hand's springs and dampers: limb, stiffening, reaction and noise."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import Floats, Record, floats, size_of
from graspfx.loop.motion.tremor import random_sines
from graspfx.spatial import Vector

FloatArray = NDArray[np.float64]

WAVES = 24  # sines of the noise of one finger
NOISE = 3  # last word of the seed of noise; the last words of a tremor's axes are 0 to 2


class FingerOperator(Record):
    """Operator model of one finger in addition to its hand's spring and damper; zero values disable a term."""

    limb_mass: float  # M [kg]
    limb_stiffness: Vector  # K_l, per axis [N/m]
    limb_damping: Vector  # B_l [N s/m]
    rise: float  # slope of the stiffness over the grip force [N/m per N]
    damping_rise: float  # slope of the damping over the grip force [N s/m per N]
    grip_lag: float  # time constant by which the grip force follows the displayed force [s]
    delay: float  # delay of the voluntary force [s]
    pull: float  # stiffness k_v of the voluntary force [N/m]
    pull_damping: float  # damping b_v of the voluntary force [N s/m]
    counter: float  # fraction g of the displayed force that the voluntary force counteracts
    share: float  # standard deviation of the noise, relative to the muscle force
    command_lag: float  # time constant with which the noise's amplitude follows the muscle force [s]
    frequency: Floats = floats("24")  # frequencies of the sines of the noise [rad/s]
    phase: Floats = floats("24")


class Operator:
    """Operator model of n fingers in addition to their hand: a limb, stiffening, a reaction and noise.

        m p'' + b p' = u + F (+ h without a limb),    M y'' = K_l (r - y) + B_l (r' - y') - F + h
        F = (K + k G) (y - p) + (B + b G) (y' - p'),          G' = (|u| - G)/lag
        h(t) = (k_v (r - p) + b_v (r' - p') - g u)(t - delay) + share x(t) F_m

    p is the fingertip, m and b of the first equation are its device's mass and damping, r is the intended position, and
    y the limb; without a limb y = r. K and B are the hand's stiffness and damping, k and b of the second line their
    slopes over the grip force G. u is the displayed force, h the voluntary force, F_m the muscle force after a lag, and
    x noise of mean 0 and variance 1.

    Args:
        fingers: Number of fingers n.

    Attributes:
        numbers: One `FingerOperator` per row, (n, entries); initially zeros.
    """

    def __init__(self, fingers: int) -> None:
        self.numbers: FloatArray = np.zeros((fingers, size_of(FingerOperator)))

    def finger(self, i: int) -> FingerOperator:
        """Return the writable record of one finger."""
        return FingerOperator(self.numbers.reshape(-1), i * self.numbers.shape[1])

    def set_limb(self, mass: float, stiffness: FloatArray, damping: FloatArray) -> None:
        """Set M [kg], K_l and B_l per axis (d,) [N/m, N s/m] of every finger."""
        for i in range(len(self.numbers)):
            finger = self.finger(i)
            finger.limb_mass = mass
            finger.limb_stiffness, finger.limb_damping = _vector(stiffness), _vector(damping)

    def set_stiffening(self, stiffness: float, damping: float, lag: float) -> None:
        """Set the slopes k [N/m per N] and b [N s/m per N], and the lag [s] of every finger."""
        for i in range(len(self.numbers)):
            finger = self.finger(i)
            finger.rise, finger.damping_rise, finger.grip_lag = stiffness, damping, lag

    def set_reaction(self, delay: float, stiffness: float, damping: float, force: float) -> None:
        """Set the delay [s], k_v [N/m], b_v [N s/m] and g of every finger."""
        for i in range(len(self.numbers)):
            finger = self.finger(i)
            finger.delay, finger.pull, finger.pull_damping, finger.counter = delay, stiffness, damping, force

    def set_noise(self, share: float, cutoff: float, lag: float, seeds: Sequence[Sequence[int]]) -> None:
        """Set the share, the cutoff [Hz], the lag [s] and the seed of each finger's random numbers."""
        for i, seed in enumerate(seeds):
            finger = self.finger(i)
            finger.share, finger.command_lag = share, lag
            frequency, phase = random_sines(seed, 0.0, cutoff, WAVES)
            finger.array(FingerOperator.frequency)[:] = 2.0 * math.pi * frequency
            finger.array(FingerOperator.phase)[:] = phase

    def noise(self, times: FloatArray) -> FloatArray:
        """Compute share x(t), each finger's noise relative to its muscle force, at times (M,) [s]: (M, n)."""
        columns = []
        for i in range(len(self.numbers)):
            finger = self.finger(i)
            frequency, phase = finger.array(FingerOperator.frequency), finger.array(FingerOperator.phase)
            waves = np.sin(np.outer(times, frequency) + phase).sum(axis=1)
            columns.append(finger.share * math.sqrt(2.0 / WAVES) * waves)
        return np.stack(columns, axis=1)

    @property
    def reach(self) -> float:
        """The longest delay of the fingers' voluntary forces [s]."""
        return max(self.finger(i).delay for i in range(len(self.numbers)))

    def at_rest(self, stiffness: FloatArray, force: FloatArray) -> FloatArray:
        """Compute the stiffness at rest, (d, n, n) [N/m]: r - p = K_rest^-1 f.

        The stiffness at rest is K, stiffened by the grip forces |f|, in series with the limb, plus the reaction.

        Args:
            stiffness: Stiffness K of the hand (d, n, n) [N/m].
            force: Force f of the fingers at rest (n, d) [N].
        """
        return self._rest(stiffness, force)[0]

    def stretch_at_rest(self, stiffness: FloatArray, force: FloatArray) -> FloatArray:
        """Compute y - p, or r - p without a limb, of a hand at rest under these forces, (n, d) [m].

        The arguments are those of `at_rest`.
        """
        K, X = self._rest(stiffness, force)
        away = [X[a] @ np.linalg.lstsq(K[a], force[:, a], rcond=None)[0] for a in range(len(K))]
        return np.stack(away, axis=1)

    def _rest(self, stiffness: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute f and the displacement of the fingertips' springs, both per unit of r - p, (d, n, n)."""
        n = len(self.numbers)
        whole = np.array(stiffness, dtype=float)
        stretch = np.zeros_like(whole)
        grip = np.linalg.norm(force, axis=1)
        fingers = [self.finger(i) for i in range(n)]
        rise = np.array([finger.rise for finger in fingers])
        pull = np.array([finger.pull for finger in fingers])
        counter = np.array([finger.counter for finger in fingers])
        for a in range(len(whole)):
            tip = whole[a] + np.diag(rise * grip)
            limb = np.array([finger.limb_stiffness[a] if finger.limb_mass else np.inf for finger in fingers])
            soft = np.isfinite(limb)
            # F = tip (y - p); limb (r - y) + h = F, h = pull (r - p) - counter u, u = -f; f = F, plus h without a limb
            both = _with_limb(tip, np.where(soft, limb, 0.0), soft, pull, counter)
            stretch[a], whole[a] = both[:n], both[n:]
        return whole, stretch


def _with_limb(
    tip: FloatArray, limb: FloatArray, soft: NDArray[np.bool_], pull: FloatArray, counter: FloatArray
) -> FloatArray:
    """Solve for x = y - p and the force f on the fingertips, both per r - p, (2 n, n); without a limb f = tip x + h."""
    n = len(tip)
    I = np.eye(n)  # noqa: E741 (the identity's letter)
    s, hard = np.diag(soft.astype(float)), np.diag((~soft).astype(float))
    # unknowns x, f for r - p = I:  f = tip x + hard h,  h = pull + counter f
    # where soft: limb (I - x) + h - tip x = 0; else x = I
    C = np.diag(counter)
    A = np.zeros((2 * n, 2 * n))
    right = np.zeros((2 * n, n))
    A[:n, :n], A[:n, n:], right[:n] = -tip, I - hard @ C, hard * pull
    A[n:, :n], A[n:, n:] = s @ (np.diag(limb) + tip) + hard, -s @ C
    right[n:] = s * (limb + pull) + hard
    return np.asarray(np.linalg.solve(A, right))


def joined(operators: Sequence[Operator | None], fingers: Sequence[int], order: Sequence[int]) -> Operator | None:
    """Join the operators of several hands; None if no hand has one.

    Args:
        operators: Operator of each hand; None for a hand with spring and damper only.
        fingers: Number of fingers of each hand.
        order: Index of each finger of the joined hand among the hands' concatenated fingers.
    """
    if all(operator is None for operator in operators):
        return None
    whole = Operator(len(order))
    rows = [Operator(n) if each is None else each for each, n in zip(operators, fingers, strict=True)]
    whole.numbers[:] = np.concatenate([each.numbers for each in rows])[list(order)]
    return whole


def _vector(values: FloatArray) -> Vector:
    return Vector(*[*values.tolist(), 0.0, 0.0][:3])
