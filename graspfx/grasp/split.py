"""The split of contact forces into external and internal ones, f = P f + (I - P) f (eq. 3)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.card import Card, Carded, counted, span
from graspfx.errors import InputError
from graspfx.grasp.matrix import GraspMatrix
from graspfx.numeric import finite, number

if TYPE_CHECKING:
    from graspfx.grasp.quality.internal import InternalCoordinates

FloatArray = NDArray[np.float64]

CALLS = ".divide(f), .external, .internal, .internal_basis, .internal_coordinates(names)"
SYMMETRIC = 1e-9  # relative: what a matrix may be off and still be taken as symmetric


class UnitDependentSplitWarning(UserWarning):
    """A split that adds squares of forces and of moments, so that it changes with the unit of length."""


@runtime_checkable
class ContactSet(Protocol):
    """A set of contacts, as the split needs it; `grasp.matrix.GraspMatrix` answers."""

    fingers: int
    finger_of_column: NDArray[np.int64]
    torsion_columns: NDArray[np.bool_]
    moment_rows: NDArray[np.bool_]

    def unit_free(self) -> tuple[FloatArray, float]:
        """Give a matrix with the row space of G after torsion columns are multiplied by a length, and that length."""


class Split(Carded):
    """f = P f + (I - P) f, P = G^+ G; with a metric M, P = M G'(G M G')^+ G (Kawai and Yoshikawa, eq. 3).

    P f is external: what moves the object. (I - P) f is internal: its wrench is zero. P acts on forces, its transpose
    Q = G'(G M G')^+ G M on displacements; M Q and M (I - Q) are symmetric and positive semidefinite,
    G M (I - Q) = 0, and P = P' = Q where M = I.

    P depends on the row space of G only: not on the origin of moments, nor on their unit, nor on the object's frame.
    So a `Grasp` is factored with moments about the contacts' centroid in units of their rms radius R, and its rank is
    a matter of length: with turns in radians, shifts in units of R and the torsion of a contact in units of R, a unit
    motion of the object counts if it moves the contacts by more than `tolerance` R, as a root mean square over them.
    At the default, contacts within 1e-6 R of a line leave the rotation about that line internal. The rank knows
    nothing of the metric. (Where translations are locked, a rotation keeps its own axis.)

    Contacts with moments need a metric that says how long a radian is (`Grasp.metric`). Without one, M = I takes 1 rad
    for 1 m and warns: the result then depends on the unit of length.

    Args:
        G: a `Grasp`, or a matrix (w, m), whose rank is the number of singular values above `tolerance` times the
            largest.
        metric: M on contact displacements: None for I, a diagonal (m,), a symmetric positive definite matrix (m, m), or
            for a `Grasp` a weight per finger (n,).
        tolerance: as above.

    Attributes:
        grasp: the `Grasp`, or None for a bare matrix.
        metric: M, (m,) if it is diagonal, else (m, m).
        rank: rank of G.
        condition: largest over smallest kept singular value of what was factored (1 if none is kept).

    Raises:
        InputError: a metric that does not fit or is not positive definite, values that are not finite, a tolerance
            outside [0, 1).
    """

    def __init__(self, G: ContactSet | ArrayLike, *, metric: ArrayLike | None = None, tolerance: float = 1e-6) -> None:
        tolerance = fraction("tolerance", tolerance)
        self.grasp = G if isinstance(G, ContactSet) else None
        if self.grasp is not None:
            self.components = len(self.grasp.finger_of_column)
            A, size = self.grasp.unit_free()
            basis, values = _row_space(A, tolerance * np.sqrt(self.grasp.fingers))
            if self.grasp.torsion_columns.any():
                basis[self.grasp.torsion_columns] /= size
        else:
            bare = finite("G", cast(ArrayLike, G))
            if bare.ndim != 2 or bare.shape[1] == 0:
                raise InputError("G", bare, "a Grasp or a matrix (w, m)")
            self.components = bare.shape[1]
            largest = float(np.linalg.norm(bare, 2)) if bare.size else 0.0
            basis, values = _row_space(bare, tolerance * largest)
        self.rank = len(values)
        self.condition = float(values[0] / values[-1]) if self.rank else 1.0
        self.metric = self._checked(metric)
        self._root = self._root_of(metric)
        self._motions = basis  # contact displacements of the object's free motions, spanning the rows of G: (m, rank)
        # the same in the metric's own coordinates, L x with M = L L, orthonormal
        orthonormal = self._root is None and (self.grasp is None or not self.grasp.torsion_columns.any())
        self._modes = basis if orthonormal else np.linalg.qr(self.stretch(basis.T).T)[0]

    def _card(self) -> Card:
        kind = "" if self.grasp is None else f" of {counted(self.grasp.fingers, 'contact')}"
        metric = "equal" if self._root is None else f"given, of {span(self._weights(), '')}".rstrip()
        rows = [
            ("components", f"{self.components} of the contact forces{kind}"),
            ("rank", f"{self.rank}: the external forces' dimensions; {self.components - self.rank} internal"),
            ("condition", f"{self.condition:.4g}"),
            ("metric", metric),
        ]
        return Card("Split into external and internal forces, eq. (3)", rows, CALLS)

    def _weights(self) -> FloatArray:
        return np.asarray(self.metric if self.metric.ndim == 1 else np.linalg.eigvalsh(self.metric), dtype=float)

    @cached_property
    def external(self) -> FloatArray:
        """P on forces, (m, m)."""
        if self._root is None:
            return self._modes @ self._modes.T
        return self.project(np.eye(self.components)).T

    @cached_property
    def internal(self) -> FloatArray:
        """I - P on forces, (m, m)."""
        return np.eye(self.components) - self.external

    @cached_property
    def displacement_external(self) -> FloatArray:
        """Q = P' on displacements, (m, m): the best-fitting rigid motion in the metric."""
        return self.external.T

    @cached_property
    def internal_basis(self) -> FloatArray:
        """Orthonormal basis (m, m - rank) of the forces without a wrench: the null space of G."""
        return np.linalg.qr(self._motions, mode="complete")[0][:, self.rank :]

    def internal_coordinates(self, names: Sequence[str] | None = None) -> InternalCoordinates:
        """Give internal forces as named tensions, bendings and torsions of the fingers; see `InternalCoordinates`.

        Args:
            names: of the fingers, in the order of the contacts; "1", "2", ... if None.

        Raises:
            InputError: the split of a bare matrix, names that do not fit.
        """
        from graspfx.grasp.quality.internal import internal_coordinates

        if not isinstance(self.grasp, GraspMatrix):
            raise InputError("split", self.grasp, "the split of a Grasp", "a bare matrix does not know its contacts")
        return internal_coordinates(self.grasp, self, self.rank, names)

    def divide(self, force: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Divide contact forces (m,) or (..., m) into external and internal parts; their sum is the force."""
        f = finite("force", force)
        if f.shape[-1:] != (self.components,):
            raise InputError("force", f, f"an array whose last axis has the {self.components} contact components")
        external = self.project(f)
        return external, f - external

    def project(self, force: FloatArray) -> FloatArray:
        """Project P f for forces (..., m), unchecked."""
        U = self._modes
        if self._root is None:
            return (force @ U) @ U.T
        return self.stretch((self.stretch(force, inverse=True) @ U) @ U.T)

    def stretch(self, x: FloatArray, *, inverse: bool = False) -> FloatArray:
        """Stretch rows x (..., m) to L x, L = M^(1/2) symmetric; or to L^-1 x."""
        L = self._root
        if L is None:
            return x
        if L.ndim == 1:
            return x / L if inverse else x * L
        return np.asarray(np.linalg.solve(L, x[..., None])[..., 0] if inverse else x @ L)

    def weigh(self, x: FloatArray) -> FloatArray:
        """Weigh a vector x (m,): M x."""
        if self._root is None:
            return x
        return self.metric * x if self.metric.ndim == 1 else self.metric @ x

    def modal_metric(self) -> FloatArray:
        """Compute M Q = L U U' L, (m, m), symmetric to the last bit: one unit of external stiffness."""
        LU = self.stretch(self._modes.T)
        return LU.T @ LU

    def _checked(self, metric: ArrayLike | None) -> FloatArray:
        m = self.components
        M = np.ones(m) if metric is None else finite("metric", metric)
        if self.grasp is not None:
            per_finger = M.shape == (self.grasp.fingers,)
            if per_finger:
                M = M[self.grasp.finger_of_column]
            moments = self.grasp.torsion_columns.any() and self.grasp.moment_rows.any()
            if moments and (metric is None or per_finger):
                warnings.warn(
                    "contacts with moments and no metric for them: 1 rad of torsion is taken for 1 m, and the split "
                    "depends on the unit of length; pass metric=grasp.metric(torsion_length=...), the radius of a "
                    "contact patch",
                    UnitDependentSplitWarning,
                    stacklevel=3,
                )
        if M.shape not in ((m,), (m, m)):
            per = "" if self.grasp is None else f", or {self.grasp.fingers} weights, one per finger"
            raise InputError("metric", M, f"a diagonal ({m},) or a matrix ({m}, {m}){per}")
        if M.ndim == 1 and not (M > 0.0).all():
            raise InputError("metric", M.tolist(), "positive entries", "a weight of zero leaves the split undetermined")
        if M.ndim == 2 and np.abs(M - M.T).max() > SYMMETRIC * np.abs(M).max():
            raise InputError("metric", M, "a symmetric matrix")
        return M

    def _root_of(self, metric: ArrayLike | None) -> FloatArray | None:
        M = self.metric
        if metric is None or (M.ndim == 1 and (M == 1.0).all()):
            return None
        if M.ndim == 1:
            return np.asarray(np.sqrt(M))
        values, axes = np.linalg.eigh((M + M.T) / 2)
        if not values[0] > 0.0:
            raise InputError("metric", M, "a positive definite matrix", f"its smallest eigenvalue is {values[0]:.1e}")
        # the symmetric root, not Cholesky's: it turns with the axes in which M is written
        return np.asarray((axes * np.sqrt(values)) @ axes.T)


def fraction(name: str, argument: float) -> float:
    """Check a relative tolerance in [0, 1)."""
    value = number(name, argument, "a relative tolerance in [0, 1)")
    if value >= 1.0:
        raise InputError(name, argument, "a relative tolerance in [0, 1)")
    return value


def _row_space(A: FloatArray, threshold: float) -> tuple[FloatArray, FloatArray]:
    """Find an orthonormal basis (m, rank) of the row space of A, and the singular values above the threshold."""
    if not A.size:
        return np.zeros((A.shape[1], 0)), np.zeros(0)
    values, rows = np.linalg.svd(A, full_matrices=False)[1:]
    noise = max(A.shape) * np.finfo(float).eps * values[0]
    values = values[values > max(threshold, noise)]
    lengths = np.sqrt((A**2).sum(axis=1))
    independent = lengths > max(threshold, noise)
    if independent.sum() == len(values):
        # rows of very different length, each accurate in itself: unit rows keep that accuracy
        rows = np.linalg.svd(A[independent] / lengths[independent, None], full_matrices=False)[1:][1]
    return rows[: len(values)].T.copy(), values
