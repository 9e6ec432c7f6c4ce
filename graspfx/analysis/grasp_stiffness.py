"""Stiffness of a grasp: preload, compliances in series, subsets of touching fingers, and symmetries."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.checked_arguments import numbers, one_of
from graspfx.analysis.linearisation import Linearisation, Subject, linear_of
from graspfx.errors import InputError
from graspfx.numeric import finite

FloatArray = NDArray[np.float64]

ROWS = {1: [0], 2: [0, 1, 5], 3: [0, 1, 2, 3, 4, 5]}  # rows of force and moment in space, by dimension
DEFINITE = 1e-4  # relative to the largest pivot of Cholesky's factor: smallest pivot of a well-conditioned matrix
MOST_FINGERS = 5  # largest number of fingers for which all exchanges are tested
SAME = 1e-10  # smaller relative changes of the matrices are ignored: the grasp is symmetric


@dataclass(frozen=True, eq=False)
class Preload:
    """Arguments `G`, `G_displacement` and `preload` of `Linearisation` for a grasp with forces at equilibrium."""

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
    """Linearise the geometry of point fingers that squeeze an object with forces f_0, for small motions.

    The fingertips p move by dp, and the object, with centre x_o, moves by u and rotates by theta. The stiffness K and
    the contact points are fixed in the object's frame. With y = p - x_o and c from the centre to the contact point, the
    displacement e of a fingertip, its force f and the moment of all forces on the object change by

        de = dp - u - theta x y,    df = theta x f_0 + K de,    d moment = sum dy x f_0 + y x df        (fingertip)
                                                                d moment = theta x sum c x f_0 + c x K de  (contact)

    Squeezing therefore changes the stiffness of rotations. For two fingers in the plane at distances r from the centre,
    squeezed by d each, this stiffness is 2 k_ep r^2 [(1 - d/r)^2 + (k_ip/k_ep)(d/r)(1 - d/r)] with reactions at the
    fingertips and external and internal stiffnesses k_ep and k_ip.

    Args:
        contacts: Contact points in world axes, (n, d) [m].
        displacement: Displacements of the fingertips from the contact points at equilibrium, (n, d) [m].
        force: Forces f_0 of the fingers on the object at equilibrium, (n, d) [N].
        centre: Object's centre of mass, (d,) [m]; zero if None.
        free: Mask of the object's degrees of freedom that can move, (1,), (3,) or (6,) for d = 1, 2 or 3; all if None.
        reaction: Point where a force acts on the object: "fingertip" or "contact".
    """
    c = numbers("contacts", contacts, "m", negative=True)
    if c.ndim != 2 or c.shape[1] not in ROWS:
        raise InputError("contacts", c, "points (n, d), d = 1, 2 or 3 [m]")
    n, d = c.shape
    e, f = (numbers(name, vector, unit, negative=True) for name, vector, unit in (
        ("displacement", displacement, "m"), ("force", force, "N")))  # fmt: skip
    for name, vector in (("displacement", e), ("force", f)):
        if vector.shape != c.shape:
            raise InputError(name, vector, f"an array of shape {c.shape}, like the contacts")
    o = np.zeros(d) if centre is None else numbers("centre", centre, "m", negative=True)
    if o.shape != (d,):
        raise InputError("centre", o, f"a point of {d} coordinates")
    rows = np.array(ROWS[d])
    moves = np.ones(len(rows), dtype=bool) if free is None else finite("free", free) != 0.0
    if moves.shape != rows.shape:
        raise InputError("free", free, f"{len(rows)} truth values, for translations and then rotations")
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
    """Return the (3, 3) matrix whose product with a vector b is the cross product a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def pushing(
    subject: Subject, fingers: ArrayLike, *, released: ArrayLike | None = None
) -> Iterator[tuple[tuple[int, ...], Linearisation]]:
    """Yield the linearised loop of the whole object for each subset of fingers that may touch the object.

    Coordinates b of fingers that do not touch carry no force: on the touching coordinates a, the stiffness K becomes
    K_aa - K_ab K_bb^+ K_ba, where ^+ is the pseudoinverse, and the damping changes in the same way. If one of two
    fingers on a line touches, its stiffness is 2 kep kip/(kep + kip) (Kawai and Yoshikawa, eq. 26). The loop omits the
    preload and the devices of fingers that do not touch.

    Args:
        subject: Grasp that all fingers touch: a `Linearisation`, a scene, or the name or path of a scene.
        fingers: Index of the finger of each device coordinate, (m,).
        released: Mask of the coordinates that never carry force (tangents of frictionless contacts), (m,); none if
            None.

    Yields:
        Tuple of the touching fingers' indices and the `Linearisation`, in order of the number of fingers. The set of
        all fingers is included only if `released` selects a coordinate.
    """
    linear = linear_of(subject)
    m, _ = linear.coordinates
    pushers = np.asarray(fingers)
    loose = np.zeros(m, dtype=bool) if released is None else np.asarray(released, dtype=bool)
    if pushers.shape != (m,) or loose.shape != (m,):
        raise InputError("fingers", fingers, f"{m} finger indices, and a mask `released` of this length")
    names = sorted(set(pushers.tolist()))
    for size in range(1, len(names) + bool(loose.any())):
        for touching in combinations(names, size):
            yield touching, without_freedoms(linear, np.isin(pushers, touching) & ~loose)


def without_freedoms(linear: Linearisation, a: NDArray[np.bool_]) -> Linearisation:
    """Restrict a loop without preload to the device coordinates of mask `a` (m,); others carry no force."""
    block = np.ix_(a, a)
    G = linear.G[:, a]
    return linear.with_arrays(
        mass=linear.mass[a],
        friction=linear.friction[a],
        G=G,
        stiffness=condensed(linear.stiffness, a),
        damping=condensed(linear.damping, a),
        hand_stiffness=linear.hand_stiffness[block],
        hand_damping=linear.hand_damping[block],
        delay=linear.delay[a],
        lateness=linear.lateness[a],
        age=linear.age[a],
        preload=None,
        G_displacement=G,
        G_contact=None,
        operator=None if linear.operator is None else linear.operator.selected(a),
    )


def condensed(K: FloatArray, without_freedoms: NDArray[np.bool_]) -> FloatArray:
    """Compute K_aa - K_ab K_bb^+ K_ba, with a the coordinates of the mask and b the others, which carry no force."""
    a, b = without_freedoms, ~without_freedoms
    K_ab, K_ba = K[np.ix_(a, b)], K[np.ix_(b, a)]
    if not K_ab.any() or not K_ba.any():
        return K[np.ix_(a, a)]
    return np.asarray(K[np.ix_(a, a)] - K_ab @ _solution(K[np.ix_(b, b)], K_ba))


def _solution(A: FloatArray, B: FloatArray) -> FloatArray:
    """Compute A^+ B with the pseudoinverse A^+, or A^-1 B if A is positive definite and well conditioned."""
    if (A == A.T).all():
        try:
            pivots = np.diag(np.linalg.cholesky(A))
        except np.linalg.LinAlgError:
            pivots = np.zeros(1)
        if pivots.min() > DEFINITE * pivots.max():
            return np.asarray(np.linalg.solve(A, B))
    return np.asarray(np.linalg.pinv(A) @ B)


def in_series(damping: FloatArray, compliance: ArrayLike) -> FloatArray:
    """Put a damper of compliance C in series with each coordinate: D_s = (D^-1 + C)^-1, also for a singular D.

    Args:
        damping: Damping D, (m, m) [N s/m].
        compliance: Diagonal of C, (m,) [m/(N s)]; a coordinate with an infinite entry carries no force.

    Returns:
        Matrix D_s, (m, m) [N s/m]; D itself for C = 0.
    """
    C = np.asarray(compliance, dtype=float)
    if not C.any():
        return damping
    carries = np.isfinite(C)
    block = np.ix_(carries, carries)
    D = condensed(damping, carries)
    result = np.zeros_like(damping)
    result[block] = np.linalg.solve(np.eye(len(D)) + D * C[carries], D)  # (I + D C)^-1 D
    return result


def springs_in_series(stiffness: FloatArray, directions: FloatArray, springs: ArrayLike) -> FloatArray:
    """Put springs s_i in series along unit vectors n_i: K_s = (K^-1 + sum_i n_i n_i'/s_i)^-1, also for a singular K.

    Args:
        stiffness: Stiffness K, (m, m) [N/m].
        directions: Matrix N with columns n_i, (m, p).
        springs: Stiffnesses s_i, the diagonal of S, (p,) [N/m]; K_s has no stiffness along n_i if s_i is zero.

    Returns:
        Matrix K_s = K - K N (S + N'K N)^-1 N'K, (m, m) [N/m].
    """
    N, S = directions, np.asarray(springs, dtype=float)
    along = N.T @ stiffness
    return np.asarray(stiffness - stiffness @ N @ np.linalg.lstsq(np.diag(S) + along @ N, along, rcond=None)[0])


def released(K: FloatArray, T: FloatArray, V: FloatArray) -> FloatArray | None:
    """Compute K_s = K - K T (V'K T)^-1 V'K, the stiffness while contacts slide; None if det(V'K T) <= 0.

    Columns of T are the sliding directions, and columns of V the conditions on the force (`edge_directions`).
    """
    inner = V.T @ K @ T
    if np.linalg.det(inner / max(float(np.abs(inner).max(initial=0.0)), 1e-300)) <= 0.0:
        return None
    return np.asarray(K - K @ T @ np.linalg.solve(inner, V.T @ K))


def symmetries(linear: Linearisation, contacts: ArrayLike, free: ArrayLike) -> list[tuple[int, ...]]:
    """List the exchanges of fingers under which a loop without preload does not change, the identity first.

    An exchange is a tuple p in which finger i moves to the position of finger p[i]. Let Q be the orthogonal matrix that
    maps the contact points to their new positions, V the block matrix with Q in block (p[i], i), and W = diag(Q, det(Q)
    Q) the action of Q on the object's translations and rotations. The loop does not change if V A V' = A for each
    matrix A of devices, hands and gains, W G V' = G, and W M W' = M for inertia and viscosity. Two sets of fingers have
    equal stability limits if an exchange in the list maps one set to the other.

    Args:
        linear: Loop whose device coordinates are those of the fingers in order, in world axes.
        contacts: Contact points, (n, d) [m].
        free: Mask of the object's degrees of freedom that move, (1,), (3,) or (6,).
    """
    points = np.asarray(contacts, dtype=float)
    n, d = points.shape
    identity = tuple(range(n))
    if linear.operator is not None and not linear.operator.alike:
        return [identity]
    if n > MOST_FINGERS or linear.G.shape[1] != n * d or linear.ground is not None:
        return [identity]
    X = points - points.mean(axis=0)
    size = max(float(np.abs(X).max()), 1e-300)
    others = list(permutations(range(n)))[1:]
    Y = X[np.array(others).reshape(-1, n)]  # positions of the fingers after each exchange
    if not others:
        return [identity]
    left, _, right = np.linalg.svd(np.einsum("ni,pnj->pij", X, Y))
    answers = [identity]
    for exchange, U, Vt, target in zip(others, left, right, Y, strict=True):
        for sign in (1.0, -1.0):
            flip = np.ones(d)
            flip[-1] = sign
            Q = (Vt.T * flip) @ U.T
            if np.abs(X @ Q.T - target).max() <= SAME * size and _is_symmetry(linear, Q, exchange, np.asarray(free)):
                answers.append(exchange)
                break
    return answers


def _is_symmetry(linear: Linearisation, Q: FloatArray, exchange: tuple[int, ...], free: NDArray[np.bool_]) -> bool:
    """Return whether the loop's matrices do not change in an exchange of fingers with the rotation Q (`symmetries`)."""
    d, n = len(Q), len(exchange)
    V = np.zeros((n * d, n * d))
    for i, k in enumerate(exchange):
        V[k * d : k * d + d, i * d : i * d + d] = Q
    W = _object_map(Q)
    if W[np.ix_(free, ~free)].any() and np.abs(W[np.ix_(free, ~free)]).max() > SAME:
        return False
    W = W[np.ix_(free, free)]
    delay = linear.delay * linear.period + linear.lateness
    devices = [linear.stiffness, linear.damping, linear.hand_stiffness, linear.hand_damping]
    if linear.operator is not None:
        devices += [A for A in (*linear.operator.springs, *linear.operator.ratios) if A.size]
    devices += [np.diag(each) for each in (linear.mass, linear.friction, delay, linear.age)]
    objects = [linear.inertia, linear.viscosity]
    pairs = [(V @ A @ V.T, A) for A in devices] + [(W @ A @ W.T, A) for A in objects] + [(W @ linear.G @ V.T, linear.G)]
    return all(np.abs(A - B).max(initial=0.0) <= SAME * np.abs(B).max(initial=0.0) for A, B in pairs)


def _object_map(Q: FloatArray) -> FloatArray:
    """Return the action diag(Q, det(Q) Q) of Q on the object's translations and rotations, (1, 1), (3, 3) or (6, 6)."""
    d, turned = len(Q), float(np.linalg.det(Q))
    W = np.zeros(((1, 3, 6)[d - 1],) * 2)
    W[:d, :d] = Q
    if d == 2:
        W[2, 2] = turned
    elif d == 3:
        W[3:, 3:] = turned * Q
    return W


def alike_sets(sets: list[tuple[int, ...]], exchanges: list[tuple[int, ...]]) -> list[int]:
    """Return, for each set of finger indices, the index in `sets` of the first set that an exchange maps to it."""
    first: dict[tuple[int, ...], int] = {}
    for k, each in enumerate(sets):
        for exchange in exchanges:
            first.setdefault(tuple(sorted(exchange[i] for i in each)), k)
    return [first[tuple(sorted(each))] for each in sets]
