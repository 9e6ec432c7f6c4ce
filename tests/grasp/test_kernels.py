"""The kernels of the grasp: rigid modes against pseudoinverses and 50 digits, the blend's bound, pivots."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from graspfx.compile.records import Floats, Many, Record, Table, many, numbers, size_for, table
from graspfx.cones.complement import pivot
from graspfx.cones.cone import contact_frame
from graspfx.grasp.rigid_modes import Contact, Freedom, rigid_modes, smoothstep
from graspfx.spatial import Vector


class ContactSet(Record):
    """Contacts, the directions in which their object is free, and the rigid modes of both."""

    count: int
    width: int  # entries of a contact in a mode
    freedom: Freedom
    contacts: Many[Contact] = many("count")
    modes: Table = table("6", "1 + width * count")


def contact_set(
    points: np.ndarray, weights: np.ndarray | None = None, axes: np.ndarray | None = None, shifts: int | None = None,
    width: int = 3,
) -> ContactSet:  # fmt: skip
    """Build the block of contacts at points (n, d); all directions are free unless axes are named."""
    n, d = points.shape
    turns = {1: 0, 2: 1, 3: 3}[d]
    if axes is None:
        axes, shifts = np.vstack([np.eye(3)[:d], np.eye(3)[3 - turns :]]), d
    assert shifts is not None
    contacts = ContactSet(np.zeros(size_for(ContactSet, count=n, width=width)))
    contacts.count, contacts.width = n, width
    contacts.freedom.shifts, contacts.freedom.turns = shifts, len(axes) - shifts
    for k, axis in enumerate(axes):
        contacts.buffer[contacts.freedom.axes[k].offset :][:3] = axis
    contacts.contacts.array(Contact.contact)[:, :d] = points
    contacts.contacts.array(Contact.weight)[:] = 1.0 if weights is None else weights
    return contacts


def modes_of(
    contacts: ContactSet, d: int, low: float, high: float, kernel: Callable[..., Any] = rigid_modes
) -> tuple[int, int]:
    """Compute the modes; give how many, and how many rotations are not in them whole."""
    count, blended = kernel(contacts.contacts, contacts.freedom, d, low, high, contacts.width, False, contacts.modes)
    return int(count), int(blended)


def external(
    points: np.ndarray, weights: np.ndarray | None = None, axes: np.ndarray | None = None, shifts: int | None = None,
    low: float = 1e-300, high: float = 2e-300,
) -> np.ndarray:  # fmt: skip
    """P from the modes, (n d, n d); the blend is off unless lengths are given."""
    n, d = points.shape
    contacts = contact_set(points, weights, axes, shifts)
    count, _ = modes_of(contacts, d, low, high)
    P = np.zeros((n * d, n * d))
    for k in range(count):
        mode = contacts.modes.array(count)[k]
        q = mode[1:].reshape(n, 3)[:, :d].ravel()
        P += mode[0] * np.outer(q, q)
    return P


@pytest.mark.parametrize("seed", range(6))
def test_weights_and_partial_freedoms_against_the_pseudoinverse(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, w = rng.normal(size=(4, 3)), rng.uniform(0.01, 1, 4)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    for shifts in range(4):
        for turns in range(4):
            if shifts + turns == 0:
                continue
            axes = np.vstack([frame[:shifts], frame[3 - turns :]])
            rows = [np.tile(a, 4) for a in axes[:shifts]]
            rows += [np.cross(a, points).ravel() for a in axes[shifts:]]
            root = np.sqrt(np.repeat(w, 3))
            G = np.array(rows) * root
            expected = np.linalg.pinv(G) @ G
            np.testing.assert_allclose(external(points, w, axes, shifts), expected, atol=2e-14)


def test_blend_bounds_the_step_across_collinearity() -> None:
    """The middle finger crosses the others' line: |df| <= |kip - kep| |e| [1.5 d_arm/(l2 - l1) + 2 d/R]."""
    low, high, R, step = 0.00025, 0.001, 0.03, 2e-6
    e = np.array([0, 0, -0.5, 0, 0, 1.0, 0, 0, -0.5]) * 1e-3  # along the rotation that comes and goes
    worst_ratio, last = 0.0, None
    for y in np.arange(-0.003, 0.003, step):
        P = external(np.array([[-R, 0.0, 0.0], [0.0, y, 0.0], [R, 0.0, 0.0]]), low=low, high=high)
        eigenvalues = np.linalg.eigvalsh(P)
        assert eigenvalues[0] > -1e-14 and eigenvalues[-1] < 1 + 1e-14
        f = 90.0 * P @ e
        if last is not None:
            arm = step * np.sqrt(2.0) / 3.0  # rms of (0, y, 0) about its mean
            bound = 90.0 * np.linalg.norm(e) * (1.5 * arm / (high - low) + 2 * step / R)
            worst_ratio = max(worst_ratio, np.linalg.norm(f - last) / bound)
        last = f
    assert 0.5 < worst_ratio <= 1.0


def test_contact_frame_is_orthonormal_for_every_normal() -> None:
    rng = np.random.default_rng(4)
    normals = np.vstack([np.eye(3), -np.eye(3), [[1e-9, 0, -1.0]], rng.normal(size=(50, 3))])
    for normal in normals / np.linalg.norm(normals, axis=1, keepdims=True):
        F = np.reshape(list(numbers(contact_frame(Vector(*normal.tolist()), 3))), (3, 3))
        np.testing.assert_allclose(F @ F.T, np.eye(3), atol=4e-16)
        np.testing.assert_array_equal(F[0], normal)
    flat = list(numbers(contact_frame(Vector(0.6, 0.8, 0.0), 2)))
    assert flat == [0.6, 0.8, 0.0, -0.8, 0.6, 0.0, 0.0, 0.0, 1.0]


def test_pivoting_twice_is_the_identity_and_once_exchanges() -> None:
    rng = np.random.default_rng(5)
    M, q = rng.normal(size=(4, 4)) + 4 * np.eye(4), rng.normal(size=4)
    S = np.concatenate([M.ravel(), q])
    square, vector = Table(memoryview(S), 0, 4), Floats(memoryview(S), 16)
    pivot(square, vector, 2)
    x = rng.normal(size=4)
    y = q + M @ x
    exchanged_x, exchanged_y = x.copy(), y.copy()
    exchanged_x[2], exchanged_y[2] = y[2], x[2]
    np.testing.assert_allclose(S[16:] + S[:16].reshape(4, 4) @ exchanged_x, exchanged_y, rtol=1e-12)
    pivot(square, vector, 2)
    np.testing.assert_allclose(S, np.concatenate([M.ravel(), q]), rtol=1e-12)


def test_smoothstep_values() -> None:
    assert [smoothstep(x, 1.0, 3.0) for x in (0.0, 1.0, 2.0, 3.0, 4.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
