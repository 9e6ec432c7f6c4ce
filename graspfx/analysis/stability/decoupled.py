"""Parts of a loop that move by themselves: the object with what reaches it, and other motions, alike ones once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation

FloatArray = NDArray[np.float64]

FAINT = 1e-9  # relative: levers and preloads below it change a limit by less than its rounding, by their square
NOTHING = 1e-11  # relative: what a coupling below it does to a limit is less than its rounding
SHORTEST = 1e-3  # of the levers of an object's coordinate [m]
ALIKE = 1e-12  # relative: by what gains, devices and hands of alike motions differ


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a loop that moves by itself.

    Attributes:
        linear: the part as a loop of its own; without an object for motions that do not reach it.
        basis: B (m, k), x = B y: its stiffness is B'K B; None for a loop that is one part, in its own coordinates.
    """

    linear: Linearisation
    basis: FloatArray | None

    def stiffness(self, K: FloatArray) -> FloatArray:
        """Give K of the whole loop on the part's own coordinates."""
        return K if self.basis is None else np.asarray(self.basis.T @ K @ self.basis)


def parts_of(linear: Linearisation, gains: Sequence[FloatArray] = ()) -> list[Part]:
    """Divide a loop into parts that move by themselves whatever the factors of its gains.

    Devices are measured in the square root of their masses. The smallest space that holds what the object's motion and
    its forces reach, G', G_e', G_c' and the preload, and that no stiffness, damping, friction or hand leads out of, is
    the part with the object. What is orthogonal to it moves as on a wall: where all matrices have common eigenvectors
    there, each is a loop of one coordinate, and alike ones are listed once. With n fingers alike that leaves at most 15
    coordinates of 3 n, whatever n. Limits and spectral radii are those of the whole loop to rounding.

    Args:
        linear: the loop.
        gains: symmetric matrices (m, m) that its stiffness is put together from; its stiffness alone if empty.
    """
    m, r = linear.coordinates
    if m <= r:
        return [Part(linear, None)]
    root = np.sqrt(linear.mass / linear.mass.mean())
    matrices = [linear.damping, linear.hand_stiffness, np.diag(linear.friction) + linear.hand_damping]
    operator = linear.operator
    if operator is not None:
        if not operator.alike:
            return [Part(linear, None)]
        matrices += [A for A in (*operator.springs, linear.hand_damping, np.diag(linear.friction)) if A.size]
    matrices = [A / np.outer(root, root) for A in [*(gains or [linear.stiffness]), *matrices] if A.any()]
    if operator is not None:
        matrices += [A * root / root[:, None] for A in operator.ratios if A.any()]
    seeds = [linear.G, linear.G_displacement] + ([] if linear.G_contact is None else [linear.G_contact])
    lengths = np.maximum(np.linalg.norm(linear.G * root, axis=1), SHORTEST)[:, None]
    rows = [A * root / lengths for A in seeds]
    if linear.preload is not None:
        N = linear.preload
        stiffest = float(np.abs(linear.stiffness).max(initial=0.0)) or 1.0
        rows += [each / root / stiffest / lengths for each in (N[:m, m:].T, N[m:, :m])]
        N_x = N[:m, :m] / np.outer(root, root)
        if np.abs(N_x).max(initial=0.0) > NOTHING * np.abs(linear.stiffness).max(initial=0.0):
            matrices.append(N_x)
    matrices += [A.T for A in matrices if (A != A.T).any()]
    lags = (linear.delay, linear.lateness, linear.age)
    alike = all((lag == lag[0]).all() for lag in lags)
    reached = _closure(np.vstack(rows), matrices) if alike else None
    if reached is None:
        return [Part(linear, None)]
    rest = np.linalg.qr(reached, mode="complete")[0][:, reached.shape[1] :] if reached.size else np.eye(m)
    parts = [_part(linear, root, reached, True)] if reached.size and r else []
    axes = _common_axes([rest.T @ A @ rest for A in matrices])
    if axes is None:
        return [*parts, _part(linear, root, rest, False)]
    rest = rest @ axes
    figures = np.stack([np.einsum("ij,jk,ik->i", rest.T, A, rest.T) for A in matrices], axis=1)
    scale = np.array([np.abs(A).max() for A in matrices])
    for i in range(len(figures)):
        if not any((np.abs(figures[i] - figures[k]) <= ALIKE * scale).all() for k in range(i)):
            parts.append(_part(linear, root, rest[:, [i]], False))
    return parts


def _closure(rows: FloatArray, matrices: Sequence[FloatArray]) -> FloatArray | None:
    """Find an orthonormal basis (m, k) of the least space that holds the rows and that no matrix leads out of.

    None where that is the whole space.
    """
    m = rows.shape[1]
    new, basis, least = rows.T, np.zeros((m, 0)), FAINT
    scales = [float(np.linalg.norm(A)) for A in matrices]
    while new.size:
        left, sizes, _ = np.linalg.svd(new, full_matrices=False)
        fresh, least = left[:, sizes > least], NOTHING
        basis = np.linalg.qr(np.hstack([basis, fresh]))[0]
        if basis.shape[1] >= m:
            return None
        if not fresh.size:
            break
        images = np.hstack([A @ fresh / scale for A, scale in zip(matrices, scales, strict=True)])
        new = images - basis @ (basis.T @ images)
        new -= basis @ (basis.T @ new)
    return basis


def _common_axes(matrices: Sequence[FloatArray]) -> FloatArray | None:
    """Find orthonormal columns that diagonalise all of the matrices, to `NOTHING` of each; None without any."""
    sizes = [max(float(np.abs(A).max(initial=0.0)), 1e-300) for A in matrices]
    if any(np.abs(A - A.T).max(initial=0.0) > NOTHING * size for A, size in zip(matrices, sizes, strict=True)):
        return None
    # one combination with unequal weights has the common eigenvectors, unless two sums of eigenvalues coincide
    weights = 0.61803398875 ** np.arange(len(matrices))
    axes = np.linalg.eigh(sum((w / size * A for w, size, A in zip(weights, sizes, matrices, strict=True))))[1]
    for A, size in zip(matrices, sizes, strict=True):
        turned = axes.T @ A @ axes
        if np.abs(turned - np.diag(np.diag(turned))).max(initial=0.0) > NOTHING * size:
            return None
    return np.asarray(axes)


def _part(linear: Linearisation, root: FloatArray, columns: FloatArray, with_object: bool) -> Part:
    """Restrict a loop to orthonormal columns of its devices' coordinates, each times the root of its mass."""
    m, r = linear.coordinates
    k, q = columns.shape[1], r if with_object else 0
    B, forces = columns / root[:, None], columns * root[:, None]  # x = B y, and f of the part's own

    def on(A: FloatArray) -> FloatArray:
        value = A[0, 0] / root[0] ** 2
        if (np.diag(value * root**2) == A).all():
            return np.asarray(value * np.eye(k))  # one number for all in units of their masses, without rounding
        return np.asarray(B.T @ A @ B)

    preload = None
    if linear.preload is not None:
        wide = np.zeros((m + r, k + q))
        wide[:m, :k], wide[m : m + q, k:] = B, np.eye(q)
        preload = wide.T @ linear.preload @ wide
    changes: dict[str, Any] = {
        "mass": np.full(k, linear.mass.mean()),
        "friction": np.zeros(k),
        "hand_stiffness": on(linear.hand_stiffness),
        "hand_damping": on(np.diag(linear.friction) + linear.hand_damping),
        "stiffness": on(linear.stiffness),
        "damping": on(linear.damping),
        "delay": linear.delay[:k],
        "lateness": linear.lateness[:k],
        "age": linear.age[:k],
        "preload": preload,
        "G": linear.G[:q] @ forces,
        "G_displacement": linear.G_displacement[:q] @ forces,
        "operator": linear.operator,
        "G_contact": None if linear.G_contact is None else linear.G_contact[:q] @ forces,
    }
    if linear.operator is not None:
        own = linear.operator.on(B, forces)
        changes["operator"] = own
        if own.limbs:  # the device's friction is not the hand's, between tip and limb
            changes["hand_damping"] = on(linear.hand_damping)
            changes["operator"] = replace(own, friction=own.friction + on(np.diag(linear.friction)))
    if not with_object:
        none = np.zeros((0, 0))
        changes |= {"inertia": none, "viscosity": none, "ground": None, "object_delay": 0}
    return Part(linear.with_arrays(**changes), B)
