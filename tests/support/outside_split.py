"""The external part of forces and displacements by numpy's singular values: no code of the framework's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.recording.record import Recording

FloatArray = NDArray[np.float64]


def step(x: FloatArray, low: float, high: float) -> FloatArray:
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def motions(rule: Mapping[str, Any], contact: FloatArray, normal: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """G' of the free translations and rotations, (N, n, c, k): what each does to the contacts; c is d, or 4."""
    N, n, d = contact.shape
    c = 3 if normal is None else 4
    points = np.zeros((N, n, 3))
    points[..., :d] = contact
    shifts = np.zeros((N, n, c, 3))
    shifts[:, :, :3] = np.eye(3)
    turns = np.zeros((N, n, c, 3))
    for k, axis in enumerate(np.eye(3)):
        turns[:, :, :3, k] = np.cross(axis, points)
        if normal is not None:
            turns[:, :, 3, k] = np.array(rule["patches"]) * (normal @ axis)
    return shifts[..., np.array(rule["translations"])], turns[..., np.array(rule["rotations"])]


def modes(
    rule: Mapping[str, Any], contact: FloatArray, weight: FloatArray, normal: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Orthonormal columns of M^(1/2) G' (N, n c, k), translations first, and their blends (N, k)."""
    N = len(contact)
    shifts, turns = motions(rule, contact, normal)
    root = np.sqrt(weight)[:, :, None, None]
    A, B = (np.reshape(root * each, (N, each.shape[1] * each.shape[2], each.shape[3])) for each in (shifts, turns))
    total = weight.sum(axis=1)[:, None]
    A = A / np.sqrt(np.where(total > 0.0, total, 1.0))[..., None]
    B = B - A @ (A.swapaxes(1, 2) @ B)
    U, values, _ = np.linalg.svd(B, full_matrices=False)
    arms = values / np.sqrt(np.where(total > 0.0, total, 1.0))
    low, high = rule["blend"] or (1e-9, 1e-9)
    beta = step(arms, low, high) if high > low else (arms > low).astype(float)
    whole = np.ones((N, A.shape[2])) * (total > 0.0)
    return np.concatenate([A, U], axis=2), np.concatenate([whole, beta], axis=1)


def weights(rule: Mapping[str, Any], gap: FloatArray | None, N: int) -> FloatArray:
    share = np.array(rule["shares"])
    if rule["fade"] is None or gap is None:
        return np.tile(share, (N, 1))
    return np.asarray(share * (1.0 - step(gap, *rule["fade"])))


def external(rec: Recording, name: str) -> tuple[list[int], FloatArray, FloatArray, FloatArray]:
    """P f of an object's fingers from the rows: their numbers, forces (N, n, d), moments (N, n, 3), least blend (N,).

    P f = M^(1/2) Q beta Q' M^(-1/2) f; a finger of weight zero has no force.
    """
    rule, k = rec.header.split[name], rec.layout.objects.index(name)
    fingers = [i for i, number in enumerate(rec.layout.finger_objects) if number == k]
    d, N, soft = rec.layout.dimensions, len(rec), any(rule["patches"])
    weight = weights(rule, None if rec.gap is None else rec.gap[:, fingers], N)
    normal = rec.array("contact_normal")[:, fingers] if soft else None
    place = f"objects/{name}/centre" if k in rec.layout.predicted else f"objects/{name}/position"
    contact = rec.contact_position[:, fingers] - rec.array(place)[:, None]
    Q, beta = modes(rule, contact, weight, normal)
    f = np.zeros((N, len(fingers), 3 if normal is None else 4))
    f[..., :d] = rec.finger_force[:, fingers]
    rho = np.array(rule["patches"])
    if normal is not None:
        moment = rec.array("finger_moment")[:, fingers]
        f[..., 3] = (moment * normal).sum(axis=-1) / np.where(rho > 0.0, rho, 1.0)
    root = np.sqrt(weight)[..., None]
    scaled = np.where(root > 0.0, f / np.where(root > 0.0, root, 1.0), 0.0).reshape(N, -1, 1)
    part = root * (Q @ (beta[..., None] * (Q.swapaxes(1, 2) @ scaled))).reshape(f.shape)
    moments = np.zeros((N, len(fingers), 3))
    if normal is not None:
        axis = rec.array("torsion_axis")[:, fingers] if rec.layout.torsion_axes else normal
        moments = (rho * part[..., 3])[..., None] * axis
    return fingers, part[..., :d], moments, beta.min(axis=1, initial=1.0)
