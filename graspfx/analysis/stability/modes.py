"""Parts of a loop that move by themselves: modes in closed form, and smaller loops whatever the gains are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.critical import Limits
from graspfx.analysis.linearisation import Linearisation, Subject, linear_of
from graspfx.analysis.plant import Plant
from graspfx.analysis.stability.loop import radius_of
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

SAME = 1e-9  # relative: what equal and zero mean of modes
COMMUTING = 1e-8  # relative: what the axes of matrices that commute may leave beside the diagonal
FAINT = 1e-9  # relative: levers and preloads below it change a limit by less than its rounding, by their square
NOTHING = 1e-11  # relative: what a coupling below it does to a limit is less than its rounding
SHORTEST = 1e-3  # of the levers of an object's coordinate [m]
ALIKE = 1e-12  # relative: by what gains, devices and hands of alike motions differ


def common_axes(matrices: Sequence[FloatArray], tolerance: float) -> FloatArray | None:
    """Find orthonormal columns that diagonalise all of the matrices, to a part of each; None where there are none."""
    sizes = [max(float(np.abs(A).max(initial=0.0)), 1e-300) for A in matrices]
    if any(np.abs(A - A.T).max(initial=0.0) > tolerance * size for A, size in zip(matrices, sizes, strict=True)):
        return None
    # one combination with unequal weights has the common eigenvectors, unless two sums of eigenvalues coincide
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
    """A part of a closed loop that moves by itself.

    Attributes:
        kind: "internal" (a device on a wall), "external" (a device that moves an object) or "coupled" (external motions
            that do not separate).
        count: how many motions: equal internal ones count together, coupled ones are the size of their block.
        stiffness, damping: of the mode's coupling [N/m, N s/m]; (count, count) for "coupled".
        object_mass, object_viscosity: what its device moves [kg, N s/m]; 0 for "internal", matrices for "coupled".
        spectral_radius: of its closed loop.
        motions: (m, count), orthonormal device motions, each times the square root of its mass over their mean.
        limits: of its stiffness, with its damping as it is; None for "coupled".
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
    """List internal modes, then external ones, of a grasp of identical devices at zero preload.

    m - r internal copies of "device + wall k_ip"; r external modes "device + object" with M_i the eigenvalues of
    (G G')^-1/2 M_o (G G')^-1/2 and b_i, k_i likewise, one coupled block if those matrices do not commute. Devices with
    different masses count as identical when friction, springs and gains are proportional to them as by a metric of the
    masses: each is measured in the square root of its mass over their mean.

    Args:
        linear: a `Linearisation`, a scene, or the name or path of one.

    Raises:
        InputError: devices, delays or gains that do not separate, a preload or a ground; `spectral_radius` takes any.
    """
    linear = linear_of(linear)
    r = linear.coordinates[1]
    device, root = _device(linear)
    G = linear.G * root
    K, D = linear.stiffness / np.outer(root, root), linear.damping / np.outer(root, root)
    left, sizes, right = np.linalg.svd(G)
    if r and (len(sizes) < r or sizes[-1] <= SAME * sizes[0]):
        raise InputError("G", linear.G, "rows that are independent", "leave out what the fingers cannot move")
    U, inner = right[:r].T @ left.T, right[r:].T  # G = (G G')^1/2 U'
    for name, A in (("stiffness", K), ("damping", D)):
        if np.abs(inner.T @ A @ U).max(initial=0.0) + np.abs(U.T @ A @ inner).max(initial=0.0) > SAME * np.abs(A).max():
            raise InputError(name, A, "gains that do not mix external and internal forces")
    per_root = left @ np.diag(1.0 / sizes) @ left.T  # (G G')^-1/2
    parts = [U.T @ K @ U, U.T @ D @ U, per_root @ linear.inertia @ per_root, per_root @ linear.viscosity @ per_root]
    internal = _internal(device, inner, inner.T @ K @ inner, inner.T @ D @ inner)
    return internal + _external(linear, device, U, parts)


def _device(linear: Linearisation) -> tuple[Plant, FloatArray]:
    """Give the device that all are, in units of its own mass, and the roots of their masses over the mean."""
    if linear.preload is not None and linear.preload.any():
        raise InputError("preload", linear.preload, "none", "a squeezed grasp has no separate modes")
    if not np.allclose(linear.G, linear.G_displacement, rtol=0.0, atol=SAME * np.abs(linear.G).max(initial=0.0)):
        raise InputError("G_displacement", linear.G_displacement, "G", "a squeezed grasp has no separate modes")
    if linear.operator is not None:
        raise InputError("operator", linear.operator, "none", "modes have a closed form of springs and dampers alone")
    if linear.ground is not None:
        raise InputError("ground", linear.ground, "none", "an object that stands on something has no separate modes")
    for name, each in (("delay", linear.delay), ("latency", linear.latency)):
        if (each != each[0]).any():
            raise InputError(name, each.tolist(), "the same for every device")
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
            raise InputError(name, A, "one number for every device, or proportional to the masses")
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


# Parts whatever the gains are ----------------------------------------------------------------------------------------


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
