"""Operators who are not springs, linearised: their matrices about the forces with which a grasp rests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.operator_matrices import OperatorMatrices
from graspfx.build.resolve import Parts
from graspfx.build.still_hands import StillHand
from graspfx.loop.operator import Operator

FloatArray = NDArray[np.float64]


def operated(
    parts: Parts, hands: Sequence[StillHand], force: FloatArray
) -> tuple[OperatorMatrices | None, FloatArray, FloatArray]:
    """Linearise the operators of all fingers of a scene about the forces at rest.

    Args:
        parts: of the scene.
        hands: still ones.
        force: f on the objects, (n, d) in world axes [N]; zero where nothing presses.

    Returns:
        The matrices in world axes, finger by finger, None where all hands are springs and dampers; and what the grip
        adds to their stiffness and damping (n d,) [N/m, N s/m].
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
        delay[~reacting] = delay[reacting].max()  # of what is zero, any
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


def turned(
    operator: OperatorMatrices | None, columns: NDArray[np.intp], V: FloatArray, friction: FloatArray
) -> OperatorMatrices | None:
    """Restrict an operator to some coordinates, in their order, and turn it to the axes V of each finger.

    Args:
        operator: in world axes, finger by finger.
        columns: the coordinates.
        V: (m, m), block by block.
        friction: what is not on the diagonal of the devices' own, in their axes (m, m).
    """
    if operator is None:
        return None
    block = np.ix_(columns, columns)
    rows = operator.limb[columns]
    limbs = np.nonzero(rows)[1]  # in the order of the coordinates
    S = rows[:, limbs]
    own, W = np.ix_(limbs, limbs), V[np.ix_(S.any(axis=1), S.any(axis=1))]
    return replace(
        operator,
        limb=S,
        limb_mass=W.T @ operator.limb_mass[own] @ W,
        limb_stiffness=W.T @ operator.limb_stiffness[own] @ W,
        limb_damping=W.T @ operator.limb_damping[own] @ W,
        pull=V.T @ operator.pull[block] @ V,
        pull_damping=V.T @ operator.pull_damping[block] @ V,
        counter=V.T @ operator.counter[block] @ V,
        delay=operator.delay[columns],
        grip=V.T @ operator.grip[block] @ V,
        grip_share=operator.grip_share[columns],
        friction=friction,
    )


def assumptions(parts: Parts, fingers: Sequence[int], force: FloatArray) -> Iterator[str]:
    """Say at which rest the operators of fingers are linearised, and what of them is left out.

    Args:
        parts: of the scene.
        fingers: their numbers.
        force: f of all fingers, (n, d) [N].
    """
    tables = {hand.fingers[0]: hand.holding.table for hand in parts.hands if set(hand.fingers) & set(fingers)}
    own = [table for table in tables.values() if table is not None and table.form != "made"]
    if any(table.stiffening is not None for table in own):
        grip = np.linalg.norm(force, axis=1)
        forces = ", ".join(f"{parts.scene.finger_names[i]} {grip[i]:.3g} N" for i in fingers)
        yield f"hands as stiff as grip makes them at rest ({forces}), and the squeeze's own force growing with it"
    if any(table.reaction is not None for table in own):
        yield "reactions as late as they are, to the nearest sample; no such operator is passive"
    inputs = [name for name in ("tremor", "noise") if any(getattr(table, name) is not None for table in own)]
    if inputs:
        yield f"{' and '.join(inputs)} left out: what comes from outside moves no eigenvalue"


def _operator(still: StillHand) -> Operator | None:
    operator: Operator | None = getattr(still.hand, "operator", None)
    return operator
