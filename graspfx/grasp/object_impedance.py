"""Stiffness and damping of an object relative to the fingers, and distribution of both over the contacts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.card import Card, Carded
from graspfx.errors import InputError
from graspfx.grasp.contact import MOMENTS
from graspfx.grasp.gain import checked_gain, even, gain_text
from graspfx.grasp.matrix import GraspMatrix
from graspfx.grasp.split import Split
from graspfx.numeric import finite

FloatArray = NDArray[np.float64]

FREEDOMS = {d + MOMENTS[d]: d for d in MOMENTS}  # dimensions by the number of an object's degrees of freedom
ROUNDING = 1e-13  # relative bound below which eigenvalues of the unheld stiffness are zero


@dataclass(frozen=True, eq=False, init=False, repr=False)
class ObjectImpedance(Carded):
    """Spring and damper between fingers and object: a rigid displacement x of the fingers exerts the wrench K_o x.

    As the external part of a `Coupling`, stiffness and damping are distributed over the contacts so that the object has
    the given stiffness for any number of fingers. Let N span the null space of G', let M be the metric of the split,
    and let X = M G'(G M G')^+. Then

        K_c = K_o - K_o N (N' K_o N)^+ N' K_o,    K_ep = X K_c X'.

    In K_c, degrees of freedom that the contacts cannot hold are eliminated by static condensation, so that the result
    depends neither on the unit of moments nor on the reference point. Therefore P K_ep = K_ep = K_ep P' and G K_ep
    G' = K_c, which equals K_o if G has full rank. K_ep is symmetric and creates no energy. The internal part adds
    nothing to the object's stiffness.

    K_o is the stiffness at zero squeeze. Squeezing adds the geometric stiffness of the contact forces, which
    a certificate includes.

    Args:
        stiffness: Stiffness K_o in the axes of the contact points, (w, w), forces before moments [N/m, N, N m/rad]; or
            the diagonal of K_o, (w,), or on a line a number. The size w is 1, 3 or 6, or the number of free degrees of
            freedom of the grasp. Rows and columns of locked degrees of freedom have no effect.
        damping: Damping D_o [N s/m, N s, N m s/rad], in one of the same forms; zero if None.
        point: Point to which K_o and D_o refer, (d,) [m]; the origin of the grasp's moments if None.

    Raises:
        InputError: If a matrix is not symmetric positive semidefinite, or a shape is wrong.
    """

    stiffness: FloatArray
    damping: FloatArray
    point: FloatArray | None

    def __init__(self, stiffness: ArrayLike, damping: ArrayLike | None = None, point: ArrayLike | None = None) -> None:
        K = _square("stiffness", stiffness)
        D = np.zeros_like(K) if damping is None else _square("damping", damping)
        if D.shape != K.shape:
            raise InputError("damping", D.shape, f"a matrix of shape {K.shape}, like the stiffness")
        where = None if point is None else finite("point", point)
        if where is not None and where.shape != (FREEDOMS.get(len(K)),):
            d = FREEDOMS.get(len(K))
            raise InputError(
                "point",
                point,
                f"a point of {d} coordinates" if d else "None, because the stiffness omits locked degrees of freedom",
            )
        for name, value in ("stiffness", K), ("damping", D), ("point", where):
            if value is not None:
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    def _card(self) -> Card:
        return Card(f"Impedance of the object: {self._text()}")

    def _text(self) -> str:
        return f"{gain_text(self.stiffness, 'N/m, N m/rad')}, {gain_text(self.damping, 'N s/m, N m s/rad')}"

    def turned(self, R: FloatArray) -> ObjectImpedance:
        """Return the impedance in other axes; R (d, d) rotates from the present axes to the other axes."""
        w = len(self.stiffness)
        d, R = FREEDOMS.get(w), finite("R", R)
        if d is None or R.shape != (d, d):
            raise InputError("R", R.shape, f"({d}, {d}): an object has one set of axes")
        T = np.eye(w)
        T[:d, :d] = R
        if d == 3:
            T[3:, 3:] = R
        point = None if self.point is None else R @ self.point
        return ObjectImpedance(even(T @ self.stiffness @ T.T), even(T @ self.damping @ T.T), point)

    def about(self, origin: ArrayLike) -> ObjectImpedance:
        """Return the impedance about another point (d,) [m], S'K S and S'D S.

        A motion x at this point is the motion S x at `point`.
        """
        if self.point is None:
            return self
        d, given = len(self.point), finite("origin", origin)
        if given.shape != (d,):
            raise InputError("origin", origin, f"a point of {d} coordinates [m]")
        r = self.point - given
        S = np.eye(len(self.stiffness))
        if d == 2:
            S[:2, 2] = -r[1], r[0]
        elif d == 3:
            S[:3, 3:] = [[0.0, r[2], -r[1]], [-r[2], 0.0, r[0]], [r[1], -r[0], 0.0]]
        return ObjectImpedance(even(S.T @ self.stiffness @ S), even(S.T @ self.damping @ S))


def object_gain(impedance: ObjectImpedance, pair: str, split: Split) -> FloatArray:
    """Compute K_ep, or D_ep if `pair` is "damping", of a split's contacts, (..., m, m), symmetric to the last bit.

    Raises:
        InputError: If the impedance and the grasp have different degrees of freedom.
    """
    m, sets = split.components, split.sets
    grasp = split.grasp
    origin = np.zeros(1) if grasp is None else grasp.origin
    LU = split.stretch(np.swapaxes(split.modes, -1, -2))  # (..., r, m)
    G = np.broadcast_to(split.matrix, (*sets, *split.matrix.shape[-2:])).reshape(-1, split.matrix.shape[-2], m)
    out = np.zeros((len(G), m, m))
    moments = np.zeros(G.shape[1], dtype=bool) if grasp is None else grasp.moment_rows
    origins = np.broadcast_to(origin, (*sets, origin.shape[-1])).reshape(len(G), -1)
    ranks = np.broadcast_to(split.rank, sets).ravel()
    for k, (each, rows) in enumerate(zip(G, np.asarray(LU).reshape(len(G), -1, m), strict=True)):
        K = _of_freedoms(getattr(impedance.about(origins[k]), pair), grasp, len(each))
        used = rows[: ranks[k]]
        out[k] = even(used.T @ modal_gain(K, each @ used.T, moments) @ used)
    return out.reshape(*sets, m, m)


def modal_gain(K: FloatArray, T: FloatArray, moments: NDArray[np.bool_]) -> FloatArray:
    """Compute T^+ K_c T^+' (r, r), where K_c is the stiffness (w, w) after condensation of unheld degrees of freedom.

    T (w, r) has full rank; its columns are the wrenches of unit modal forces. Forces and moments are scaled by the
    stiffness, not by the entries of T, because a moment in T may be rounding error.
    """
    if not K.any():
        return np.zeros((T.shape[1],) * 2)
    square, kinds = np.ones(len(K)), [kind for kind in (~moments, moments) if kind.any()]
    largest, sizes = [K.diagonal()[kind].max() for kind in kinds], [(T[kind] ** 2).max() for kind in kinds]
    for k, kind in enumerate(kinds):
        other = 1 - k
        from_other = largest[other] * (sizes[k] / sizes[other] or 1.0) if len(kinds) > 1 and sizes[other] else 1.0
        square[kind] = largest[k] or from_other
    size = np.sqrt(square)
    T, K = T / size[:, None], K / size[:, None] / size
    U, values, V = np.linalg.svd(T)
    r = T.shape[1]
    N = U[:, r:]
    if N.size:
        KN = K @ N
        K = K - KN @ np.linalg.pinv(even(N.T @ KN), rcond=ROUNDING, hermitian=True) @ KN.T
    back = V.T / values @ U[:, :r].T
    return np.asarray(back @ K @ back.T)


def _of_freedoms(K: FloatArray, grasp: GraspMatrix | None, w: int) -> FloatArray:
    """Omit rows and columns of locked degrees of freedom."""
    free = np.ones(w, dtype=bool) if grasp is None else grasp.free
    if len(K) == len(free):
        return np.asarray(K[np.ix_(free, free)])
    if len(K) == w:
        return K
    raise InputError("stiffness", K.shape, f"a matrix ({len(free)}, {len(free)}) on the object's degrees of freedom")


def _square(name: str, argument: ArrayLike) -> FloatArray:
    value = finite(name, argument)
    if value.ndim < 2:
        value = np.diag(np.atleast_1d(value))
    if value.ndim != 2 or not 0 < len(value) <= 6:
        raise InputError(
            name, value.shape, "a number, (w,) or (w, w) for w = 1, 3 or 6 degrees of freedom of the object"
        )
    return np.array(checked_gain(name, value))
