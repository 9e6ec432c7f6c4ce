"""Split of contact forces into an external and an internal part, f = P f + (I - P) f (eq. 3)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx import log
from graspfx.card import Card, Carded, counted, span
from graspfx.errors import InputError, UnknownNameError
from graspfx.grasp.gain import SYMMETRIC
from graspfx.grasp.matrix import GraspMatrix, transposed
from graspfx.numeric import finite, fraction

if TYPE_CHECKING:
    from graspfx.grasp.quality.internal import InternalCoordinates

FloatArray = NDArray[np.float64]
Kind = Literal["pseudoinverse", "mass", "weights", "stiffness"]
AnyKind = Literal["pseudoinverse", "mass", "weights", "stiffness", "virtual-linkage"]  # the last for analysis only

CALLS = ".divide(f), .external, .internal, .internal_basis, .internal_coordinates(names)"
EPS = float(np.finfo(float).eps)
MOST_ROWS = 6  # largest number of rows of G
COARSE = 1e-3  # up to this tolerance an arm about the line through two contacts equals that about their nearest line


class UnitDependentSplitWarning(UserWarning):
    """Warning that a split adds squares of forces and of moments, and therefore depends on the unit of length."""


class Split(Carded):
    """f = P f + (I - P) f, P = G^+ G; with a metric M, P = M G'(G M G')^+ G (Kawai and Yoshikawa, eq. 3).

    P f is the external part, which moves the object. (I - P) f is the internal part, whose wrench is zero. P acts on
    forces, and its transpose Q = G'(G M G')^+ G M on displacements. M Q and M (I - Q) are symmetric and positive
    semidefinite, G M (I - Q) = 0, and P = P' = Q for M = I.

    P depends on G only through its row space. P depends neither on the origin or unit of moments nor on the object's
    frame. A `Grasp` is therefore factored with moments about the contacts' centroid, in units of the contacts' rms
    radius R, so that the rank depends on lengths alone. Rotations are in radians, and translations and torsion of a
    contact in units of R. A unit motion of the object is external if the rms displacement of the contacts exceeds
    `tolerance` R. With the default tolerance, the rotation about a line is internal if all contacts lie within 1e-6 R
    of this line. The rank does not depend on the metric. If a translation is locked, rotations are about the object's
    axis.

    Without a metric, the kernels of `PointCoupling` split hard contacts on a free object. In this case, a rotation
    about the line through the contacts is external only if it also moves the contacts by more than the rounding of
    their coordinates.

    Many sets of contacts, or a stack of matrices (..., w, m), are split in one call, each independently. In this case,
    `rank` and `condition` are arrays (...), and `external` and `internal` are (..., m, m).

    Contacts with moments need a metric that relates radians to metres (`Grasp.metric`). Without a metric, M = I equates
    1 rad with 1 m, so the result depends on the unit of length, and a warning is given.

    Args:
        G: `Grasp`, or matrix (w, m) or (..., w, m). The rank of a matrix is the number of singular values above
            `tolerance` times the largest singular value.
        metric: Metric M on contact displacements: None for I, a diagonal (m,), a symmetric positive definite matrix (m,
            m), or for a `Grasp` a weight per finger (n,).
        tolerance: Relative tolerance of the rank, as described above.
        kind: Name of the metric: "pseudoinverse" for `metric` (by default I, as in the paper); "mass" or "weights" for
            `weights` over their mean, a number per finger; "stiffness" for `stiffness` over its mean, the springs of
            the fingers and their pads. A coupling with any of these metrics is conservative. `graspfx.divide` supports
            one more kind, for analysis.
        weights: Device masses [kg], or numbers of any unit, one per finger (n,), for "mass" and "weights".
        stiffness: Stiffness of each finger and its pad in series, one per finger (n,) for contacts without moments, one
            per component (m,), or a matrix (m, m) [N/m, N m/rad], for "stiffness". This is not the stiffness of the
            coupling, which depends on P.

    Attributes:
        grasp: `Grasp`, or None for a matrix.
        sets: Shape of the sets of contacts, () for one set.

    Raises:
        InputError: If the metric has a wrong shape or is not positive definite, values are not finite, the tolerance is
            outside [0, 1), or weights or stiffness do not belong to the kind.
        UnknownNameError: If the kind is unknown.
    """

    def __init__(
        self,
        G: GraspMatrix | ArrayLike,
        *,
        metric: ArrayLike | None = None,
        tolerance: float = 1e-6,
        kind: Kind = "pseudoinverse",
        weights: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
    ) -> None:
        self._tolerance = fraction("tolerance", tolerance)
        metric = metric_of(G, kind, metric, weights, stiffness)
        self.grasp: GraspMatrix | None = None
        self._root: FloatArray | None = None
        if isinstance(G, GraspMatrix):
            self.grasp, self.sets, self.components = G, G.sets, G.components
            self.of_points = metric is None and G.point_contacts and self._tolerance <= COARSE
            if self.of_points:  # nothing to check
                return
        else:
            self.of_points = False
            self._bare = finite("G", G)
            if self._bare.ndim < 2 or self._bare.shape[-1] == 0:
                raise InputError("G", self._bare, "a Grasp or a matrix (w, m)")
            self.sets, self.components = self._bare.shape[:-2], self._bare.shape[-1]
        self.metric = self._checked(metric)
        self._root = self._root_of(metric)

    @cached_property
    def metric(self) -> FloatArray:
        """Metric M: (m,) if it is diagonal, else (m, m)."""
        return np.ones(self.components)

    @cached_property
    def rank(self) -> Any:
        """Rank of G: an integer, or an array (...) for many sets."""
        if self.of_points:
            return self._point_modes[1]
        count = (self._spectrum[1] > 0.0).sum(axis=-1)
        return count if self.sets else int(count)

    @cached_property
    def condition(self) -> Any:
        """Ratio of the largest to the smallest singular value above the tolerance, (...); 1 if no value is above it."""
        values = self._values if self.of_points else self._spectrum[1]
        if not values.shape[-1]:
            return np.ones(self.sets) if self.sets else 1.0
        rank = np.asarray(self.rank)[..., None]
        least = np.take_along_axis(values, np.maximum(rank - 1, 0), axis=-1)[..., 0]
        ratio = np.where(rank[..., 0] > 0, values[..., 0] / np.where(least > 0.0, least, 1.0), 1.0)
        return ratio if self.sets else float(ratio)

    @cached_property
    def _motions(self) -> FloatArray:
        """Contact displacements of the object's free motions as columns, (..., m, rank); they span the row space of G.

        Columns beyond a set's rank are zero.
        """
        return self._point_modes[0] if self.of_points else self._spectrum[0]

    @cached_property
    def modes(self) -> FloatArray:
        """Orthonormal motions (..., m, rank) in the coordinates L x of the metric M = L L."""
        if self._root is None and (self.grasp is None or self.of_points or not self.grasp.torsion_columns.any()):
            return self._motions
        Q = np.linalg.qr(transposed(self.stretch(transposed(self._motions))))[0]
        return Q * (np.arange(Q.shape[-1]) < np.asarray(self.rank)[..., None])[..., None, :] if self.sets else Q

    @property
    def matrix(self) -> FloatArray:
        """Given matrix G, (w, m) or (..., w, m)."""
        return self._bare if self.grasp is None else self.grasp.matrix

    @cached_property
    def _point_modes(self) -> tuple[FloatArray, Any]:
        """Modes and rank of point contacts, computed by a kernel."""
        from graspfx.grasp.point_sets import modes_of_one, point_modes

        points = self.points
        if not self.sets:
            return modes_of_one(points, self.point_tolerance)
        modes, ranks = point_modes(points.reshape(-1, *points.shape[-2:]), self.point_tolerance)
        return transposed(modes.reshape(*self.sets, *modes.shape[-2:])), ranks.reshape(self.sets)

    @property
    def points(self) -> FloatArray:
        """Contact points of a `Grasp`, (..., n, d) [m]."""
        assert self.grasp is not None
        return self.grasp.points

    @cached_property
    def point_tolerance(self) -> float:
        """Tolerance for point contacts, at least the rounding error."""
        return max(self._tolerance, max(self.components, MOST_ROWS) * EPS)

    @property
    def _values(self) -> FloatArray:
        """All singular values of the factored matrix, in descending order."""
        assert self.grasp is not None
        return np.asarray(np.linalg.svd(self.grasp.unit_free()[0], compute_uv=False))

    @cached_property
    def _spectrum(self) -> tuple[FloatArray, FloatArray]:
        """Basis (..., m, rank) of the rows of G, and singular values, zero below the tolerance.

        The basis is orthonormal after the rows of torsions are multiplied by the contacts' rms radius.
        """
        if self.grasp is None:
            basis, values = _row_space(self._bare, relative=self._tolerance)
        else:
            A, size = self.grasp.unit_free()
            basis, values = _row_space(A, self._tolerance * np.sqrt(self.grasp.fingers))
            if self.grasp.torsion_columns.any():
                basis[..., self.grasp.torsion_columns, :] /= np.asarray(size)[..., None, None]
        return basis if self.sets else basis[:, : (values > 0.0).sum()], values

    def _card(self) -> Card:
        kind = "" if self.grasp is None else f" of {counted(self.grasp.fingers, 'contact')}"
        rank = f"{self.rank}: the external forces' dimensions; {self.components - self.rank} internal"
        if self.sets:
            rank = f"{span(self.rank.ravel(), '')}: the external forces' dimensions"
        metric = "equal" if self._root is None else f"given, of {span(self._weights(), '')}".rstrip()
        rows = [
            ("sets", " x ".join(map(str, self.sets))),
            ("components", f"{self.components} of the contact forces{kind}"),
            ("rank", rank),
            ("condition", span(np.atleast_1d(self.condition).ravel(), "") if self.sets else f"{self.condition:.4g}"),
            ("metric", metric),
        ]
        return Card("Split into external and internal forces, eq. (3)", rows, CALLS)

    def _weights(self) -> FloatArray:
        return np.asarray(self.metric if self.metric.ndim == 1 else np.linalg.eigvalsh(self.metric), dtype=float)

    @cached_property
    def external(self) -> FloatArray:
        """Projector P on forces, (m, m), or (..., m, m) for many sets."""
        if self._root is None:
            return np.asarray(self.modes @ transposed(self.modes))
        return transposed(self._project_rows(np.eye(self.components)))

    @cached_property
    def internal(self) -> FloatArray:
        """Projector I - P on forces, (..., m, m)."""
        return np.eye(self.components) - self.external

    @cached_property
    def displacement_external(self) -> FloatArray:
        """Projector Q = P' on displacements, (..., m, m): the best-fitting rigid motion in the metric."""
        return transposed(self.external)

    @cached_property
    def internal_basis(self) -> FloatArray:
        """Orthonormal basis (..., m, m - rank) of the forces whose wrench is zero: the null space of G.

        Raises:
            InputError: If the ranks of the sets of contacts differ.
        """
        rank = self.rank
        if self.sets:
            ranks = np.unique(rank)
            if len(ranks) > 1:
                expected = "sets of contacts with equal ranks"
                raise InputError("rank", ranks.tolist(), expected, "split the sets of each rank separately")
            rank = int(ranks[0])
        return np.linalg.qr(self._motions[..., :rank], mode="complete")[0][..., rank:]

    def internal_coordinates(self, names: Sequence[str] | None = None) -> InternalCoordinates:
        """Return named coordinates of the internal forces: tensions, bendings, torsions; see `InternalCoordinates`.

        Args:
            names: Names of the fingers, in the order of the contacts; "1", "2", ... if None.

        Raises:
            InputError: If the split is of a matrix instead of a `Grasp`, or the names are invalid.
        """
        from graspfx.grasp.quality.internal import internal_coordinates

        if self.grasp is None:
            raise InputError("split", self.grasp, "the split of a Grasp", "a matrix has no information about contacts")
        self.grasp.require_one("internal_coordinates")
        return internal_coordinates(self.grasp, self, self.rank, names)

    def divide(self, force: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Divide contact forces (m,) or (..., m) into external and internal parts, whose sum is the force.

        For many sets of contacts, forces are (..., m), with one force for each set or one force for all sets.
        """
        f = finite("force", force)
        if f.shape[-1:] != (self.components,) or not fits(f.shape[:-1], self.sets):
            sets = f", for one or each of the sets of contacts {self.sets}" if self.sets else ""
            expected = f"an array whose last axis has the {self.components} contact components{sets}"
            raise InputError("force", force, expected)
        external = self.project(f)
        return external, f - external

    def project(self, force: FloatArray) -> FloatArray:
        """Compute P f for forces (..., m), without checks."""
        if not self.sets:
            return self._project_rows(force)
        return np.asarray(self._project_rows(force[..., None, :])[..., 0, :])

    def _project_rows(self, forces: FloatArray) -> FloatArray:
        """Compute P f for rows of forces (..., k, m) of each set of contacts."""
        U = self.modes
        if self._root is None:
            return np.asarray((forces @ U) @ transposed(U))
        return self.stretch((self.stretch(forces, inverse=True) @ U) @ transposed(U))

    def stretch(self, x: FloatArray, *, inverse: bool = False) -> FloatArray:
        """Compute L x, or L^-1 x, for rows x (..., m), where L = M^(1/2) is symmetric."""
        L = self._root
        if L is None:
            return x
        if L.ndim == 1:
            return x / L if inverse else x * L
        return np.asarray(np.linalg.solve(L, x[..., None])[..., 0] if inverse else x @ L)

    def weigh(self, x: FloatArray) -> FloatArray:
        """Compute M x for vectors x (..., m)."""
        if self._root is None:
            return x
        return self.metric * x if self.metric.ndim == 1 else np.asarray((self.metric @ x[..., None])[..., 0])

    def modal_metric(self) -> FloatArray:
        """Compute M Q = L U U' L, (..., m, m), symmetric to the last bit: the stiffness of a unit external gain."""
        LU = self.stretch(transposed(self.modes))
        return np.asarray(transposed(LU) @ LU)

    def _checked(self, metric: ArrayLike | None) -> FloatArray:
        m = self.components
        M = np.ones(m) if metric is None else finite("metric", metric)
        if self.grasp is not None:
            per_finger = M.shape == (self.grasp.fingers,)
            if per_finger:
                M = M[self.grasp.finger_of_column]
            moments = self.grasp.torsion_columns.any() and self.grasp.moment_rows.any()
            if moments and (metric is None or per_finger):
                log.warn(
                    "the contacts have moments, and no metric relates them to forces: 1 rad of torsion is equated "
                    "with 1 m, so that the split depends on the unit of length; pass "
                    "metric=grasp.metric(torsion_length=...) with the radius of a contact patch",
                    UnitDependentSplitWarning,
                )
        if M.shape not in ((m,), (m, m)):
            per = "" if self.grasp is None else f", or {self.grasp.fingers} weights, one per finger"
            raise InputError("metric", M, f"a diagonal ({m},) or a matrix ({m}, {m}){per}")
        if M.ndim == 1 and not (M > 0.0).all():
            raise InputError(
                "metric", M.tolist(), "positive entries", "with a weight of zero the split is undetermined"
            )
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
        # the symmetric root, unlike Cholesky's, rotates with the axes in which M is written
        return np.asarray((axes * np.sqrt(values)) @ axes.T)


def metric_of(
    G: object, kind: str, metric: ArrayLike | None, weights: ArrayLike | None, stiffness: ArrayLike | None
) -> ArrayLike | None:
    """Return the metric of a kind of split, with mean 1 over force components; for "pseudoinverse", return `metric`.

    Raises:
        InputError: If a metric is given for a kind that defines one, weights or stiffness are missing or given for
            another kind, or G is a matrix.
        UnknownNameError: If the kind is unknown.
    """
    if str(kind) not in get_args(Kind):
        raise UnknownNameError("kind of split", str(kind), get_args(Kind))
    given = {"weights": weights, "stiffness": stiffness}
    needed = {"mass": "weights", "weights": "weights", "stiffness": "stiffness"}.get(kind)
    for name, value in given.items():
        if (value is not None) != (name == needed):
            expected = f"a number per finger for kind={kind!r}" if name == needed else f"none for kind={kind!r}"
            raise InputError(name, value, expected)
    if needed is None:
        return metric
    if metric is not None:
        raise InputError("metric", metric, f"None with kind={kind!r}, which defines a metric")
    if not isinstance(G, GraspMatrix):
        raise InputError(
            "G", G, f"a Grasp for kind={kind!r}", "a matrix has no information about contacts: pass a Grasp"
        )
    M = finite(needed, given[needed])
    finger, torsion = G.finger_of_column, G.torsion_columns
    per_finger = M.shape == (G.fingers,)
    if not per_finger and (needed == "weights" or M.shape not in ((len(finger),), (len(finger),) * 2)):
        more = ", one per component, or a matrix" if needed == "stiffness" else ""
        raise InputError(needed, M, f"{G.fingers} positive numbers, one per finger{more}")
    if per_finger and torsion.any():
        do = "stiffness per component" if needed == "stiffness" else "metric=grasp.metric(torsion_length=, weights=)"
        expected = (
            "contacts without moments, because one number per finger cannot have the units of both forces and moments"
        )
        raise InputError(needed, M, expected, f"pass {do}")
    size = float((np.diag(M) if M.ndim == 2 else M)[slice(None) if per_finger else ~torsion].mean())
    return M / size if size > 0.0 else M


def fits(shape: tuple[int, ...], sets: tuple[int, ...]) -> bool:
    """Return whether an array's leading axes match the sets of contacts; for one set, any leading axes match."""
    if not sets:
        return True
    try:
        np.broadcast_shapes(shape, sets)
    except ValueError:
        return False
    return True


def _row_space(A: FloatArray, absolute: float = 0.0, relative: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Compute orthonormal bases (..., m, k) of the row spaces of A, and the singular values (..., k) above a threshold.

    Columns and values beyond the rank are zero.
    """
    if not A.size:
        return np.zeros((*A.shape[:-2], A.shape[-1], 0)), np.zeros((*A.shape[:-2], 0))
    values, rows = np.linalg.svd(A, full_matrices=False)[1:]
    noise = max(A.shape[-2:]) * EPS
    least = np.maximum(absolute, max(relative, noise) * values[..., :1])
    counting = values > least
    lengths = np.sqrt((A**2).sum(axis=-1))
    independent = lengths > least
    graded = independent.sum(axis=-1) == counting.sum(axis=-1)
    if graded.any():
        # lengths of rows differ greatly; each row is accurate relative to its length, and unit rows keep that accuracy
        unit = np.where(independent, 1.0 / np.where(independent, lengths, 1.0), 0.0)[..., None] * A
        rows = np.where(graded[..., None, None], np.linalg.svd(unit, full_matrices=False)[2], rows)
    return transposed(rows * counting[..., None]), values * counting


def divide(
    grasp: GraspMatrix | ArrayLike,
    force: ArrayLike,
    kind: AnyKind = "pseudoinverse",
    *,
    weights: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    metric: ArrayLike | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Divide contact forces f into external and internal parts, f = P f + (I - P) f, G (I - P) = 0.

    | kind | P on forces | source | conservative as a coupling |
    |---|---|---|---|
    | pseudoinverse | G^+ G | Kawai and Yoshikawa, eq. 3 | yes |
    | mass, weights | M G'(G M G')^+ G, M a number per finger | Erhart and Hirche 2015 | yes |
    | stiffness | the same, M the springs of fingers and pads | | yes |
    | virtual-linkage | only forces exert the wrench | Williams and Khatib 1993 | not with moments |

    Args:
        grasp: `Grasp`; or for "pseudoinverse" a matrix (w, m), whose columns are all forces or all moments.
        force: Contact forces (m,) or (..., m); (..., n, d) for contacts with d forces each [N, N m]. For many sets of
            contacts, forces are for each set, or for all.
        kind: Kind of the split, from the table.
        weights, stiffness: Weights and stiffness, as for `Split`.
        metric: Metric M, for "pseudoinverse": `grasp.metric(torsion_length=...)` if contacts have moments.

    Returns:
        External and internal forces, with the shape of `force`, after that of many sets of contacts.

    Raises:
        InputError: If an argument is invalid for `Split`, or if an argument is given that the kind does not use.
        UnknownNameError: If the kind is unknown.
    """
    if str(kind) not in get_args(AnyKind):
        raise UnknownNameError("kind of split", str(kind), get_args(AnyKind))
    f, axes = finite("force", force), 1
    if isinstance(grasp, GraspMatrix) and f.shape[-2:] == grasp.points.shape[-2:]:
        axes = 2 if f.shape[-1] != grasp.components or grasp.fingers == 1 else 1
    flat, own = f.reshape(*f.shape[:-2], -1) if axes == 2 else f, f.shape[-axes:]
    if kind == "virtual-linkage":
        from graspfx.grasp.quality.internal import VirtualLinkage

        if not isinstance(grasp, GraspMatrix):
            raise InputError("grasp", grasp, "a Grasp for kind='virtual-linkage'")
        if not (weights is stiffness is metric is None):
            raise InputError("weights", weights, "no weights, stiffness or metric for kind='virtual-linkage'")
        grasp.require_one("divide")
        parts = VirtualLinkage(grasp).divide(flat)
    else:
        named: Kind = kind
        parts = Split(grasp, kind=named, weights=weights, stiffness=stiffness, metric=metric).divide(flat)
    external, internal = (part.reshape(*part.shape[:-1], *own) for part in parts)
    return external, internal
