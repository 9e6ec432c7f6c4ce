"""Force closure: whether fingers that push with friction can exert every wrench, with a proof of the answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError, UnknownNameError
from graspfx.grasp.contact import MOMENTS, SELECTION
from graspfx.grasp.matrix import GraspMatrix, moments
from graspfx.grasp.quality.measures import moment_length, reference_point
from graspfx.numeric import each

FloatArray = NDArray[np.float64]
Limit = Literal["elliptic", "independent"]

FLAT = 1e-6  # smallest singular value of the cones' wrenches, relative to the largest; below it some wrench is missing
BOUNDARY = 1e-7  # an equilibrium whose evenly spread share is smaller lies on the boundary of the cones
ROUNDS = 200


class PushingWrenches:
    """Wrenches of forces in the friction cones of n contacts with normal force f_n = 1.

    Moments are divided by a length.

    | contact | forces | source |
    |---|---|---|
    | frictionless | f_t = 0 | |
    | hard | abs(f_t) <= mu f_n | Murray, Li and Sastry 1994, ch. 5 |
    | soft, elliptic | (f_t/mu)^2 + (tau/gamma)^2 <= f_n^2 | Howe and Cutkosky 1996 |
    | soft, independent | abs(f_t) <= mu f_n, abs(tau) <= gamma f_n | Murray, Li and Sastry 1994, ch. 5 |

    Args:
        grasp: Contacts with normals. Full contacts and selection matrices have no friction law and raise an error.
        friction: Coefficient mu, one for all or one per contact.
        torsion: Coefficient gamma [m] of soft contacts in space, one for all or one per contact.
        limit: Combination of the two limits of a soft contact, "elliptic" or "independent".
        length, about: As for `grasp.quality.measures.measures`.
    """

    def __init__(
        self,
        grasp: GraspMatrix,
        friction: ArrayLike,
        torsion: ArrayLike,
        limit: Limit,
        length: float | None,
        about: ArrayLike | None,
    ) -> None:
        if limit not in get_args(Limit):
            raise UnknownNameError("limit of a soft contact", str(limit), get_args(Limit))
        models, d, n = grasp.contacts.models, grasp.dimensions, grasp.fingers
        lawless = [name for name in models if name == SELECTION or (name == "full" and d > 1)]
        if lawless:
            raise InputError(
                "model",
                lawless[0],
                "frictionless, hard or soft contacts",
                f"a {lawless[0]} contact has no friction law",
            )
        if grasp.contacts.normals is None:
            raise InputError("normals", None, "a normal into the object for each contact")
        soft = np.array([name == "soft" and d == 3 for name in models])
        rough = np.array([name != "frictionless" for name in models])
        self.normals = grasp.contacts.normals  # (n, d)
        expected = f"a number that is not negative, or {n} of them, one per contact"
        self.friction = each("friction", friction, n, expected) * rough
        self.torsion = each("torsion", torsion, n, expected) * soft
        if (soft & (self.torsion == 0.0)).any():
            raise InputError(
                "torsion",
                torsion,
                "a positive length [m] for soft contacts",
                "give the largest torsion per newton of normal force",
            )
        self.elliptic, self.length = limit == "elliptic", moment_length(grasp, length)
        arms = grasp.points - reference_point(grasp, about)
        maps = np.zeros((d + MOMENTS[d], n, d + 1))  # wrench of a unit force along each world axis, and a unit torsion
        maps[:d, :, :d] = np.eye(d)[:, None, :]
        maps[d:, :, :d] = np.moveaxis(moments(arms[:, None, :], np.eye(d)), 2, 0) / self.length
        if d == 3:
            maps[3:, :, 3] = self.normals.T / self.length
        self.maps = maps[grasp.free]  # (w, n, d + 1)
        self.grasp = grasp

    def reach(self, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Find each contact's largest u.w at f_n = 1 for k directions u, (k, w), and the forces that attain it.

        The values have the shape (k, n). The forces have the shape (k, n, d + 1): components along the world's axes,
        then the torsion.
        """
        d = self.normals.shape[1]
        v = np.einsum("kw,wnc->knc", directions, self.maps)
        normal = (v[..., :d] * self.normals).sum(axis=-1)
        side = v[..., :d] - normal[..., None] * self.normals
        shear = self.friction * np.sqrt((side**2).sum(axis=-1))
        twist = self.torsion * np.abs(v[..., d])
        if self.elliptic:
            whole = np.hypot(shear, twist)
            pull, turn = self.friction**2 / _safe(whole), self.torsion**2 / _safe(whole)
        else:
            whole = shear + twist
            pull, turn = self.friction**2 / _safe(shear), self.torsion**2 / _safe(twist)
        forces = np.concatenate([self.normals + pull[..., None] * side, (turn * v[..., d])[..., None]], axis=-1)
        return normal + whole, forces

    def wrenches(self, forces: FloatArray) -> FloatArray:
        """Compute the wrench of each contact, (k, n, w), for forces (k, n, d + 1)."""
        return np.asarray(np.einsum("wnc,knc->knw", self.maps, forces))

    def components(self, forces: FloatArray) -> FloatArray:
        """Express forces (n, d + 1) in the grasp's components (m,)."""
        contacts = self.grasp.contacts
        own = forces[contacts.finger]
        f = (contacts.force_axes * own[:, :-1]).sum(axis=1)
        f[contacts.moment] = own[contacts.moment, -1]
        return np.asarray(f)


@dataclass(frozen=True, eq=False)
class ForceClosure:
    """Whether pushing contacts can exert every wrench, with the proof.

    Attributes:
        closed: Whether it is proved that the contacts can exert every wrench.
        squeeze: Primal proof if `closed`, otherwise None: contact forces (m,) with zero wrench that lie strictly inside
            their cones and whose normal forces sum to 1 N.
        separating: Dual proof against closure: a wrench direction u (w,), forces before moments divided by the length,
            with u.w <= 0 for every wrench w of the contacts. None if `closed`, or if 200 rounds prove neither answer.
        share: Fraction of the squeeze that can be spread evenly over the cones, in (0, 1]; 0 if not closed.
    """

    closed: bool
    squeeze: FloatArray | None
    separating: FloatArray | None
    share: float

    def __bool__(self) -> bool:
        return self.closed


def force_closure(
    grasp: GraspMatrix,
    friction: ArrayLike = 0.0,
    torsion: ArrayLike = 0.0,
    *,
    limit: Limit = "elliptic",
    length: float | None = None,
    about: ArrayLike | None = None,
) -> ForceClosure:
    """Test force closure: G(C) is the whole wrench space, where C is the product of the friction cones.

    Equivalently, G is onto and some f in the interior of C has G f = 0 (Murray, Li and Sastry 1994, prop. 5.3;
    Prattichizzo and Trinkle 2016). The test solves two linear programs over wrenches g_j of forces in the cones, of
    which the first p are spread evenly over each cone:

        max t,  sum_j a_j g_j = 0,  sum_j a_j <= 1,  a_j >= t/p for j <= p, else a_j >= 0,
        max r,  g_j.u + r |g_j| <= 0,  |u_k| <= 1.

    A solution t > 0 proves closure by forces in the true cones. Otherwise u, the centre of the directions that separate
    the g_j, is tested in closed form against the cones themselves. If u.w <= 0 for every wrench w of the cones, u
    disproves closure. Otherwise the most violating wrenches are added to the g_j and the test is repeated, usually a
    few times (Elzinga and Moore 1975). Both answers therefore hold for second-order cones without linearisation. A
    grasp within 1e-7 of the boundary counts as not closed. The answer does not depend on scale, reference point or
    units.

    A contact with friction 0 pushes only along its normal. For two contacts (hard in the plane, soft in space) the test
    reduces to Nguyen's rule (1988): the line between them lies inside both cones.

    Args:
        grasp, friction, torsion, limit, length, about: As for `PushingWrenches`.

    Raises:
        InputError: If a contact is full or a selection, normals are missing, or coefficients are negative or missing.
        UnknownNameError: If the limit is unknown.
    """
    cones = PushingWrenches(grasp, friction, torsion, limit, length, about)
    return closure_of(cones)[0]


def closure_of(cones: PushingWrenches) -> tuple[ForceClosure, FloatArray]:
    """Test force closure; return the answer and the wrenches (k, w) that the test used."""
    from scipy.optimize import linprog

    w = len(cones.maps)
    if w == 0:
        push = np.hstack([cones.normals, np.zeros((len(cones.normals), 1))]) / len(cones.normals)
        return ForceClosure(True, cones.components(push), None, 1.0), np.zeros((0, 0))
    start = np.vstack([np.eye(w), -np.eye(w)])
    forces = cones.reach(start)[1]
    n = forces.shape[1]
    contact = np.tile(np.arange(n), len(start))
    generators = cones.wrenches(forces).reshape(-1, w)
    forces = forces.reshape(-1, forces.shape[2])
    p = len(generators)
    U, values, _ = np.linalg.svd(generators.T)
    if len(values) < w or values[-1] <= FLAT * values[0]:
        return ForceClosure(False, None, U[:, -1], 0.0), generators

    for _ in range(ROUNDS):
        even = generators[:p].mean(axis=0)
        columns = np.vstack([generators, even])
        cost = np.zeros(len(columns))
        cost[-1] = -1.0
        solution = linprog(cost, A_ub=np.ones((1, len(columns))), b_ub=[1.0], A_eq=columns.T, b_eq=np.zeros(w))
        if solution.status != 0:
            raise InputError("points, normals", solution.message, "contacts whose linear program can be solved")
        x, share = np.asarray(solution.x), float(np.asarray(solution.x)[-1])
        if share > BOUNDARY:
            weights = x[:-1].copy()
            weights[:p] += share / p
            # subtract the wrench that the solver's rounding leaves
            weights[:p] -= np.linalg.lstsq(generators[:p].T, generators.T @ weights, rcond=None)[0]
            total = np.zeros((n, forces.shape[1]))
            np.add.at(total, contact, weights[:, None] * forces)
            return ForceClosure(True, cones.components(total), None, share), generators
        # centre of all separating directions; a corner of their set usually violates the curved sides of the cones
        slack = np.column_stack([generators, np.sqrt((generators**2).sum(axis=1))])
        middle = linprog(
            -np.eye(w + 1)[w], A_ub=slack, b_ub=np.zeros(len(slack)), bounds=[(-1.0, 1.0)] * w + [(0.0, None)]
        )
        u = np.asarray(middle.x)[:w]
        if not u.any():
            u = np.asarray(solution.eqlin.marginals)
        u = u / np.linalg.norm(u)
        heights, worst = cones.reach(u[None])
        if heights.max() <= BOUNDARY:
            return ForceClosure(False, None, u, 0.0), generators
        beyond = np.flatnonzero(heights[0] > 0.0)
        generators = np.vstack([generators, cones.wrenches(worst)[0, beyond]])
        forces = np.vstack([forces, worst[0, beyond]])
        contact = np.append(contact, beyond)
    return ForceClosure(False, None, None, 0.0), generators


def _safe(x: FloatArray) -> FloatArray:
    """Replace zero divisors by 1; their dividends are also zero."""
    return np.where(x > 0.0, x, 1.0)
