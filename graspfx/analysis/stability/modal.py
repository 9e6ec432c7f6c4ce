"""A grasp of equal devices taken apart into internal and external modes, each a device by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis import characteristic
from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.fullloop import radius_of
from graspfx.analysis.stability.limits import Limits, limits_of
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

SAME = 1e-9  # relative: what equal, commuting and zero mean


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


@dataclass(frozen=True)
class _Device:
    """A device in units of its own mass: all devices alike."""

    mass: float
    friction: float
    spring: float


def modes(linear: Linearisation) -> list[Mode]:
    """List internal modes, then external ones, of identical devices at zero preload.

    m - r internal copies of "device + wall k_ip"; r external modes "device + object" with M_i the eigenvalues of
    (G G')^-1/2 M_o (G G')^-1/2 and b_i, k_i likewise, one coupled block if those matrices do not commute. Devices with
    different masses count as identical when friction, springs and gains are proportional to them as by a metric of the
    masses: each is measured in the square root of its mass over their mean.

    Raises:
        InputError: devices, delays or gains that do not separate, a preload or a ground; `spectral_radius` takes any.
    """
    r = linear.coordinates[1]
    device, root = _devices(linear)
    G = linear.G * root
    K, D = linear.stiffness / np.outer(root, root), linear.damping / np.outer(root, root)
    left, sizes, right = np.linalg.svd(G)
    if r and (len(sizes) < r or sizes[-1] <= SAME * sizes[0]):
        raise InputError("G", linear.G, "rows that are independent", "leave out what the fingers cannot move")
    U, inner = right[:r].T @ left.T, right[r:].T  # G = (G G')^1/2 U'
    for name, A in (("stiffness", K), ("damping", D)):
        if np.abs(inner.T @ A @ U).max(initial=0.0) + np.abs(U.T @ A @ inner).max(initial=0.0) > SAME * np.abs(A).max():
            raise InputError(name, A, "gains that do not mix external and internal forces")
    modes_ = _internal(linear, device, inner, inner.T @ K @ inner, inner.T @ D @ inner)
    per_root = left @ np.diag(1.0 / sizes) @ left.T  # (G G')^-1/2
    parts = [U.T @ K @ U, U.T @ D @ U, per_root @ linear.inertia @ per_root, per_root @ linear.viscosity @ per_root]
    return modes_ + _external(linear, device, U, parts)


def _devices(linear: Linearisation) -> tuple[_Device, FloatArray]:
    if linear.preload is not None and linear.preload.any():
        raise InputError("preload", linear.preload, "none", "a squeezed grasp has no separate modes")
    if not np.allclose(linear.G, linear.G_displacement, rtol=0.0, atol=SAME * np.abs(linear.G).max(initial=0.0)):
        raise InputError("G_displacement", linear.G_displacement, "G", "a squeezed grasp has no separate modes")
    if linear.operator is not None:
        raise InputError("operator", linear.operator, "none", "modes have a closed form of springs and dampers alone")
    if linear.ground is not None:
        raise InputError("ground", linear.ground, "none", "an object that stands on something has no separate modes")
    if (linear.delay != linear.delay[0]).any():
        raise InputError("delay", linear.delay.tolist(), "the same for every device")
    if (linear.latency != linear.latency[0]).any():
        raise InputError("latency", linear.latency.tolist(), "the same for every device")
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
    return _Device(mean, *values), root


def _internal(linear: Linearisation, device: _Device, inner: FloatArray, K: FloatArray, D: FloatArray) -> list[Mode]:
    if not inner.shape[1]:
        return []
    turn = together([K, D])
    if turn is None:
        raise InputError("stiffness", K, "internal stiffness and damping that are symmetric and commute")
    gains = np.stack([np.diag(turn.T @ K @ turn), np.diag(turn.T @ D @ turn)], axis=1)
    motions = inner @ turn
    scale = np.abs(gains).max(axis=0) + 1e-300
    order = np.lexsort(np.round(gains / scale, 9).T[::-1])
    modes: list[Mode] = []
    while len(order):
        k, d = gains[order[0]]
        same = (np.abs(gains[order] - gains[order[0]]) <= SAME * scale).all(axis=1)
        members, order = order[same], order[~same]
        P, N = characteristic.wall(
            device.mass,
            device.friction,
            linear.period,
            spring=device.spring,
            damping=d,
            delay=int(linear.delay[0]),
            latency=float(linear.latency[0]),
        )
        limits = limits_of(P, N, device.mass / linear.period**2, linear.period)
        radius = limits.spectral_radius(float(k))
        modes.append(Mode("internal", len(members), float(k), float(d), 0.0, 0.0, radius, motions[:, members], limits))
    return modes


def _external(linear: Linearisation, device: _Device, U: FloatArray, parts: Sequence[FloatArray]) -> list[Mode]:
    if not U.shape[1]:
        return []
    turn = together(parts)
    if turn is None:
        K, D, M, B = parts
        r = len(M)
        block = Linearisation(
            period=linear.period,
            mass=device.mass,
            friction=device.friction,
            hand_stiffness=device.spring,
            G=np.eye(r),
            inertia=(M + M.T) / 2,
            viscosity=B,
            stiffness=K,
            damping=D,
            delay=int(linear.delay[0]),
            lateness=float(linear.latency[0]),
            object_delay=linear.object_delay,
            integrator=linear.integrator,
        )
        return [Mode("coupled", r, K, D, M, B, radius_of(block), U, None)]
    modes = []
    for i in range(U.shape[1]):
        k, d, M_i, b_i = (float(turn[:, i] @ A @ turn[:, i]) for A in parts)
        P, N = characteristic.external(
            device.mass,
            device.friction,
            linear.period,
            M_i,
            b_i,
            spring=device.spring,
            damping=d,
            integrator=linear.integrator,
            delay=int(linear.delay[0]),
            object_delay=linear.object_delay,
            latency=float(linear.latency[0]),
        )
        limits = limits_of(P, N, device.mass / linear.period**2, linear.period)
        motion = (U @ turn[:, i])[:, None]
        modes.append(Mode("external", 1, k, d, M_i, b_i, limits.spectral_radius(k), motion, limits))
    return modes


def together(matrices: Sequence[FloatArray]) -> FloatArray | None:
    """Find orthonormal columns that diagonalise all of the matrices; None where there are none."""
    sizes = [max(float(np.abs(A).max(initial=0.0)), 1e-300) for A in matrices]
    if any(np.abs(A - A.T).max(initial=0.0) > SAME * size for A, size in zip(matrices, sizes, strict=True)):
        return None
    # one combination with unequal weights has the common eigenvectors, unless two sums of eigenvalues coincide
    weights = [1.0, np.sqrt(0.5), np.sqrt(0.3), np.sqrt(0.19)]
    total = sum(w / size * A for w, size, A in zip(weights, sizes, matrices, strict=False))
    turn: FloatArray = np.linalg.eigh(np.asarray(total))[1]
    for A, size in zip(matrices, sizes, strict=True):
        B = turn.T @ A @ turn
        if np.abs(B - np.diag(np.diag(B))).max() > 10 * SAME * size:
            return None
    return turn
