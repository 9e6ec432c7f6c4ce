"""Stiffness from preload: the part that the forces of a grasp at rest add."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.arguments import numbers, one_of
from graspfx.errors import InputError
from graspfx.numeric import finite

FloatArray = NDArray[np.float64]

ROWS = {1: [0], 2: [0, 1, 5], 3: [0, 1, 2, 3, 4, 5]}  # of force and moment in space


@dataclass(frozen=True, eq=False)
class Preload:
    """`G`, `G_displacement` and `preload` of a `Linearisation`."""

    G: FloatArray
    G_displacement: FloatArray
    preload: FloatArray


def preloaded(
    contacts: ArrayLike,
    displacement: ArrayLike,
    force: ArrayLike,
    *,
    centre: ArrayLike | None = None,
    free: ArrayLike | None = None,
    reaction: str = "fingertip",
) -> Preload:
    """Linearise the geometry of hard fingers that press with forces f_0 when the object begins to move by (u, theta).

    With K constant in the object's frame, y = p - x_o the fingertip from the object's centre and e = R'(p - x_o) - c,

        de = dp - u - theta x y,    df = theta x f_0 + K de,    d moment = sum dy x f_0 + y x df        (fingertip)
                                                                d moment = theta x sum c x f_0 + c x K de  (contact)

    so that squeezing lowers the stiffness of rotations. Two fingers in the plane, half-width r, squeeze d, reaction at
    the fingertip: k_rot = 2 k_ep r^2 [(1 - d/r)^2 + (k_ip/k_ep)(d/r)(1 - d/r)].

    Args:
        contacts: c (n, d), world axes [m].
        displacement: e_0 = p - c (n, d) at rest [m].
        force: f_0 (n, d) of the fingers on the object at rest [N].
        centre: of mass (d,) [m]; zero if None.
        free: which of the object's w freedoms move, a mask.
        reaction: "fingertip" or "contact", where the force acts on the object.
    """
    c = numbers("contacts", contacts, "m", negative=True)
    if c.ndim != 2 or c.shape[1] not in ROWS:
        raise InputError("contacts", c, "points (n, d), d = 1, 2 or 3 [m]")
    n, d = c.shape
    e, f = (numbers(name, vector, unit, negative=True) for name, vector, unit in (
        ("displacement", displacement, "m"), ("force", force, "N")))  # fmt: skip
    for name, vector in (("displacement", e), ("force", f)):
        if vector.shape != c.shape:
            raise InputError(name, vector, f"an array {c.shape}, as the contacts")
    o = np.zeros(d) if centre is None else numbers("centre", centre, "m", negative=True)
    if o.shape != (d,):
        raise InputError("centre", o, f"a point of {d} coordinates")
    rows = np.array(ROWS[d])
    moves = np.ones(len(rows), dtype=bool) if free is None else finite("free", free) != 0.0
    if moves.shape != rows.shape:
        raise InputError("free", free, f"{len(rows)} of true or false, forces first, then moments")
    at_tip = one_of("reaction", reaction, ("fingertip", "contact")) == "fingertip"

    wide = np.zeros((3, n, 3))
    wide[:, :, :d] = c - o, c + e - o, f
    arm, tip, force_0 = wide
    N = np.zeros((n * 3 + 6, n * 3 + 6))
    turn = slice(3 * n + 3, 3 * n + 6)
    shift = slice(3 * n, 3 * n + 3)
    for i in range(n):
        x = slice(3 * i, 3 * i + 3)
        F = cross(force_0[i])
        N[x, turn] -= F
        N[shift, turn] += F
        if at_tip:
            N[turn, x] += F
            N[turn, shift] -= F
            N[turn, turn] += cross(tip[i]) @ F
        else:
            N[turn, turn] += cross(np.cross(arm[i], force_0[i]))
    columns = (3 * np.arange(n)[:, None] + np.arange(d)).ravel()
    selection = np.concatenate([columns, 3 * n + rows[moves]])
    wrench, geometry = (
        np.vstack([np.tile(np.eye(3), n), np.hstack([cross(y) for y in arms])])[np.ix_(rows[moves], columns)]
        for arms in (tip if at_tip else arm, tip)
    )
    return Preload(wrench, geometry, N[np.ix_(selection, selection)])


def cross(a: FloatArray) -> FloatArray:
    """Write [a] with [a] b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
