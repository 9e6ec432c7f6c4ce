"""Internal forces: named coordinates that span the null space of G, and the split of forces by a virtual linkage.

Coordinates are tensions, bendings, torsions and, if these do not suffice, single components. A virtual linkage
describes internal forces as tensions of actuators between contacts and torques of joints at contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.grasp.contact import Contacts
from graspfx.grasp.matrix import GraspMatrix
from graspfx.numeric import finite, fraction, real

FloatArray = NDArray[np.float64]
Candidates = list[tuple[str, FloatArray]]

FLAT = 1e-6  # relative to the contacts' spread: contacts closer than this to a line or plane lie on it
DEPENDENT = 1e-6  # smallest part of a unit force that counts as independent of those already chosen
TIED = 1e-9  # relative difference up to which candidates count as equal; the first of these is taken
AXES = "xyz"


class Dividing(Protocol):
    """Protocol of a split of contact forces, implemented by `Split` and `VirtualLinkage`."""

    def divide(self, force: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Divide contact forces (..., m) into external and internal parts."""


@dataclass(frozen=True, eq=False)
class InternalCoordinates:
    """Coordinates y of internal forces: (I - P) f = B y with G B = 0, where y has m - rank named components.

    | coordinate | 1 unit of it | unit |
    |---|---|---|
    | tension i-j | a string between i and j: f_i = u, f_j = -u, u from i to j; positive squeezes | N |
    | bending k: a-b-c along u | f_k = u, supported at a, b and c like a plate or beam through the four contacts | N |
    | torsion i | a torsion of contact i, balanced by the smallest forces of all contacts | N m |
    | torsion i against j | the same if forces cannot balance it, but a torsion of contact j can | N m |
    | force k x | a component that locked degrees of freedom of the object or other contacts balance | N |

    Tensions come first. The set is chosen so that the tension of every other pair is a combination of the chosen
    tensions with coefficients of at most 1. Tensions span the internal forces of point contacts, unless the contacts
    are collinear or, in space, four or more contacts are coplanar. In these cases, (d - a)(n - a - 1) bendings complete
    the tensions, where a is the dimension of the contacts' span. Sources: Murray, Li and Sastry 1994, ch. 5; Williams
    and Khatib 1993.

    Attributes:
        names: Name of each coordinate.
        units: Unit of each coordinate, "N" or "N m".
        basis: Matrix B, (m, m - rank).
        condition: Condition number of B, with moments in units of the contacts' rms radius and columns of unit length.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    basis: FloatArray
    condition: float
    _split: Dividing
    _reader: FloatArray

    def of(self, force: ArrayLike) -> FloatArray:
        """Compute the coordinates y, (..., m - rank), of the internal part of contact forces (..., m)."""
        return self._split.divide(force)[1] @ self._reader.T

    def force(self, coordinates: ArrayLike) -> FloatArray:
        """Compute the internal contact forces B y, (..., m)."""
        y = finite("coordinates", coordinates)
        if y.shape[-1:] != (len(self.names),):
            raise InputError("coordinates", y, f"an array whose last axis has the {len(self.names)} coordinates")
        return y @ self.basis.T

    def named(self, force: ArrayLike) -> dict[str, float]:
        """Return the coordinates of one force (m,) by name."""
        return dict(zip(self.names, self.of(finite("force", force).reshape(-1)).tolist(), strict=True))


def internal_coordinates(
    grasp: GraspMatrix,
    split: Dividing,
    rank: int,
    names: Sequence[str] | None = None,
    pairs: Sequence[tuple[int, int]] | None = None,
) -> InternalCoordinates:
    """Choose and name a basis of the internal forces.

    Args:
        grasp: Contacts.
        split: Split of the contact forces.
        rank: Rank of G.
        names: Names of the fingers; "1", "2", ... if None.
        pairs: Pairs of fingers, counted from 0, whose tensions are used. If None, a well-conditioned set of pairs is
            chosen.

    Raises:
        InputError: If the names or pairs are invalid, or the tensions of the pairs are dependent or incomplete.
    """
    fingers = _fingers(names, grasp.fingers)
    A, size = grasp.unit_free()
    units = np.where(grasp.torsion_columns, size, 1.0)  # component = units * unit-free component
    target = len(grasp.finger_of_column) - rank
    tensions = _tensions(grasp.contacts, fingers, pairs)
    rows: Candidates = []
    for candidates in (
        tensions,
        _bendings(grasp.contacts, fingers),
        _torsions(grasp, A, units, fingers),
        _circuits(grasp, A, units, rank, fingers),
    ):
        rows = _extended(rows, candidates, target, units)
        if candidates is tensions and pairs is not None:
            _check_pairs(len(rows), len(pairs), grasp, fingers, target, units)
    B = np.array([x for _, x in rows]).reshape(len(rows), len(units)).T
    S = B / units[:, None]
    lengths = np.sqrt((S**2).sum(axis=0))
    values = np.linalg.svd(S / lengths, compute_uv=False)
    reader = np.linalg.pinv(S / lengths) / lengths[:, None] / units
    kinds = tuple("N m" if name.startswith(("torsion", "moment")) else "N" for name, _ in rows)
    condition = float(values[0] / values[-1]) if len(values) else 1.0
    return InternalCoordinates(tuple(name for name, _ in rows), kinds, B, condition, split, reader)


def components(contacts: Contacts, finger: int, force: FloatArray) -> FloatArray | None:
    """Express a force (d,) of a contact in components (m,); return None if the contact cannot transmit the force."""
    own = (contacts.finger == finger) & ~contacts.moment
    axes = contacts.force_axes[own]
    x = axes @ force
    if np.abs(x @ axes - force).max() > 1e-12 * np.abs(force).max():
        return None
    full = np.zeros(len(contacts.finger))
    full[own] = x
    return full


def _tensions(contacts: Contacts, fingers: list[str], pairs: Sequence[tuple[int, int]] | None) -> Candidates:
    n = len(contacts.points)
    candidates: Candidates = []
    if pairs is not None:
        expected = f"pairs (i, j) of two different finger indices from 0 to {n - 1}"
        ends = real("pairs", pairs, expected)
        whole = ends.ndim == 2 and ends.shape[1] == 2 and np.isin(ends, range(n)).all()
        if ends.size and not (whole and (ends[:, 0] != ends[:, 1]).all()):
            raise InputError("pairs", pairs, expected)
        pairs = [(int(i), int(j)) for i, j in ends] if ends.size else []
    for i, j in combinations(range(n), 2) if pairs is None else pairs:
        line = contacts.points[j] - contacts.points[i]
        length = float(np.linalg.norm(line))
        if length == 0.0:
            continue
        here, there = components(contacts, i, line / length), components(contacts, j, -line / length)
        if here is not None and there is not None:
            candidates.append((f"tension {fingers[i]}-{fingers[j]}", here + there))
    return candidates


def _bendings(contacts: Contacts, fingers: list[str]) -> Candidates:
    """List forces l_i u of contacts i, with sum_i l_i = 0, sum_i l_i c_i = 0, and u normal to the contacts' span."""
    n, d = contacts.points.shape
    arms = contacts.points - contacts.points[0]
    arms = arms - arms.mean(axis=0)
    values, rows = np.linalg.svd(arms, full_matrices=True)[1:]
    a = int((values > FLAT * values[0]).sum()) if values[0] > 0.0 else 0
    if n < a + 2 or a == d:
        return []
    normal = rows[a:].T @ rows[a:]  # projector; its normals are as close to the world's axes as possible
    normals = [_tidy(u) for u in np.linalg.qr(normal[:, _pivots(normal, d - a)])[0].T]
    flat = np.hstack([np.ones((n, 1)), arms @ rows[:a].T / max(values[0], 1e-300)])  # (n, a + 1)
    supports = _pivots(flat.T, a + 1)
    candidates: Candidates = []
    for k in range(n):
        if k in supports:
            continue
        share = np.linalg.solve(flat[supports].T, flat[k])
        for u in normals:
            parts = [components(contacts, k, u)]
            parts += [components(contacts, s, -part * u) for s, part in zip(supports, share, strict=True) if part]
            whole = [part for part in parts if part is not None]
            if len(whole) == len(parts):
                names = "-".join(fingers[s] for s in supports)
                candidates.append((f"bending {fingers[k]}: {names} along {_direction(u)}", np.sum(whole, axis=0)))
    return candidates


def _torsions(grasp: GraspMatrix, A: FloatArray, units: FloatArray, fingers: list[str]) -> Candidates:
    """List moments of the contacts, each balanced by the smallest forces or, if no forces can, by another moment."""
    columns = np.flatnonzero(grasp.torsion_columns)
    if not columns.size:
        return []
    forces = ~grasp.torsion_columns
    U, values, V = np.linalg.svd(A[:, forces])
    r = int((values > FLAT * np.sqrt(grasp.fingers)).sum())
    unheld = U[:, r:].T @ A[:, columns]  # the part that no force can balance
    reach = np.linalg.svd(unheld, compute_uv=False) if unheld.size else np.zeros(0)
    anchors = _pivots(unheld, int((reach > FLAT).sum()))
    candidates: Candidates = []
    for j in range(len(columns)):
        if j in anchors:
            continue
        tau = np.zeros(len(columns))
        tau[j] = 1.0
        if anchors:
            tau[anchors] = -np.linalg.lstsq(unheld[:, anchors], unheld[:, j], rcond=None)[0]
        tau[np.abs(tau) < 1e-14] = 0.0
        x = np.zeros(len(units))
        x[columns] = tau
        x[forces] = -V[:r].T @ ((U[:, :r].T @ (A[:, columns] @ tau)) / values[:r])
        against = [_component(grasp.contacts, columns[a], fingers)[1] for a in anchors if tau[a]]
        name = " ".join(_component(grasp.contacts, columns[j], fingers))
        name += f" against {' and '.join(against)}" if against else ""
        candidates.append((name, units * x / units[columns[j]]))
    return candidates


def _circuits(grasp: GraspMatrix, A: FloatArray, units: FloatArray, rank: int, fingers: list[str]) -> Candidates:
    """List single components, each balanced by `rank` other components; together they span the null space of G."""
    pivots = _pivots(A, rank)
    candidates: Candidates = []
    for j in range(len(units)):
        if j in pivots:
            continue
        x = np.zeros(len(units))
        x[j] = 1.0
        if pivots:
            x[pivots] = -np.linalg.lstsq(A[:, pivots], A[:, j], rcond=None)[0]
            x[pivots] -= np.linalg.lstsq(A[:, pivots], A @ x, rcond=None)[0]
        candidates.append((" ".join(_component(grasp.contacts, j, fingers)), units * x / units[j]))
    return candidates


def _extended(rows: Candidates, candidates: Candidates, target: int, units: FloatArray) -> Candidates:
    """Append independent candidates to `rows` until there are `target` rows.

    The selected candidates are exchanged until every other candidate is a combination of them with coefficients of at
    most 1.
    """
    want = target - len(rows)
    if want <= 0 or not candidates:
        return rows
    X = np.array([x for _, x in candidates]).T / units[:, None]
    X = X / np.sqrt((X**2).sum(axis=0))
    if rows:
        C = np.linalg.qr(np.array([x for _, x in rows]).T / units[:, None])[0]
        X = X - C @ (C.T @ X)
        X = X - C @ (C.T @ X)
    picks = _pivots(X, want, DEPENDENT)
    if picks:
        picks = _exchanged(X, picks)
    return rows + [candidates[k] for k in sorted(picks)]


def _exchanged(X: FloatArray, picks: list[int]) -> list[int]:
    """Exchange picked columns until every other column is a combination of them with coefficients of at most 1."""
    coefficients = np.linalg.lstsq(X[:, picks], X, rcond=None)[0]
    for _ in range(10 * X.shape[1]):
        row, column = np.unravel_index(int(np.abs(coefficients).argmax()), coefficients.shape)
        if abs(coefficients[row, column]) <= 1.0 + TIED:
            break
        picks[int(row)] = int(column)
        coefficients = np.linalg.lstsq(X[:, picks], X, rcond=None)[0]
    return picks


def _pivots(X: FloatArray, count: int, least: float = 0.0) -> list[int]:
    """Select up to `count` columns of X, each with the largest part orthogonal to the previous columns."""
    R = X.copy()
    picks: list[int] = []
    for _ in range(min(count, *X.shape)):
        lengths = np.sqrt((R**2).sum(axis=0))
        lengths[picks] = 0.0
        longest = float(lengths.max())
        if longest <= least:
            break
        k = int(np.flatnonzero(lengths >= longest * (1.0 - TIED))[0])
        picks.append(k)
        q = R[:, k] / lengths[k]
        R = R - np.outer(q, q @ R)
        R = R - np.outer(q, q @ R)
    return picks


def _check_pairs(
    independent: int, count: int, grasp: GraspMatrix, fingers: list[str], target: int, units: FloatArray
) -> None:
    if independent < count:
        raise InputError(
            "pairs", count, "tensions that are linearly independent", f"only {independent} are independent"
        )
    most = len(_extended([], _tensions(grasp.contacts, fingers, None), target, units))
    if independent < most:
        raise InputError("pairs", count, f"{most} pairs, as many as there are independent tensions")


def _component(contacts: Contacts, column: int, fingers: list[str]) -> tuple[str, ...]:
    """Describe a component by its kind, its contact and its axis."""
    finger, moment = contacts.finger[column], bool(contacts.moment[column])
    same = np.flatnonzero((contacts.finger == finger) & (contacts.moment == moment))
    name = fingers[finger]
    if len(same) == 1:
        return ("torsion" if moment else "force", name)
    axis = (contacts.moment_axes if moment else contacts.force_axes)[column]
    return ("moment" if moment else "force", name, _direction(axis))


def _direction(u: FloatArray) -> str:
    hit = np.flatnonzero(np.abs(u - 1.0) < FLAT)
    if hit.size and np.abs(np.delete(u, hit[0])).max(initial=0.0) < FLAT:
        return AXES[hit[0]]
    return "(" + " ".join(f"{x:.3g}" for x in u + 0.0) + ")"


def _tidy(u: FloatArray) -> FloatArray:
    """Return u or -u, whichever has a positive component of largest magnitude."""
    return u if u[int(np.abs(u).argmax())] > 0.0 else -u


def _fingers(names: Sequence[str] | None, n: int) -> list[str]:
    if names is not None and not isinstance(names, Sequence):
        raise InputError("names", names, f"{n} different names, one per finger")
    fingers = [str(k + 1) for k in range(n)] if names is None else [str(name) for name in names]
    if len(fingers) != n or len(set(fingers)) != n:
        raise InputError("names", fingers, f"{n} different names, one per finger")
    return fingers


class VirtualLinkage:
    """Split f = P f + (I - P) f of a linkage with a spherical joint at each contact and actuators between contacts.

    Only contact forces exert the wrench w: f_F = W_F^+ w. The contacts' moments are joint torques and therefore
    internal (Williams and Khatib 1993). With G = [W_F W_T], where W_F contains the columns of forces and W_T the
    columns of moments,

        P = [W_F^+ (I - W_T H); H] G,    H = (N' W_T)^+ N',    N' W_F = 0.

    H is zero unless forces cannot exert some wrench (two contacts cannot rotate the object about the line through
    them). In this case the moments exert only this wrench. The internal forces are E t and tau - W_F^+ W_T tau. Here
    t = E^+ f_F contains the tensions of the actuators, E has a column [.. u_ij .. -u_ij ..] for each actuator, and tau
    contains the torques of the joints.

    Without moments, P = G^+ G. For frictionless and hard contacts this is the split of `grasp.split.Split` without a
    metric, for any choice of actuators, because E spans the null space of G, and W_F^+ is orthogonal to this null
    space. With moments the linkage's split is the limit of that split as the torsion length goes to zero; the
    difference is proportional to (torsion length / contacts' radius)^2. The linkage needs no torsion length and does
    not depend on the unit of length. With moments, P is not symmetric; use the linkage for analysis, not for a
    coupling.

    Actuators alone form a linkage unless the contacts lie on a line, or four or more lie in a plane in space. In these
    cases `coordinates` adds bendings.

    Args:
        grasp: Contacts.
        actuators: Pairs of fingers, counted from 0. If None, a well-conditioned set of pairs is chosen.
        tolerance: Relative tolerance of the rank, as for `Split`.

    Attributes:
        rank: Rank of G.

    Raises:
        InputError: If the tolerance is outside [0, 1).
    """

    def __init__(
        self, grasp: GraspMatrix, *, actuators: Sequence[tuple[int, int]] | None = None, tolerance: float = 1e-6
    ) -> None:
        tolerance = fraction("tolerance", tolerance)
        self.grasp, self.actuators = grasp, actuators
        self.components = len(grasp.finger_of_column)
        A, size = grasp.unit_free()
        forces = ~grasp.torsion_columns
        least = max(tolerance * np.sqrt(grasp.fingers), max(A.shape) * np.finfo(float).eps)
        U, values, V = np.linalg.svd(A[:, forces])
        r = int((values > least).sum())
        E = np.zeros((self.components, len(A)))  # contact forces that make a wrench
        E[forces] = (V[:r].T / values[:r]) @ U[:, :r].T
        unheld = U[:, r:].T @ A[:, ~forces]
        H = np.zeros((unheld.shape[1], len(A)))
        rest = 0
        if unheld.size:
            left, singular, right = np.linalg.svd(unheld, full_matrices=False)
            rest = int((singular > least).sum())
            H = (right[:rest].T / singular[:rest]) @ left[:, :rest].T @ U[:, r:].T
            E[forces] -= E[forces] @ A[:, ~forces] @ H
            E[~forces] = H
        self.rank = r + rest
        units = np.where(grasp.torsion_columns, size, 1.0)
        self._distribute, self._gather = units[:, None] * E, A / units

    @cached_property
    def external(self) -> FloatArray:
        """Projector P on forces, (m, m)."""
        return self._distribute @ self._gather

    @cached_property
    def internal(self) -> FloatArray:
        """Projector I - P on forces, (m, m)."""
        return np.eye(self.components) - self.external

    def divide(self, force: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Divide contact forces (m,) or (..., m) into external and internal parts, whose sum is the force."""
        f = finite("force", force)
        if f.shape[-1:] != (self.components,):
            raise InputError("force", f, f"an array whose last axis has the {self.components} contact components")
        external = f @ self._gather.T @ self._distribute.T
        return external, f - external

    @cached_property
    def coordinates(self) -> InternalCoordinates:
        """Tensions of the actuators [N], positive if they pull the fingers together, and torques of the joints [N m].

        Raises:
            InputError: If the actuators are invalid, or their tensions are dependent or incomplete.
        """
        return self.internal_coordinates()

    def internal_coordinates(self, names: Sequence[str] | None = None) -> InternalCoordinates:
        """Return the named coordinates of the internal forces; `names` are those of the fingers."""
        return internal_coordinates(self.grasp, self, self.rank, names, self.actuators)
