"""Search for the smallest factor of a gain at which a whole loop becomes unstable.

The loop is divided into independent parts. The spectral radius on a grid of factors s brackets the limit. If the matrix
of the loop has the form A_0 + s A_1, Newton's method then finds the factor at which the eigenvalue that leaves the unit
circle has the modulus 1. Otherwise, a root-finding method finds the factor at which the spectral radius is 1. For loops
with a long delayed reaction, the search uses the number of eigenvalues outside the circle instead of the spectral
radius.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.late_roots import LateLoop, farthest_root, root_at, root_near, roots_beyond
from graspfx.analysis.stability.loop import LoopRows, drift_free, is_late, late_loop, loop_matrix, uncoupled
from graspfx.analysis.stability.modes import Part, parts_of
from graspfx.certificate.certificate import ROUNDING, is_stable

FloatArray = NDArray[np.float64]
Stiffness = Callable[[float], FloatArray]

LEAST, MOST = 0.01, 100.0  # range of factors of a gain in which its limit is searched
GRID = 64  # number of factors in that range, 16 % apart; a narrower gap in the stable range can be missed
ABOVE = tuple(np.geomspace(1.0, MOST, GRID // 2).tolist())
BELOW = tuple(np.geomspace(LEAST, 1.0, GRID // 2).tolist())
BATCH = 2  # factors that are evaluated together, in ascending order, until a factor is unstable
BEYOND = 1e-9  # relative to the limit: distance above it at which the crossed root is examined
ANOTHER = 1e-7  # excess of |z| over 1 at that distance that reveals a root that crossed earlier
ROUNDS = 8  # largest number of searches for an earlier root
STEPS = 12  # largest number of Newton steps
SAME = 1e-13  # relative: smaller steps are rounding
NEAREST = 1e-12  # relative width at which a bracket is narrow enough
MOST_HALVINGS = 200
NARROW = 1e-3  # relative width of a bracket in which an eigenvalue of a late loop is followed
FARTHEST = 0.05  # largest distance inside the circle of the followed eigenvalue at the stable end


# Loops over the factor of a gain -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Line:
    """Function of a factor s that returns the matrix `still` + s `slope`."""

    still: FloatArray
    slope: FloatArray

    def __call__(self, s: float) -> FloatArray:
        return np.asarray(self.still + s * self.slope)


class PartLoop:
    """Matrix A of the motion of one part of a loop from sample to sample, as a function of the stiffness K.

    Motions that change no force are omitted. If `affine`, A is computed as A(0) + W K C with constant matrices W and C.
    """

    def __init__(self, part: Part) -> None:
        linear, self._part = part.linear, part
        m, r = linear.coordinates
        self._motions = uncoupled(linear)
        self.late = is_late(linear)
        rows = LoopRows(linear.with_arrays(stiffness=np.zeros((m, m))), self._motions, inputs=m)
        states = rows.size
        self._basis = drift_free(linear, states)
        self.affine = linear.integrator != "implicit" and not self.late
        if self.affine:
            A, W, f = rows.opened()
            C = rows.reading[:, :states].copy()
            C[:, 2 * m : 2 * m + r] -= linear.G_displacement.T
            self._still = self._without_drift(A + W @ f)
            self._W, self._C = (W, C) if self._basis is None else (self._basis.T @ W, C @ self._basis)

    def _without_drift(self, A: FloatArray) -> FloatArray:
        return A if self._basis is None else np.asarray(self._basis.T @ A @ self._basis)

    def matrices(self, stiffness: Stiffness, factors: Sequence[float]) -> FloatArray:
        """Return A with the stiffness at each factor, (factors, states, states)."""
        K = [self._part.stiffness(stiffness(s)) for s in factors]
        if self.affine:
            return np.stack([self._still + self._W @ (each @ self._C) for each in K])
        loops = [self._part.linear.with_arrays(stiffness=each) for each in K]
        return np.stack([self._without_drift(loop_matrix(each, self._motions)) for each in loops])

    def late_loop(self, stiffness: FloatArray) -> LateLoop:
        """Return the loop with a stiffness, opened at the input of the delayed reaction."""
        part = self._part
        return late_loop(part.linear.with_arrays(stiffness=part.stiffness(stiffness)), self._motions)

    def line(self, stiffness: Line) -> Line:
        """Return A as a function A_0 + s A_1 of the factor s; the part must be affine."""
        still, slope = (self._W @ (self._part.stiffness(K) @ self._C) for K in (stiffness.still, stiffness.slope))
        return Line(self._still + still, slope)


class WholeLoop:
    """Loop divided into parts that are independent for every stiffness that occurs in a search.

    Args:
        linear: Loop with its present gains.
        gains: Matrices (m, m); every stiffness that occurs is a linear combination of them. If None, the loop is not
            divided.
    """

    def __init__(self, linear: Linearisation, gains: Sequence[FloatArray] | None = None) -> None:
        self.linear = linear
        parts = [Part(linear, None)] if gains is None else parts_of(linear, gains)
        self.parts = [PartLoop(part) for part in parts]


class Family:
    """Loop whose stiffness is a function of the factor s of a gain."""

    def __init__(self, loop: WholeLoop | Linearisation, stiffness: Stiffness) -> None:
        self.loop = loop if isinstance(loop, WholeLoop) else WholeLoop(loop)
        self.stiffness = stiffness

    @property
    def late(self) -> bool:
        """Whether a part has a reaction whose delay is too long to represent each delayed sample by a state."""
        return any(part.late for part in self.loop.parts)

    @cached_property
    def lines(self) -> list[Line] | None:
        """Matrix A_0 + s A_1 of each part; None if a matrix does not have this form."""
        stiffness, parts = self.stiffness, self.loop.parts
        if not isinstance(stiffness, Line) or not all(part.affine for part in parts):
            return None
        return [part.line(stiffness) for part in parts]

    def matrices(self, factors: Sequence[float]) -> Iterator[FloatArray]:
        """Yield the matrices of each part at all factors, (factors, states, states)."""
        if self.lines is None:
            return (part.matrices(self.stiffness, factors) for part in self.loop.parts)
        s = np.asarray(factors)[:, None, None]
        return (line.still + s * line.slope for line in self.lines)

    def roots(self, factors: FloatArray) -> NDArray[np.complex128]:
        """Compute the eigenvalues of all parts at each factor, (factors, eigenvalues).

        Motions that change no force, and copies of equal parts, are omitted.
        """
        stacks = [A for A in self.matrices(factors.tolist()) if A.size]
        return np.concatenate([np.linalg.eigvals(A).astype(complex) for A in stacks], axis=1)

    def radius(self, factor: float) -> float:
        """Compute the spectral radius at a factor."""
        if self.late:
            return abs(self.farthest(factor))
        return float(np.abs(self.roots(np.array([factor]))).max(initial=0.0))

    def farthest(self, factor: float) -> complex:
        """Find an eigenvalue of largest modulus at a factor."""
        return max((self.farthest_of(part, factor) for part in self.loop.parts), key=abs, default=0j)

    def farthest_of(self, part: PartLoop, factor: float) -> complex:
        """Find an eigenvalue of largest modulus of one part at a factor."""
        if part.late:
            return farthest_root(part.late_loop(self.stiffness(factor)))
        z = np.linalg.eigvals(part.matrices(self.stiffness, [factor])[0])
        return complex(z[np.abs(z).argmax()]) if z.size else 0j

    def unstable(self, factor: float) -> bool:
        """Return whether an eigenvalue lies outside the unit circle at a factor."""
        return any(self.unstable_of(part, factor) for part in self.loop.parts)

    def unstable_of(self, part: PartLoop, factor: float) -> bool:
        """Return whether an eigenvalue of one part lies outside the unit circle at a factor.

        For a part with a long delayed reaction, only the number of eigenvalues outside the circle is computed.
        """
        if part.late:
            return roots_beyond(part.late_loop(self.stiffness(factor)), 1.0 + ROUNDING) > 0
        return abs(self.farthest_of(part, factor)) > 1.0 + ROUNDING


# The search over factors ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Reach:
    """Stability limit of a gain.

    Attributes:
        factor: Smallest factor at which the loop becomes unstable; inf if there is none, 0 if no factor is stable.
        frequency: Frequency of the oscillation at this factor [Hz]; nan if `factor` is inf or 0.
    """

    factor: float
    frequency: float


@dataclass
class _Search:
    """State of the search for the stability limit of one family.

    Attributes:
        family: Loop as a function of the factor.
        factors: Factors that have not been evaluated yet, in ascending order.
        from_below: Whether the search was restarted from the smallest factor, because the factor 1 is unstable.
        before: Largest factor found stable; None if there is none yet.
        lost: Smallest factor found unstable above `before`; None if there is none yet.
        edge: Stability limit, between `before` and `lost`; None until it is found.
        beyond: Eigenvalue of largest modulus at a factor slightly above `edge`; None until it is found.
        roots: Eigenvalue of largest modulus at each evaluated factor.
    """

    family: Family
    factors: Sequence[float] = ABOVE
    from_below: bool = False
    before: float | None = None
    lost: float | None = None
    edge: float | None = None
    beyond: complex | None = None
    roots: dict[float, complex] = field(default_factory=dict)

    def upcoming(self) -> Sequence[float]:
        """Return the factors to evaluate next; empty if the limit is bracketed or no factors remain."""
        return self.factors[: 1 if self.family.late else BATCH] if self.lost is None else ()

    def take(self, factors: Sequence[float], roots: Sequence[complex]) -> None:
        """Update the search with the eigenvalues of largest modulus at the factors that were evaluated."""
        self.factors = self.factors[len(factors) :]
        for s, z in zip(factors, roots, strict=True):
            self.roots[s] = z
            if is_stable(abs(z)):
                self.before = s
            elif self.before is not None:
                self.lost = s
                return
            elif not self.from_below:  # the present gain is unstable
                self.from_below, self.factors = True, BELOW
                return

    @property
    def bracket(self) -> tuple[float, float]:
        """Factors `before` and `lost`, between which the limit lies."""
        return self.before or 0.0, self.lost or 0.0

    @property
    def reach(self) -> Reach:
        """Result of the search."""
        if self.edge is None or self.beyond is None:
            return Reach(0.0 if self.before is None else math.inf, math.nan)
        return Reach(self.edge, abs(float(np.angle(self.beyond))) / (2 * math.pi * self.family.loop.linear.period))


def reach(linear: Linearisation | WholeLoop, stiffness: Stiffness) -> Reach:
    """Find the stability limit of a gain: the smallest factor above 1 at which the loop becomes unstable.

    If the loop is unstable at the factor 1, the search begins at the smallest stable factor of the grid instead.

    Args:
        linear: Loop with its present gains.
        stiffness: Function that returns the stiffness matrix (m, m) for a factor.
    """
    return reaches([Family(linear, stiffness)])[0]


def reaches(families: Sequence[Family]) -> list[Reach]:
    """Find the stability limit of each family (see `reach`)."""
    return [reach for [reach] in least_reaches([[family] for family in families])]


def least_reaches(groups: Sequence[Sequence[Family]]) -> list[list[Reach]]:
    """Find the smallest stability limit of each group of families.

    The result has a `Reach` for each family of each group. The search for a family ends, with the factor inf, as soon
    as another family of its group is known to have a smaller limit.
    """
    searches = [[_Search(family) for family in group] for group in groups]
    each = [search for group in searches for search in group]
    while some := [(search, factors) for search in each if (factors := search.upcoming())]:
        roots = farthest([(search.family, factors) for search, factors in some])
        for (search, factors), worst in zip(some, roots, strict=True):
            search.take(factors, worst)
        for group in searches:
            _drop_larger(group)
    _find_edges([search for search in each if search.lost is not None and not search.family.late])
    for search in each:
        if search.lost is not None and search.family.late:
            search.edge, search.beyond = _late_edge(search.family, *search.bracket)
    return [[search.reach for search in group] for group in searches]


def _drop_larger(group: Sequence[_Search]) -> None:
    """End the search of each family that is stable at a factor at which another family of the group is unstable."""
    least = min((search.lost for search in group if search.lost is not None), default=math.inf)
    for search in group:
        if search.before is not None and not search.from_below and search.before >= least:
            search.factors, search.lost = (), None


def farthest(families: Sequence[tuple[Family, Sequence[float]]]) -> list[list[complex]]:
    """Find the eigenvalue of largest modulus of each family at each of the factors given with the family.

    For a family with a long delayed reaction, the result is 0 if the family is stable and 2 if it is unstable.
    """
    stacks: defaultdict[int, list[FloatArray]] = defaultdict(list)
    places: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)
    worst: list[list[complex]] = [[0j] * len(factors) for _, factors in families]
    for k, (family, factors) in enumerate(families):
        if family.late:
            worst[k] = [2.0 + 0j if family.unstable(s) else 0j for s in factors]
            continue
        for A in family.matrices(factors):
            stacks[A.shape[-1]].append(A)
            places[A.shape[-1]] += [(k, i) for i in range(len(factors))]
    for size, matrices in stacks.items():
        if not size:
            continue
        z = np.linalg.eigvals(np.concatenate(matrices))
        far = z[np.arange(len(z)), np.abs(z).argmax(axis=1)].tolist()
        for (k, i), each in zip(places[size], far, strict=True):
            if abs(each) > abs(worst[k][i]):
                worst[k][i] = complex(each)
    return worst


# The edge between two factors ----------------------------------------------------------------------------------------


def _find_edges(searches: Sequence[_Search]) -> None:
    """Find the stability limit of the family of each search, between the factors `before` and `lost`."""
    for search in searches:
        if abs(search.roots[search.bracket[0]]) >= 1.0:
            search.edge = search.before  # the eigenvalue is on the circle, within rounding
    upper = {id(search): (search.bracket[1], search.roots[search.bracket[1]]) for search in searches}
    pending = [search for search in searches if search.edge is None]
    for _ in range(ROUNDS):
        candidates = crossings([(search.family, *upper[id(search)]) for search in pending])
        inside = [
            (search, s)
            for search, s in zip(pending, candidates, strict=True)
            if s is not None and search.bracket[0] <= s <= upper[id(search)][0]
        ]
        pending = []
        for (search, s), z in zip(inside, _just_above(inside), strict=True):
            if abs(z) <= 1.0 + ANOTHER:
                search.edge, search.beyond = s, z
            else:
                upper[id(search)] = s * (1.0 + BEYOND), z
                pending.append(search)
        if not pending:
            break
    for search in searches:
        if search.edge is None:
            radius = search.family.radius
            search.edge = bracketed(lambda s, radius=radius: radius(s) - 1.0, *search.bracket)  # type: ignore[misc]
    others = [(search, search.edge or 0.0) for search in searches if search.beyond is None]
    for (search, _), z in zip(others, _just_above(others), strict=True):
        search.beyond = z


def _just_above(searches: Sequence[tuple[_Search, float]]) -> list[complex]:
    """Find the eigenvalue of largest modulus of each search's family, at a factor slightly above the given factor."""
    return [z for (z,) in farthest([(search.family, [s * (1.0 + BEYOND)]) for search, s in searches])]


def crossings(starts: Sequence[tuple[Family, float, complex]]) -> list[float | None]:
    """Find the factor at which an eigenvalue of each family crosses the unit circle, starting from a factor near it.

    The matrix of the family must have the form A(s) = A_0 + s A_1. Newton's method is applied to log |z|. The
    eigenvalue and its derivative are z = y'A x / y'x and dz/ds = y'A_1 x / y'x, with the right eigenvector x and the
    left eigenvector y from inverse iteration.

    Args:
        starts: Family, factor s, and eigenvalue z of A(s), for each search.

    Returns:
        Factor with |z| = 1 for each search; None if A does not have this form or the iteration does not converge.
    """
    answers: list[float | None] = [None] * len(starts)
    groups: defaultdict[int, list[tuple[int, Line, float, complex]]] = defaultdict(list)
    for k, (family, s, z) in enumerate(starts):
        lines = family.lines or []
        if len(lines) > 1:  # select the part with the eigenvalue z
            distances = [np.abs(np.linalg.eigvals(line(s)) - z).min(initial=np.inf) for line in lines]
            lines = [lines[int(np.argmin(distances))]]
        for line in lines:
            groups[len(line.still)].append((k, line, s, z))
    for group in groups.values():
        for (k, *_), answer in zip(group, _newton(group), strict=True):
            answers[k] = answer
    return answers


def _newton(group: Sequence[tuple[int, Line, float, complex]]) -> list[float | None]:
    """Carry out `crossings` for matrices of equal size, given by their search, matrix, factor and eigenvalue."""
    A_0 = np.stack([line.still for _, line, _, _ in group]).astype(complex)
    A_1 = np.stack([line.slope for _, line, _, _ in group]).astype(complex)
    s, z = np.array([each[2] for each in group]), np.array([each[3] for each in group])
    f, n, _ = A_0.shape
    x = y = np.ones((f, n, 1), dtype=complex) + 0.1 * np.cos(np.arange(n))[None, :, None]
    done = np.zeros(f, dtype=bool)
    for step in range(STEPS):
        A = A_0 + s[:, None, None] * A_1
        M = A - (z * (1.0 + 1e-15j))[:, None, None] * np.eye(n)
        try:
            for _ in range(2 if step == 0 else 1):
                x, y = np.linalg.solve(M, x), np.linalg.solve(M.conj().swapaxes(1, 2), y)
                x, y = x / np.linalg.norm(x, axis=1, keepdims=True), y / np.linalg.norm(y, axis=1, keepdims=True)
        except np.linalg.LinAlgError:
            return [None] * f
        left = y.conj().swapaxes(1, 2)
        with np.errstate(all="ignore"):
            scale = (left @ x)[:, 0, 0]
            z, slope = (left @ A @ x)[:, 0, 0] / scale, (left @ A_1 @ x)[:, 0, 0] / scale
            change = -np.log(np.abs(z)) * np.abs(z) ** 2 / (z.conj() * slope).real
        if not np.isfinite(change).all():
            return [None] * f
        done = np.abs(change) <= SAME * s
        s, z = s + change, z + slope * change
        if done.all():
            break
    return [float(each) if ok else None for each, ok in zip(s, done, strict=True)]


def bracketed(function: Callable[[float], float], low: float, high: float) -> float:
    """Find a zero of a function between `low` and `high`, where its signs differ, by Chandrupatla's method (1997).

    Each step is inverse quadratic interpolation if this is safe for the last three points; otherwise it is bisection.
    """
    a, b = high, low
    f_a, f_b = function(a), function(b)
    c, f_c = a, f_a
    t = 0.5
    for _ in range(MOST_HALVINGS):
        x = a + t * (b - a)
        f_x = function(x)
        if (f_x > 0.0) == (f_a > 0.0):
            c, f_c = a, f_a
        else:
            c, b, f_c, f_b = b, a, f_b, f_a
        a, f_a = x, f_x
        best, f_best = (a, f_a) if abs(f_a) < abs(f_b) else (b, f_b)
        least = 0.5 * NEAREST * abs(best) / abs(b - a) if b != a else 1.0
        if least > 0.5 or f_best == 0.0:
            return best
        xi, phi = (a - b) / (c - b), (f_a - f_b) / (f_c - f_b) if f_c != f_b else 1.0
        if phi**2 < xi and (1.0 - phi) ** 2 < 1.0 - xi:
            t = f_a / (f_b - f_a) * f_c / (f_b - f_c) + (c - a) / (b - a) * f_a / (f_c - f_a) * f_b / (f_c - f_b)
        else:
            t = 0.5
        t = min(max(t, least), 1.0 - least)
    return best


def _late_edge(family: Family, before: float, lost: float) -> tuple[float, complex]:
    """Find the stability limit of a family with a long delayed reaction, and the eigenvalue at the limit.

    First, bisection by the number of eigenvalues outside the unit circle narrows the bracket. Then, the factor at which
    an eigenvalue near the circle crosses it is computed. This factor is the limit if the loop is stable slightly below
    it and unstable slightly above it; otherwise, bisection continues. The loop must be stable at the factor `before`
    and unstable at `lost`.
    """
    low, high = _halved(family, before, lost, NARROW)
    crossing = _followed(family, low, high)
    if crossing is not None:
        below, above = crossing[0] * (1.0 - BEYOND), crossing[0] * (1.0 + BEYOND)
        if (below <= low or not family.unstable(below)) and (above >= high or family.unstable(above)):
            return crossing
    low, high = _halved(family, low, high, NEAREST)
    return high, family.farthest(high * (1.0 + BEYOND))


def _halved(family: Family, low: float, high: float, width: float) -> tuple[float, float]:
    while high - low > width * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if family.unstable(middle) else (middle, high)
    return low, high


def _followed(family: Family, low: float, high: float) -> tuple[float, complex] | None:
    """Find a factor between `low` and `high` at which an eigenvalue crosses the unit circle, and this eigenvalue.

    The result is None if the eigenvalue cannot be followed from `high` to `low`.
    """
    part = next(part for part in family.loop.parts if family.unstable_of(part, high))
    if not part.late:
        edge = bracketed(lambda s: abs(family.farthest_of(part, s)) - 1.0, low, high)
        return edge, family.farthest_of(part, edge)
    at = root_at(part.late_loop(family.stiffness(high)), 1.0)
    if at is None or abs(at) <= 1.0:
        return None
    roots = {high: at}

    def excess(s: float) -> float:
        if s not in roots:
            start = roots[min(roots, key=lambda each: abs(each - s))]
            roots[s] = root_near(part.late_loop(family.stiffness(s)), start) or 0j
        return abs(roots[s]) - 1.0

    if not -FARTHEST <= excess(low) <= 0.0:
        return None
    edge = bracketed(excess, low, high)
    return edge, roots[edge]
