"""Modes of a loop in closed form, and division of a loop into smaller loops that are independent for all gains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.critical import Limits
from graspfx.analysis.linearisation import Linearisation, Subject, linear_of
from graspfx.analysis.sampled_plant import Plant
from graspfx.analysis.stability.loop import radius_of
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

SAME = 1e-9  # relative tolerance for equal and for zero properties of modes
COMMUTING = 1e-8  # relative off-diagonal rest of commuting matrices in their common axes
FAINT = 1e-9  # relative: smaller arms and preloads, whose squares enter a limit, change it by less than rounding
NOTHING = 1e-11  # relative: a smaller coupling changes a limit by less than rounding
SHORTEST = 1e-3  # smallest arm of an object's coordinate [m]
ALIKE = 1e-12  # relative difference of gains, devices and hands up to which motions are equal


def common_axes(matrices: Sequence[FloatArray], tolerance: float) -> FloatArray | None:
    """Find common orthonormal eigenvectors (columns) of all matrices within a relative tolerance; None without any."""
    sizes = [max(float(np.abs(A).max(initial=0.0)), 1e-300) for A in matrices]
    if any(np.abs(A - A.T).max(initial=0.0) > tolerance * size for A, size in zip(matrices, sizes, strict=True)):
        return None
    # a combination with unequal weights has the common eigenvectors, unless two sums of eigenvalues coincide
    weights = 0.61803398875 ** np.arange(len(matrices))
    axes: FloatArray = np.linalg.eigh(sum((w / size * A for w, size, A in zip(weights, sizes, matrices, strict=True))))[
        1
    ]
    for A, size in zip(matrices, sizes, strict=True):
        turned = axes.T @ A @ axes
        if np.abs(turned - np.diag(np.diag(turned))).max(initial=0.0) > tolerance * size:
            return None
    return axes


# Modes in closed form ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Mode:
    """A mode of a closed loop: one or more motions that are independent of the others.

    Attributes:
        kind: "internal" (equivalent to a device on a wall), "external" (equivalent to a device that moves an object) or
            "coupled" (several external motions that depend on one another).
        count: Number of motions in the mode; internal motions with equal gains form one mode.
        stiffness, damping: Stiffness [N/m] and damping [N s/m] of the coupling; matrices (count, count) if "coupled".
        object_mass, object_viscosity: Mass [kg] and viscosity [N s/m] of the equivalent object; 0 if "internal",
            matrices (count, count) if "coupled".
        spectral_radius: Spectral radius of the mode's closed loop.
        motions: Orthonormal columns (m, count) of device motions; entries are in units of displacement times the square
            root of the device's mass over the mean mass.
        limits: Limits of the mode's stiffness at its damping; None if "coupled".
    """

    kind: str
    count: int
    stiffness: float | FloatArray
    damping: float | FloatArray
    object_mass: float | FloatArray
    object_viscosity: float | FloatArray
    spectral_radius: float
    motions: FloatArray = field(repr=False)
    limits: Limits | None = field(repr=False)


def modes(linear: Subject) -> list[Mode]:
    """List the modes of a grasp of identical devices without preload, internal modes first.

    With m device coordinates and r object coordinates, m - r internal motions are equivalent to a device on a wall, and
    r external motions to a device that moves an object. Masses, viscosities, stiffnesses and dampings of the external
    modes are the eigenvalues of (G G')^-1/2 X (G G')^-1/2 with X = M_o, B_o, G K G' and G D G' (`Linearisation`). If
    these matrices do not commute, the external motions form one coupled mode. Devices of different mass count as
    identical if their friction, hand and gains are proportional to the mass.

    Args:
        linear: `Linearisation`, scene, or name or path of a scene.

    Raises:
        InputError: If devices or delays differ, `rate` is not "difference", the rows of G are linearly dependent, gains
            mix internal and external forces, internal stiffness and damping do not commute, or there is a preload, a
            ground or an operator model. `spectral_radius` does not have these restrictions.
    """
    linear = linear_of(linear)
    r = linear.coordinates[1]
    device, root = _device(linear)
    G = linear.G * root
    K, D = linear.stiffness / np.outer(root, root), linear.damping / np.outer(root, root)
    left, sizes, right = np.linalg.svd(G)
    if r and (len(sizes) < r or sizes[-1] <= SAME * sizes[0]):
        raise InputError("G", linear.G, "independent rows", "omit degrees of freedom that the fingers cannot move")
    U, inner = right[:r].T @ left.T, right[r:].T  # G = (G G')^1/2 U'
    for name, A in (("stiffness", K), ("damping", D)):
        if np.abs(inner.T @ A @ U).max(initial=0.0) + np.abs(U.T @ A @ inner).max(initial=0.0) > SAME * np.abs(A).max():
            raise InputError(name, A, "gains that do not mix external and internal forces")
    per_root = left @ np.diag(1.0 / sizes) @ left.T  # (G G')^-1/2
    parts = [U.T @ K @ U, U.T @ D @ U, per_root @ linear.inertia @ per_root, per_root @ linear.viscosity @ per_root]
    internal = _internal(device, inner, inner.T @ K @ inner, inner.T @ D @ inner)
    return internal + _external(linear, device, U, parts)


def _device(linear: Linearisation) -> tuple[Plant, FloatArray]:
    """Return a device that represents all devices, and square roots (m,) of each device's mass over the mean mass."""
    if linear.preload is not None and linear.preload.any():
        raise InputError("preload", linear.preload, "no preload", "the modes of a squeezed grasp are not independent")
    if not np.allclose(linear.G, linear.G_displacement, rtol=0.0, atol=SAME * np.abs(linear.G).max(initial=0.0)):
        do = "the modes of a squeezed grasp are not independent"
        raise InputError("G_displacement", linear.G_displacement, "a matrix equal to G", do)
    if linear.operator is not None:
        do = "modes have a closed form only if hands are springs and dampers"
        raise InputError("operator", linear.operator, "no operator model", do)
    if linear.ground is not None:
        raise InputError("ground", linear.ground, "no ground", "the modes of a supported object are not independent")
    for name, each in (("delay", linear.delay), ("latency", linear.latency)):
        if (each != each[0]).any():
            raise InputError(name, each.tolist(), "the same value for every device")
    if linear.rate != "difference":
        raise InputError("rate", linear.rate, "'difference'")
    mean = float(linear.mass.mean())
    root = np.sqrt(linear.mass / mean)
    values = []
    for name, A in (
        ("friction", np.diag(linear.friction) + linear.hand_damping),
        ("hand_stiffness", linear.hand_stiffness),
    ):
        scaled = A / np.outer(root, root)
        value = float(np.trace(scaled)) / len(root)
        if np.abs(scaled - value * np.eye(len(root))).max() > SAME * max(value, 1e-300):
            raise InputError(name, A, "one number for all devices, or proportional to the masses")
        values.append(value)
    delay, latency = int(linear.delay[0]), float(linear.latency[0])
    return Plant(mean, values[0], linear.period, spring=values[1], delay=delay, latency=latency), root


def _internal(device: Plant, inner: FloatArray, K: FloatArray, D: FloatArray) -> list[Mode]:
    if not inner.shape[1]:
        return []
    turn = common_axes([K, D], COMMUTING)
    if turn is None:
        raise InputError("stiffness", K, "internal stiffness and damping that are symmetric and commute")
    gains = np.stack([np.diag(turn.T @ K @ turn), np.diag(turn.T @ D @ turn)], axis=1)
    motions = inner @ turn
    scale = np.abs(gains).max(axis=0) + 1e-300
    order = np.lexsort(np.round(gains / scale, 9).T[::-1])
    modes: list[Mode] = []
    while len(order):
        k, d = gains[order[0]].tolist()
        same = (np.abs(gains[order] - gains[order[0]]) <= SAME * scale).all(axis=1)
        members, order = order[same], order[~same]
        limits = replace(device, coupling_damping=d).limits()
        radius = limits.spectral_radius(k)
        modes.append(Mode("internal", len(members), k, d, 0.0, 0.0, radius, motions[:, members], limits))
    return modes


def _external(linear: Linearisation, device: Plant, U: FloatArray, parts: Sequence[FloatArray]) -> list[Mode]:
    if not U.shape[1]:
        return []
    turn = common_axes(parts, COMMUTING)
    if turn is None:
        K, D, M, B = parts
        r = len(M)
        block = Linearisation(
            period=device.period,
            mass=device.mass,
            friction=device.damping,
            hand_stiffness=device.spring,
            G=np.eye(r),
            inertia=(M + M.T) / 2,
            viscosity=B,
            stiffness=K,
            damping=D,
            delay=device.delay,
            lateness=device.latency,
            object_delay=linear.object_delay,
            integrator=linear.integrator,
        )
        return [Mode("coupled", r, K, D, M, B, radius_of(block), U, None)]
    device = replace(device, integrator=linear.integrator, object_delay=linear.object_delay)
    modes = []
    for axis in turn.T:
        k, d, M_i, b_i = (float(axis @ A @ axis) for A in parts)
        limits = replace(device, coupling_damping=d, object_mass=M_i, object_damping=b_i).limits()
        modes.append(Mode("external", 1, k, d, M_i, b_i, limits.spectral_radius(k), (U @ axis)[:, None], limits))
    return modes


# Parts independent for all gains -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a loop that is independent of the other parts.

    Attributes:
        linear: Loop of the part, without an object if the part's motions do not move the object.
        basis: Matrix (m, k) from the part's coordinates to the device coordinates of the whole loop; None if the part
            is the whole loop.
    """

    linear: Linearisation
    basis: FloatArray | None

    def stiffness(self, K: FloatArray) -> FloatArray:
        """Transform a stiffness K (m, m) of the whole loop to the part's coordinates, (k, k)."""
        return K if self.basis is None else np.asarray(self.basis.T @ K @ self.basis)


def parts_of(linear: Linearisation, gains: Sequence[FloatArray] = ()) -> list[Part]:
    """Divide a loop into parts that are independent for all values of its gains.

    The part with the object is the smallest space of device motions that contains the ranges of G', G_e', G_c' and the
    preload, through which object and devices act on each other, and that is invariant under stiffness, damping,
    friction and hands. In the orthogonal complement of this space, devices move as on a wall. If all matrices have
    common eigenvectors in the complement, each eigenvector is a part of one coordinate, and equal parts are listed
    once. Device coordinates are scaled by the square roots of their masses. With n equal fingers, at most 15 of 3 n
    coordinates remain, for any n. Limits and spectral radii are those of the whole loop, to rounding.

    Args:
        linear: Loop to divide.
        gains: Symmetric matrices (m, m); every stiffness of interest is a linear combination of them. If empty, only
            multiples of the loop's stiffness are considered.
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
    axes = common_axes([rest.T @ A @ rest for A in matrices], NOTHING)
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
    """Find an orthonormal basis (m, k) of the smallest space that contains the rows and is invariant under `matrices`.

    Return None if this space has m dimensions.
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


def _part(linear: Linearisation, root: FloatArray, columns: FloatArray, with_object: bool) -> Part:
    """Restrict a loop to the space of orthonormal columns (m, k), in device coordinates scaled by `root` (m,)."""
    m, r = linear.coordinates
    k, q = columns.shape[1], r if with_object else 0
    B, forces = columns / root[:, None], columns * root[:, None]  # x = B y, and the part's own f

    def on(A: FloatArray) -> FloatArray:
        value = A[0, 0] / root[0] ** 2
        if (np.diag(value * root**2) == A).all():
            return np.asarray(value * np.eye(k))  # one number for all, in units of their masses, without rounding
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
        if own.limbs:  # friction of the device differs from that of the hand, between tip and limb
            changes["hand_damping"] = on(linear.hand_damping)
            changes["operator"] = replace(own, friction=own.friction + on(np.diag(linear.friction)))
    if not with_object:
        none = np.zeros((0, 0))
        changes |= {"inertia": none, "viscosity": none, "ground": None, "object_delay": 0}
    return Part(linear.with_arrays(**changes), B)
