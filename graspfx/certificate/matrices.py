"""Matrices of a grasp in equilibrium: gains of eq. (4), compliant fingertips, and operators with limbs or reactions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.grasp_stiffness import condensed, in_series, springs_in_series
from graspfx.analysis.linearisation import OperatorMatrices
from graspfx.assembly.grasps import StillHand
from graspfx.assembly.resolve import Parts
from graspfx.certificate.grip import Grip
from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.grasped import GraspedObject
from graspfx.grasp.impedance import Coupling, Impedance
from graspfx.grasp.split import Split
from graspfx.loop.operator import Operator
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ScaledGains:
    """Stiffness and damping matrices of one grasp, as functions of factors of the gains.

    Called with factors of the external stiffness in translations, of the external stiffness in rotations, and of the
    internal stiffness, it returns the stiffness matrix (m, m) [N/m]. Contacts without friction have no tangential
    stiffness.
    """

    law: Coupling
    split: Split
    fingers: int
    normals: FloatArray | None  # (m, p), orthonormal directions of forces; None if all tangents carry force
    pads: tuple[FloatArray, FloatArray] | None = None  # normals (m, p) and stiffness of compliant fingertips [N/m]
    compliance: FloatArray | float = 0.0  # compliance of dampers in series, (m,) [m/(N s)]
    of_object: tuple[FloatArray, ...] | None = None  # `GraspedObject.object_gains` in world axes, for an object's gains

    def __call__(self, shifts: float, turns: float, internal: float) -> FloatArray:
        K_t, K_r, K_i = self.parts
        return self.soften(self.release_tangents(shifts * K_t + turns * K_r + internal * K_i))

    @property
    def is_sum(self) -> bool:
        """Whether the stiffness matrix is the sum of its scaled `parts`: all contacts have friction, none has a pad."""
        return self.normals is None and self.pads is None

    @cached_property
    def parts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Stiffness matrices of external translations, external rotations, and internal displacements, (m, m) each."""
        if self.of_object is not None:
            return self.of_object[0], self.of_object[1], self.of_object[2]
        n, m = self.fingers, self.split.components
        d = m // n
        zero = Impedance(0.0)
        form = self.law.form
        outer = Coupling(external=Impedance(self.law.external.stiffness), internal=zero, form=form)
        inner = Coupling(external=zero, internal=Impedance(self.law.internal.stiffness), form=form)
        K_e = outer.stiffness(self.split)
        # projector on uniform translations in the metric, 1 (1'M 1)^-1 1'M
        one = np.tile(np.eye(d), (n, 1))
        weighed = (self.split.metric * one.T).T
        Q = one @ np.linalg.solve(one.T @ weighed, weighed.T)
        K_t = (K_e @ Q + (K_e @ Q).T) / 2
        return K_t, K_e - K_t, inner.stiffness(self.split)

    def damping(self, external: float, internal: float) -> FloatArray:
        """Return the damping matrix (m, m) [N s/m] with factors of the external and the internal damping."""
        law = self.law
        if self.of_object is not None:
            D = external * self.of_object[3] + internal * self.of_object[4]
            return self.release_tangents(in_series(D, self.compliance))
        if (external, internal) != (1.0, 1.0):
            outer, inner = (
                Impedance(0.0, np.multiply(part.damping, factor))
                for part, factor in ((law.external, external), (law.internal, internal))
            )
            law = Coupling(outer, inner, form=law.form)
        return self.release_tangents(in_series(law.damping(self.split), self.compliance))

    def alone(self, k: float) -> FloatArray:
        """Return the stiffness matrix (m, m) if each finger has the stiffness k [N/m] times its weight in the split."""
        law = Coupling(external=Impedance(k), internal=Impedance(k), form=self.law.form)
        return self.soften(self.release_tangents(law.stiffness(self.split)))

    def soften(self, K: FloatArray) -> FloatArray:
        """Return the stiffness matrix of springs with the matrix K in series with the compliant fingertips."""
        return K if self.pads is None else springs_in_series(K, *self.pads)

    def release_tangents(self, K: FloatArray) -> FloatArray:
        """Return K without stiffness along the tangents of contacts without friction, by static condensation."""
        if self.normals is None:
            return K
        m, p = self.normals.shape
        basis = np.linalg.qr(self.normals, mode="complete")[0]
        turned = basis.T @ K @ basis
        normals = np.arange(m) < p
        normal = basis[:, :p]
        return np.asarray(normal @ condensed(turned, normals) @ normal.T)


def force_directions(scene: Scene, grip: Grip, fingers: NDArray[np.intp]) -> FloatArray | None:
    """Return an orthonormal basis (m, p) of the contact forces; None if all contacts have tangential forces."""
    d, rules = grip.d, scene.coupling
    smooth = [not scene.coefficients[i] for i in fingers]
    if rules.contact == "attached" or rules.friction == "stick" or d == 1 or not any(smooth):
        return None
    blocks = [
        normal[:, None] if free else np.eye(d) for normal, free in zip(grip.grasped.inward(), smooth, strict=True)
    ]
    return block_diagonal(blocks)


def contact_axes(g: GraspedObject, R: FloatArray) -> FloatArray:
    """Return the axes of each contact in world axes, as columns (n, d, d); the first axis is the normal.

    Args:
        g: Object with its fingers.
        R: Rotation matrix of the object.
    """
    frames = g.array(FingerState.frame).reshape(-1, 3, 3)
    return np.asarray(R @ np.swapaxes(frames, 1, 2))[:, : g.dimensions, : g.dimensions]


def block_diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    """Return the block-diagonal matrix of the blocks, which need not be square."""
    whole = np.zeros((sum(len(block) for block in blocks), sum(block.shape[1] for block in blocks)))
    row = column = 0
    for block in blocks:
        whole[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return whole


def pads_of(g: GraspedObject, *, at_rest: bool) -> tuple[FloatArray, FloatArray] | None:
    """Return the normals (m, p) and the stiffness (p,) [N/m] of compliant fingertips; None if there are none.

    Args:
        g: Object with its fingers.
        at_rest: Whether the grasp is in equilibrium under load; if not, the stiffness is zero.
    """
    stiffness, n, d = g.pad_stiffness(), g.fingers, g.dimensions
    padded = np.flatnonzero(np.isfinite(stiffness))
    if not len(padded):
        return None
    normals = np.zeros((n, d, len(padded)))
    normals[padded, :, np.arange(len(padded))] = g.inward()[padded]
    return normals.reshape(n * d, -1), stiffness[padded] if at_rest else np.zeros(len(padded))


def joined_pads(gains: Sequence[ScaledGains], V: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return the normals and the stiffness of the compliant fingertips of several grasps; None if there are none.

    Args:
        gains: Matrices of each grasp.
        V: Axes of the coordinates in which the normals are returned, as columns (m, m).
    """
    if all(each.pads is None for each in gains):
        return None
    pads = [each.pads or (np.zeros((each.split.components, 0)), np.zeros(0)) for each in gains]
    return V.T @ block_diagonal([normals for normals, _ in pads]), np.concatenate([springs for _, springs in pads])


# Operators -----------------------------------------------------------------------------------------------------------


def operated(
    parts: Parts, hands: Sequence[StillHand], force: FloatArray
) -> tuple[OperatorMatrices | None, FloatArray, FloatArray]:
    """Linearise the operators of all fingers of a scene about an equilibrium.

    Args:
        parts: Parts of the scene.
        hands: Hands without motion.
        force: Forces of all fingers on the objects in equilibrium in world axes, (n, d) [N]; zero without a load.

    Returns:
        Matrices of the operators in world axes, finger by finger, or None if all hands are springs and dampers; and the
        stiffness and damping that hands gain because they stiffen with the grip force, (n d,) [N/m] and [N s/m].
    """
    n, d = force.shape
    m, T = n * d, parts.scene.period
    stiffer, damper = np.zeros((n, d)), np.zeros((n, d))
    if all(_operator(each) is None for each in hands):
        return None, stiffer.ravel(), damper.ravel()
    has_limb = np.zeros((n, d), dtype=bool)
    M, K, B = np.ones((n, d)), np.zeros((n, d)), np.zeros((n, d))
    P, Q, C, share = np.zeros((n, d)), np.zeros((n, d)), np.zeros((n, d)), np.zeros((n, d))
    delay = np.zeros((n, d), dtype=np.int64)
    A = np.zeros((n, d, n, d))
    for still in hands:
        operator = _operator(still)
        if operator is None:
            continue
        own = force[still.fingers]
        stretch = operator.stretch_at_rest(still.hand.stiffness, own)
        for k, i in enumerate(still.fingers):
            finger = operator.finger(k)
            grip = float(np.linalg.norm(own[k]))
            if finger.limb_mass:
                has_limb[i], M[i] = True, finger.limb_mass
                K[i] = [finger.limb_stiffness[a] for a in range(d)]
                B[i] = [finger.limb_damping[a] for a in range(d)]
            stiffer[i], damper[i] = finger.rise * grip, finger.damping_rise * grip
            P[i], Q[i], C[i] = finger.pull, finger.pull_damping, finger.counter
            delay[i] = max(1, round(finger.delay / T)) if finger.delay else 0
            share[i] = np.exp(-T / finger.grip_lag) if finger.grip_lag else 0.0
            if finger.rise and grip:
                A[i, :, i, :] = -finger.rise * np.outer(stretch[k], own[k] / grip)
    reacting = (P != 0.0) | (Q != 0.0) | (C != 0.0)
    if reacting.any():
        delay[~reacting] = delay[reacting].max()  # arbitrary, since their reaction is zero
    if (share != 0.0).any():
        share[share == 0.0] = share.max()
    matrices = OperatorMatrices(
        limb=np.eye(m)[:, has_limb.ravel()],
        limb_mass=np.diag(M[has_limb]),
        limb_stiffness=np.diag(K[has_limb]),
        limb_damping=np.diag(B[has_limb]),
        pull=np.diag(P.ravel()),
        pull_damping=np.diag(Q.ravel()),
        counter=np.diag(C.ravel()),
        delay=delay.ravel(),
        grip=A.reshape(m, m),
        grip_share=share.ravel(),
        friction=np.zeros((m, m)),
    )
    return matrices, stiffer.ravel(), damper.ravel()


def assumptions(parts: Parts, fingers: Sequence[int], force: FloatArray) -> Iterator[str]:
    """Yield assumptions of the linearised operators, as sentences.

    Args:
        parts: Parts of the scene.
        fingers: Indices of the fingers whose operators are linearised.
        force: Forces of all fingers on the objects in equilibrium, (n, d) [N].
    """
    tables = {hand.fingers[0]: hand.holding.table for hand in parts.hands if set(hand.fingers) & set(fingers)}
    own = [table for table in tables.values() if table is not None and table.form != "made"]
    if any(table.stiffening is not None for table in own):
        grip = np.linalg.norm(force, axis=1)
        forces = ", ".join(f"{parts.scene.finger_names[i]} {grip[i]:.3g} N" for i in fingers)
        yield f"hands have the stiffness of their grip forces in equilibrium ({forces}), which grows with these forces"
    if any(table.reaction is not None for table in own):
        yield "delays of reactions are rounded to samples; no such operator is passive"
    inputs = [name for name in ("tremor", "noise") if any(getattr(table, name) is not None for table in own)]
    if inputs:
        yield f"{' and '.join(inputs)} omitted: external inputs do not change eigenvalues"


def _operator(still: StillHand) -> Operator | None:
    operator: Operator | None = getattr(still.hand, "operator", None)
    return operator
