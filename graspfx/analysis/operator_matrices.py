"""An operator about a state of rest, as matrices: limbs, late reactions, and stiffness that goes with the grip."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class OperatorMatrices:
    """Hold on m device coordinates x besides the hands' K_h and B_h, about a rest; all beside the intention.

        m x'' + b x' + R x' = -d - F + (I - S S') h + g                    devices, d the force on the object, displayed
        M y'' + B y' + K y = S'F + S'h - S'g,    F = K_h (x - S y) + B_h (x' - S y')                 limbs y (l,)
        h_k = -s_(k - n),    s = P x + Q x' - C d                                      reactions, held over a sample
        g_k = a g_(k-1) - (1 - a) A d_k                      what a change of the grip does to the squeeze's own force

    Attributes:
        limb: S (m, l), whose orthonormal columns are the coordinates that have a limb.
        limb_mass, limb_stiffness, limb_damping: M, K, B (l, l) [kg, N/m, N s/m].
        pull, pull_damping, counter: P, Q, C (m, m) [N/m, N s/m, 1].
        delay: n (m,) [samples]; the reaction counts where P, Q or C is not zero.
        grip: A (m, m), newtons of the hand's force per newton of the displayed one.
        grip_share: a (m,).
        friction: R (m, m), of the devices besides b [N s/m]; the hands' own is between tips and limbs.
    """

    limb: FloatArray
    limb_mass: FloatArray
    limb_stiffness: FloatArray
    limb_damping: FloatArray
    pull: FloatArray
    pull_damping: FloatArray
    counter: FloatArray
    delay: NDArray[np.int64]
    grip: FloatArray
    grip_share: FloatArray
    friction: FloatArray

    def __post_init__(self) -> None:
        m, limbs = self.limb.shape
        sizes = dict.fromkeys(("limb_mass", "limb_stiffness", "limb_damping"), limbs)
        sizes |= dict.fromkeys(("pull", "pull_damping", "counter", "grip", "friction"), m)
        for name, size in sizes.items():
            matrix = getattr(self, name)
            if matrix.shape != (size, size) or not np.isfinite(matrix).all():
                raise InputError(name, matrix, f"a finite matrix ({size}, {size})")
        for name in ("delay", "grip_share"):
            if getattr(self, name).shape != (m,):
                raise InputError(name, getattr(self, name), f"({m},) numbers")
        if self.reacts and (self.delay < 1).any():
            raise InputError("delay", self.delay, "one sample or more of every reaction")

    @property
    def reacts(self) -> bool:
        """Whether there is a late reaction."""
        return bool(self.pull.any() or self.pull_damping.any() or self.counter.any())

    @property
    def limbs(self) -> int:
        """How many coordinates have a limb, l."""
        return int(self.limb.shape[1])

    @property
    def alike(self) -> bool:
        """Whether all coordinates have a limb or none has, with like delays and lags."""
        m, limbs = self.limb.shape
        whole = not limbs or (limbs == m and np.array_equal(self.limb, np.eye(m)))
        return whole and bool((self.delay == self.delay[0]).all() and (self.grip_share == self.grip_share[0]).all())

    @property
    def springs(self) -> list[FloatArray]:
        """Matrices (m, m) that give forces by displacements, where all coordinates have a limb or none has."""
        return [self.limb_mass, self.limb_stiffness, self.limb_damping, self.pull, self.pull_damping, self.friction]

    @property
    def ratios(self) -> list[FloatArray]:
        """Matrices (m, m) that give forces by forces."""
        return [self.counter, self.grip]

    def restricted(self, coordinates: NDArray[np.bool_]) -> OperatorMatrices:
        """Give the operator of some coordinates, a mask (m,), the others without force."""
        limbs = self.limb[coordinates].any(axis=0)
        block, own = np.ix_(coordinates, coordinates), np.ix_(limbs, limbs)
        return OperatorMatrices(
            limb=self.limb[np.ix_(coordinates, limbs)],
            limb_mass=self.limb_mass[own],
            limb_stiffness=self.limb_stiffness[own],
            limb_damping=self.limb_damping[own],
            pull=self.pull[block],
            pull_damping=self.pull_damping[block],
            counter=self.counter[block],
            delay=self.delay[coordinates],
            grip=self.grip[block],
            grip_share=self.grip_share[coordinates],
            friction=self.friction[block],
        )

    def on(self, basis: FloatArray, forces: FloatArray) -> OperatorMatrices:
        """Give the operator of motions x = B y, with forces B'f, where `alike`: limbs move as B, too.

        Args:
            basis: B (m, k).
            forces: C (m, k), B'C = I: what the forces on x are of those of the part's own.
        """
        k = basis.shape[1]
        names = ("limb_mass", "limb_stiffness", "limb_damping")
        limb = {name: basis.T @ getattr(self, name) @ basis if self.limbs else np.zeros((0, 0)) for name in names}
        pulls = {name: basis.T @ getattr(self, name) @ basis for name in ("pull", "pull_damping", "friction")}
        return replace(
            self,
            limb=np.eye(k) if self.limbs else np.zeros((k, 0)),
            **limb,
            **pulls,
            counter=basis.T @ self.counter @ forces,
            delay=self.delay[:k],
            grip=basis.T @ self.grip @ forces,
            grip_share=self.grip_share[:k],
        )

    def without_reaction(self) -> OperatorMatrices:
        """Give the operator without its late reaction."""
        zero = np.zeros_like(self.pull)
        return replace(self, pull=zero, pull_damping=zero, counter=zero)
