"""Forces of n fingers that can only push, for a given stiffness, with or without friction.

The solution generalises eqs. (24)-(26) of Kawai and Yoshikawa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.card import Card, Carded, counted
from graspfx.compile.records import Floats, Table, numbers
from graspfx.cones.complement import Contacts, complement, release, settle
from graspfx.cones.cone import contact_frame
from graspfx.cones.friction import ASSOCIATED, LEAST, RESTARTS, UNRESOLVED, friction_force_square
from graspfx.cones.problem import SLIDE, STICK, ConeContact, problem_size, set_up
from graspfx.errors import InputError
from graspfx.grasp.contact import unit_normals
from graspfx.numeric import SMALLEST, each, finite
from graspfx.spatial import Vector

FloatArray = NDArray[np.float64]
MOST = 8  # largest number of fingers shown on a card

Status = Literal["free", "stick", "slide"]
Law = Literal["frictionless", "stick", "coulomb", "associated"]
LAWS: dict[Law, str] = {
    "frictionless": "frictionless: normal forces only",
    "stick": "stick: a finger that pushes does not slip in any direction",
    "coulomb": "Coulomb's",
    "associated": "associated: no solution of Coulomb's law was found, and sliding fingers lift off (s_n = mu |s_t|)",
}
SOLVED = 1e-6  # largest residual of a solution, relative to the forces


@dataclass(frozen=True, repr=False)
class Touch(Carded):
    """Forces of n fingers on the object in d dimensions, and the state of each contact.

    Attributes:
        force: Forces f of the fingers on the object, (n d,) [N].
        status: State of each finger: "free" (no force), "stick" (no slip in any direction) or "slide" (force on the
            edge of the friction cone; without friction, along the normal).
        residual: Largest violation of f = K (e + s) and of the contact law, computed from the solution [N]; see
            `unilateral_force` for the symbols.
        law: Contact law that the solution satisfies; "associated" if no solution of Coulomb's law was found.
    """

    force: FloatArray
    status: tuple[Status, ...]
    residual: float
    law: Law

    def _card(self) -> Card:
        by_finger = self.force.reshape(len(self.status), -1)
        pairs = zip(by_finger, self.status, strict=True)
        forces = (f"{np.array2string(f, precision=6)} N, {status}" for f, status in pairs)
        lines = list(islice(forces, MOST))
        rest = [f"and {len(self.status) - MOST} more"] if len(self.status) > MOST else []
        return Card(
            f"Pushing forces of {counted(len(self.status), 'finger')} on the object",
            [("fingers", "\n".join([*lines, *rest])), ("law", LAWS[self.law]), ("residual", f"{self.residual:.3g} N")],
            ".force (m,) [N], .status, .law, .residual",
        )


def unilateral_force(
    stiffness: ArrayLike,
    displacement: ArrayLike,
    normals: ArrayLike,
    friction: float | Sequence[float] | Literal["stick"] | None = None,
) -> Touch:
    """Compute the forces f of n fingers that can only push, from f = K (e + s), where s is the slip of the contacts.

    The forces f lie in a cone C, and a contact law relates f and s. The indices n and t denote components along the
    normal and tangential to the surface.

    Without friction, each force is directed along the inward normal, s is in the dual cone C*, and f's = 0. With
    "stick", a finger does not slip while it pushes; if its normal force would pull, its whole force is zero. With a
    coefficient of friction mu, C is the cone |f_t| <= mu f_n, and Coulomb's law applies: s_n >= 0, f_n s_n = 0, and s_t
    is zero inside the cone and opposes f_t on the edge of the cone. A solution of Coulomb's law exists, but for a large
    mu it may not be unique. If no solution is found, the associated law replaces Coulomb's law (s in C*, f's = 0, so
    slipping fingers also lift off), and `Touch.law` reports this. For a symmetric K the solution of the associated law
    exists, is unique and is always found.

    For two opposed fingers without friction, the forces are those of Kawai and Yoshikawa, eqs. (24)-(26): finger i is
    in contact inside the limit x_ci of eq. (25), and if only one finger is in contact, its stiffness is
    2 kep kip/(kep + kip). For a symmetric, regular K and s in C* the solution is the projection argmin over f in C of
    1/2 (f - K e)' K^-1 (f - K e). K may also be singular.

    Args:
        stiffness: Stiffness matrix K, (m, m) [N/m], m = n d, whose symmetric part is positive semidefinite.
        displacement: Displacement e = p - c of the fingertips p from the contact points c, (m,) [m].
        normals: Normals into the object, (n, d), d = 1, 2 or 3; they are scaled to unit length.
        friction: None or 0 for normal forces only, "stick", or the coefficient mu: one for all fingers or one per
            finger. If no solution is found with mu, 1e-6 of the largest eigenvalue of K is added to the diagonal of K;
            the resulting forces are accepted if they are a solution for K itself.

    Raises:
        InputError: If a shape is wrong, a value is not finite, a coefficient is negative, no solution is found, or K is
            so ill-conditioned that the residual exceeds 1e-6 of max(|f|, |K e|).
    """
    n_ = finite("normals", normals, largest=np.inf)
    if n_.ndim != 2 or n_.shape[1] not in (1, 2, 3) or n_.shape[0] == 0:
        raise InputError("normals", n_, "an array (n, d) with d = 1, 2 or 3")
    n, d = n_.shape
    m = n * d
    K = finite("stiffness", stiffness)
    e = finite("displacement", displacement)
    if K.shape != (m, m):
        raise InputError("stiffness", K, f"an array ({m}, {m}) for {n} fingers in {d} dimensions")
    if e.shape != (m,):
        raise InputError("displacement", e, f"an array ({m},)")
    n_ = unit_normals(n_, (n, d))
    if 0.0 < np.abs(K).max() < SMALLEST:
        raise InputError("stiffness", K, f"a zero matrix, or a matrix with an entry of {SMALLEST:g} N/m or more")
    values = np.linalg.eigvalsh(0.5 * (K + K.T))
    if values[0] < -1e-9 * np.abs(K).max(initial=0.0):
        raise InputError(
            "stiffness",
            K,
            "a matrix whose symmetric part is positive semidefinite",
            f"its smallest eigenvalue is {values[0]:g} N/m",
        )
    stick = isinstance(friction, str) and friction == "stick"
    expected = f"None, 'stick', or a coefficient >= 0: one or {n}"
    mu = np.zeros(n) if friction is None or stick else each("friction", friction, n, expected)

    F = np.zeros((m, m))
    for i, normal in enumerate(n_.tolist()):
        frame = contact_frame(Vector(*normal, *([0.0] * (3 - d))), d)
        F[i * d : (i + 1) * d, i * d : (i + 1) * d] = np.reshape(list(numbers(frame)), (3, 3))[:d, :d]
    K_f, e_f = F @ K @ F.T, F @ e
    if mu.any():
        force, status, left, law = slipping(K_f, LEAST * values[-1], e_f, mu, d)
    else:
        f, unresolved = pushing(K_f, e_f, Contacts(n, d, stick))
        touching: Status = "stick" if stick else "slide"
        force, status = f.ravel(), tuple(touching if push > 0.0 else "free" for push in f[:, 0])
        left, law = np.inf if unresolved else residual(K_f, e_f, f, stick), "stick" if stick else "frictionless"
    size = float(max(np.abs(force).max(), np.abs(K_f @ e_f).max()))
    if not left <= SOLVED * size:
        found = f"of {size:.3g} N have a residual of {left:.3g} N" if np.isfinite(left) else "were not found"
        raise InputError(
            "stiffness", K, "a matrix for which the contact forces are unique and can be computed",
            f"its eigenvalues are {values[0]:.3g} to {values[-1]:.3g} N/m and forces {found}: reduce the ratio of the "
            "eigenvalues, for example by more compliant contacts",
        )  # fmt: skip
    return Touch(F.T @ force, status, left, law)


def pushing(K: FloatArray, e: FloatArray, contacts: Contacts) -> tuple[FloatArray, bool]:
    """Compute pushing forces (n, d) in contact frames, without friction or sticking, and whether the search failed."""
    m = len(e)
    square = np.zeros((m, m))
    vector, diagonal, marks, state = np.zeros(m), K.diagonal().copy(), np.zeros(m), np.zeros(contacts.count)
    M, q, D = Table(memoryview(square.ravel()), 0, m), Floats(memoryview(vector)), Floats(memoryview(diagonal))
    engaged = Floats(memoryview(state))

    def attempt(back: bool) -> int:
        square[:] = K
        vector[:] = K @ e
        state[:] = 1.0
        if not contacts.whole:
            marks[:] = np.arange(m) % contacts.coordinates > 0
            release(M, q, m, Floats(memoryview(marks)), D)
        return complement(M, q, D, engaged, contacts, back, float(np.abs(vector).max()))

    unresolved = attempt(True)
    if unresolved and contacts.whole:
        unresolved = attempt(False)
    settle(M, q, Floats(memoryview(e)), engaged, contacts)
    return vector.reshape(contacts.count, contacts.coordinates), bool(unresolved)


def slipping(
    K: FloatArray, raised: float, e: FloatArray, mu: FloatArray, d: int
) -> tuple[FloatArray, tuple[Status, ...], float, Law]:
    """Compute forces in friction cones, in contact frames; return forces, contact states, residual [N] and law.

    The residual is inf if no solution is found. K + raised I is tried only if no solution is found for K.
    """
    n, m = len(mu), len(e)
    symmetric = bool(np.abs(K - K.T).max() <= 1e-13 * np.abs(K).max())
    for more in (0.0, raised):
        problem = set_up(memoryview(np.zeros(problem_size(n, m))), 0, n, m)
        contacts = problem.contacts
        contacts.array(ConeContact.coefficient)[:] = mu
        contacts.array(ConeContact.displacement)[:, :d] = e.reshape(n, d)
        square = Table(memoryview((K + more * np.eye(m)).ravel()), 0, m)
        answer = friction_force_square(problem, d, square, symmetric, True, RESTARTS)
        if answer.law != UNRESOLVED:
            break
    law: Law = "associated" if answer.law == ASSOCIATED else "coulomb"
    f = contacts.array(ConeContact.force)[:, :d].ravel()
    s = contacts.array(ConeContact.slip)[:, :d].ravel()
    names: dict[int, Status] = {STICK: "stick", SLIDE: "slide"}
    status = tuple(names.get(int(k), "free") for k in contacts.array(ConeContact.status))
    if answer.law == UNRESOLVED:
        return f, status, np.inf, law
    gap = np.abs(K @ (e + s) - f).max()
    c = np.abs(K).max()
    back = returned(f - c * s, mu, d, answer.law == ASSOCIATED)
    return f, status, float(max(gap, np.abs(back - f).max())), law


def returned(t: FloatArray, mu: FloatArray, d: int, associated: bool) -> FloatArray:
    """Map t = f - c s, (n d,), to the force f, for any c > 0 and any force f and slip s that satisfy the contact law.

    The map is the projection on the cones for the associated law, and the radial return for Coulomb's law.
    """
    normal, tangents = t.reshape(-1, d)[:, 0], t.reshape(-1, d)[:, 1:]
    length = np.linalg.norm(tangents, axis=1)
    inside = (length <= mu * normal) & (normal >= 0.0)
    edge = (normal + mu * length) / (1.0 + mu * mu) if associated else normal
    pushes = np.where(inside, normal, np.maximum(edge, 0.0))
    scale = np.where(inside, 1.0, mu * pushes / np.where(length > 0.0, length, 1.0))
    return np.column_stack([pushes, scale[:, None] * tangents]).ravel()


def residual(K: FloatArray, e: FloatArray, f: FloatArray, stick: bool) -> float:
    """Compute the residual of f = K (e + s) in contact frames [N] for forces f (n, d).

    The slip s is computed for the directions in which a contact is free to move.
    """
    n, d = f.shape
    sticking = np.zeros((n, d), dtype=bool)
    sticking[f[:, 0] > 0.0, : d if stick else 1] = True
    free = ~sticking.ravel()
    s = np.zeros(n * d)
    if free.any():
        s[free] = np.linalg.lstsq(K[np.ix_(free, free)], -(K @ e)[free], rcond=None)[0]
    gap = np.abs(K @ (e + s) - f.ravel()).max()
    if stick:
        return float(gap)
    pull = np.maximum(-s.reshape(n, d)[:, 0], 0.0) * np.diag(K).reshape(n, d)[:, 0]
    if pull.max() > gap:  # a singular K has many slips s; find one without pulling
        from scipy.optimize import lsq_linear

        low = np.where(np.arange(n * d) % d == 0, 0.0, -np.inf)[free]
        s[free] = lsq_linear(K[np.ix_(free, free)], -(K @ e)[free], (low, np.inf), tol=1e-15).x
        return float(min(max(gap, pull.max()), np.abs(K @ (e + s) - f.ravel()).max()))
    return float(max(gap, pull.max()))
