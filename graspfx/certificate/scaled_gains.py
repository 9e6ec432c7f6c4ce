"""The stiffness and damping of eq. (4) on one grasp with gains times factors: what limits are looked for along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.pushing import condensed
from graspfx.analysis.series import in_series, springs_in_series
from graspfx.certificate.rest.resting import Grip
from graspfx.coupling.block import FRAME
from graspfx.coupling.grasped import GraspedObject
from graspfx.grasp.impedance import Coupling, Impedance
from graspfx.grasp.split import Split
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ScaledGains:
    """K of the law on one grasp: external for shifts, for turns, internal, each times a factor, without what slips."""

    law: Coupling
    split: Split
    fingers: int
    normals: FloatArray | None  # (m, p), orthonormal directions of forces, where some tangents carry none
    pads: tuple[FloatArray, FloatArray] | None = None  # normals (m, p) of compliant fingertips, their stiffness [N/m]
    compliance: FloatArray | float = 0.0  # of dampers in series (m,) [m/(N s)]

    def __call__(self, shifts: float, turns: float, internal: float) -> FloatArray:
        K_t, K_r, K_i = self.parts
        return self.soften(self.release_tangents(shifts * K_t + turns * K_r + internal * K_i))

    @property
    def is_sum(self) -> bool:
        """Whether K is the sum of its parts, each times its factor: no tangents slip, no pads are in series."""
        return self.normals is None and self.pads is None

    @cached_property
    def parts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """K of shifts, of turns and internal, (m, m) each."""
        n, m = self.fingers, self.split.components
        d = m // n
        zero = Impedance(0.0)
        form = self.law.form
        outer = Coupling(external=Impedance(self.law.external.stiffness), internal=zero, form=form)
        inner = Coupling(external=zero, internal=Impedance(self.law.internal.stiffness), form=form)
        K_e = outer.stiffness(self.split)
        # the projector on uniform shifts in the metric, 1 (1'M 1)^-1 1'M
        one = np.tile(np.eye(d), (n, 1))
        weighed = (self.split.metric * one.T).T
        Q = one @ np.linalg.solve(one.T @ weighed, weighed.T)
        K_t = (K_e @ Q + (K_e @ Q).T) / 2
        return K_t, K_e - K_t, inner.stiffness(self.split)

    def damping(self, external: float, internal: float) -> FloatArray:
        """Give D of the law, (m, m) [N s/m], with each of its dampings times a factor."""
        law = self.law
        if (external, internal) != (1.0, 1.0):
            outer, inner = (
                Impedance(0.0, np.multiply(part.damping, factor))
                for part, factor in ((law.external, external), (law.internal, internal))
            )
            law = Coupling(outer, inner, form=law.form)
        return self.release_tangents(in_series(law.damping(self.split), self.compliance))

    def alone(self, k: float) -> FloatArray:
        """Give K for every finger by itself with stiffness k, in the metric."""
        law = Coupling(external=Impedance(k), internal=Impedance(k), form=self.law.form)
        return self.soften(self.release_tangents(law.stiffness(self.split)))

    def soften(self, K: FloatArray) -> FloatArray:
        """Put the pads in series with K."""
        return K if self.pads is None else springs_in_series(K, *self.pads)

    def release_tangents(self, K: FloatArray) -> FloatArray:
        """Release the tangents of contacts that slip from K."""
        if self.normals is None:
            return K
        m, p = self.normals.shape
        basis = np.linalg.qr(self.normals, mode="complete")[0]
        turned = basis.T @ K @ basis
        normals = np.arange(m) < p
        normal = basis[:, :p]
        return np.asarray(normal @ condensed(turned, normals) @ normal.T)


def force_directions(scene: Scene, grip: Grip, fingers: NDArray[np.intp]) -> FloatArray | None:
    """Give the directions (m, p) of contact forces where some have no friction; None where all carry all."""
    d, rules = grip.d, scene.coupling
    smooth = [not scene.coefficients[i] for i in fingers]
    if rules.contact == "attached" or rules.friction == "stick" or d == 1 or not any(smooth):
        return None
    blocks = [
        normal[:, None] if free else np.eye(d) for normal, free in zip(grip.grasped.inward(), smooth, strict=True)
    ]
    return block_diagonal(blocks)


def contact_axes(g: GraspedObject, R: FloatArray) -> FloatArray:
    """Give the contacts' frames in world axes, the normal first, (n, d, d) with the axes as columns."""
    frames = g.rows[:, FRAME : FRAME + 9].reshape(-1, 3, 3)
    return np.asarray(R @ np.swapaxes(frames, 1, 2))[:, : g.dimensions, : g.dimensions]


def block_diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    """Put matrices along a diagonal."""
    whole = np.zeros((sum(len(block) for block in blocks), sum(block.shape[1] for block in blocks)))
    row = column = 0
    for block in blocks:
        whole[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return whole
