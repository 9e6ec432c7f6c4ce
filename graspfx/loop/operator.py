"""Operator model in addition to the springs and dampers of a hand: limb, stiffening, reaction and noise."""

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
    """Parameters of the operator model of one finger; zero values disable a term (see `Operator`)."""

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
    """Operator model of n fingers in addition to the spring and damper of a hand: limb, stiffening, reaction and noise.

        m p'' + b_d p' = u + F (+ h without a limb),    M y'' = K_l (r - y) + B_l (r' - y') - F + h
        F = (K + k G) (y - p) + (B + b G) (y' - p'),    G' = (|u| - G)/lag
        h(t) = (k_v (r - p) + b_v (r' - p') - g u)(t - delay) + share x(t) F_m

    For each finger, p is the position of the fingertip, m and b_d are mass and damping of the device, r is the intended
    position, and y is the position of the limb; without a limb, y = r. M, K_l and B_l are mass, stiffness and damping
    of the limb. K and B are stiffness and damping of the hand, which increase with the grip force G by the slopes k and
    b. u is the displayed force, and h the voluntary force with the stiffness k_v, the damping b_v and the fraction g of
    the displayed force that it counteracts. F_m is the muscle force, delayed by a lag, and x is noise with mean 0 and
    variance 1.

    Args:
        fingers: Number of fingers n.

    Attributes:
        numbers: One `FingerOperator` per row, (n, entries); all entries are initially zero.
    """

    def __init__(self, fingers: int) -> None:
        self.numbers: FloatArray = np.zeros((fingers, size_of(FingerOperator)))

    def finger(self, i: int) -> FingerOperator:
        """Return the record of finger i, through which `numbers` can be changed."""
        return FingerOperator(self.numbers.reshape(-1), i * self.numbers.shape[1])

    def set_limb(self, mass: float, stiffness: FloatArray, damping: FloatArray) -> None:
        """Set the limb of all fingers: mass M [kg], and per axis (d,) stiffness K_l [N/m] and damping B_l [N s/m]."""
        for i in range(len(self.numbers)):
            finger = self.finger(i)
            finger.limb_mass = mass
            finger.limb_stiffness, finger.limb_damping = _vector(stiffness), _vector(damping)

    def set_stiffening(self, stiffness: float, damping: float, lag: float) -> None:
        """Set the stiffening of all fingers: slopes k [N/m per N] and b [N s/m per N], lag of the grip force [s]."""
        for i in range(len(self.numbers)):
            finger = self.finger(i)
            finger.rise, finger.damping_rise, finger.grip_lag = stiffness, damping, lag

    def set_reaction(self, delay: float, stiffness: float, damping: float, force: float) -> None:
        """Set the voluntary force of all fingers: delay [s], k_v [N/m], b_v [N s/m] and fraction g."""
        for i in range(len(self.numbers)):
            finger = self.finger(i)
            finger.delay, finger.pull, finger.pull_damping, finger.counter = delay, stiffness, damping, force

    def set_noise(self, share: float, cutoff: float, lag: float, seeds: Sequence[Sequence[int]]) -> None:
        """Set the noise of all fingers.

        Args:
            share: Standard deviation of the noise relative to the muscle force.
            cutoff: Highest frequency of the noise [Hz].
            lag: Time constant with which the amplitude of the noise follows the muscle force [s].
            seeds: Seed of the random numbers of each finger.
        """
        for i, seed in enumerate(seeds):
            finger = self.finger(i)
            finger.share, finger.command_lag = share, lag
            frequency, phase = random_sines(seed, 0.0, cutoff, WAVES)
            finger.array(FingerOperator.frequency)[:] = 2.0 * math.pi * frequency
            finger.array(FingerOperator.phase)[:] = phase

    def noise(self, times: FloatArray) -> FloatArray:
        """Compute the noise share x(t) of each finger relative to the muscle force, (M, n), at times (M,) [s]."""
        columns = []
        for i in range(len(self.numbers)):
            finger = self.finger(i)
            frequency, phase = finger.array(FingerOperator.frequency), finger.array(FingerOperator.phase)
            waves = np.sin(np.outer(times, frequency) + phase).sum(axis=1)
            columns.append(finger.share * math.sqrt(2.0 / WAVES) * waves)
        return np.stack(columns, axis=1)

    @property
    def reach(self) -> float:
        """Longest delay of the voluntary forces of all fingers [s]."""
        return max(self.finger(i).delay for i in range(len(self.numbers)))

    def at_rest(self, stiffness: FloatArray, force: FloatArray) -> FloatArray:
        """Compute the static stiffness K_s of hand and operator, (d, n, n) [N/m], with f = K_s (r - p) for each axis.

        It is K, increased by the grip forces |f|, in series with the limb, plus the reaction.

        Args:
            stiffness: Stiffness K of the hand (d, n, n) [N/m].
            force: Static forces f of the fingers (n, d) [N].
        """
        return self._rest(stiffness, force)[0]

    def stretch_at_rest(self, stiffness: FloatArray, force: FloatArray) -> FloatArray:
        """Compute the static displacement y - p, (n, d) [m]; without a limb, y = r.

        Args:
            stiffness: Stiffness K of the hand (d, n, n) [N/m].
            force: Static forces f of the fingers (n, d) [N].
        """
        K, X = self._rest(stiffness, force)
        away = [X[a] @ np.linalg.lstsq(K[a], force[:, a], rcond=None)[0] for a in range(len(K))]
        return np.stack(away, axis=1)

    def _rest(self, stiffness: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the static f and y - p, both per unit of r - p, (d, n, n); the arguments are those of `at_rest`."""
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
    """Solve for x = y - p and the force f on the fingertips for one axis, both per unit of r - p, (2 n, n).

    Args:
        tip: Stiffness between limb and fingertips (n, n) [N/m].
        limb: Stiffness of the limb (n,) [N/m]; 0 without a limb.
        soft: Whether each finger has a limb (n,).
        pull: Stiffness of the voluntary force (n,) [N/m].
        counter: Fraction of the displayed force that the voluntary force counteracts (n,).
    """
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
    """Join the operator models of several hands; return None if no hand has an operator model.

    Args:
        operators: Operator model of each hand; None for a hand with only spring and damper.
        fingers: Number of fingers of each hand.
        order: For each finger of the joined hand, its index in the list of the fingers of all hands.
    """
    if all(operator is None for operator in operators):
        return None
    whole = Operator(len(order))
    rows = [Operator(n) if each is None else each for each, n in zip(operators, fingers, strict=True)]
    whole.numbers[:] = np.concatenate([each.numbers for each in rows])[list(order)]
    return whole


def _vector(values: FloatArray) -> Vector:
    return Vector(*[*values.tolist(), 0.0, 0.0][:3])
