"""Grasped object with its fingers: derivatives of contact forces, friction cones, and the ground under the object."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.grasp_stiffness import ROWS, cross, released
from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.loop import radius_of
from graspfx.assembly import bodies
from graspfx.assembly.resolve import Parts
from graspfx.compile.records import numbers, start_of
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.loop.engine import is_machine_code, program
from graspfx.objects import integrators as body
from graspfx.objects.body import FREEDOMS
from graspfx.objects.body_state import BodyState
from graspfx.objects.floor.floor import FLAT_KINDS, FloorBody
from graspfx.objects.floor.planes import FloorState, PlaneContact
from graspfx.objects.floor.rest import meet
from graspfx.objects.surroundings import Meeting, Member
from graspfx.scene.model import Scene
from graspfx.spatial import Vector, exponential, quaternion_matrix

FloatArray = NDArray[np.float64]

ROUGH = 1e3  # factor on the coefficient of friction of a frozen contact
RATE = 1e-5  # step of a difference quotient of angular velocity [rad/s]
SHIFT = 2e-6  # step of a difference quotient [m]; for a radius of 25 mm its error is 1e-9, and rounding adds 1e-10
EDGE = 1e-3  # relative: a contact this close to the largest friction is on the cone's edge
ALL_SETS = 5  # with more contacts on the edge, only each contact alone and all contacts together are examined
GROWTH = 1e-9  # excess of a spectral radius over 1 that is not rounding
LOW = 2e-5  # largest gap of an object that stands [m]; scenes start objects up to 10 um inside or above the floor


@dataclass
class Grip:
    """Grasped object with its fingers, whose forces can be computed after small displacements.

    A displacement y (m + r,) consists of the displacements of the fingers in world axes, m = n d [m], and of the
    displacements of the object in its r free degrees of freedom: translations [m], then rotations [rad].
    """

    grasped: GraspedObject
    free: NDArray[np.bool_]

    def __post_init__(self) -> None:
        g = self.grasped
        self.n, self.d = g.fingers, g.dimensions
        self.m = self.n * self.d
        self.axes = np.array(FREEDOMS[self.d])[self.free]
        self.r = len(self.axes)
        self.rows_of_wrench = np.flatnonzero(self.free)
        mesh = int(g.block[start_of(GraspState, "mesh")])
        self._sample = compiled_sample(g)
        self.changing = g.block[: mesh or None]  # entries that a sample may change; the mesh at the end is only read

    def forces(self) -> FloatArray | None:
        """Compute a sample: forces on the object (m,), then free components of its wrench (r,); None after a fault."""
        if self._sample():
            return None
        return np.concatenate([self.grasped.force.ravel(), self.grasped.wrench[self.rows_of_wrench]])

    def move(self, y: FloatArray) -> None:
        """Displace the fingers and the object by y (m + r,)."""
        g, S = self.grasped, self.grasped.body_state
        g.finger_position += y[: self.m].reshape(self.n, self.d)
        shift = np.zeros(6)
        shift[self.axes] = y[self.m :]
        S[body.POSITION : body.POSITION + 3] += shift[:3]
        if shift[3:].any():
            R = S[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
            turn = quaternion_matrix(exponential(Vector(*shift[3:].tolist())))
            R[:] = np.array(list(numbers(turn))).reshape(3, 3) @ R

    def tried(self, y: FloatArray) -> FloatArray | None:
        """Compute `forces` after a displacement y (m + r,), and restore the state before the displacement."""
        before = self.changing.copy()
        self.move(y)
        forces = self.forces()
        self.changing[:] = before
        return forces

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """Increase all coefficients of friction within a block, so that contacts with friction do not slide."""
        mu = self.grasped.array(FingerState.coefficient)
        coefficients = mu.copy()
        mu *= ROUGH
        try:
            yield
        finally:
            mu[:] = coefficients

    def stiffness(self, lengths: FloatArray, *, both: bool = True) -> FloatArray | None:
        """Compute the derivative of `forces` by a displacement (m + r, m + r), by difference quotients.

        The result is None if a sample has a fault.

        Args:
            lengths: Step of the difference quotient in each coordinate, (m + r,).
            both: Whether difference quotients are central instead of one-sided.
        """
        size = self.m + self.r
        J = np.zeros((size, size))
        here = None if both else self.tried(np.zeros(size))
        for i in range(size):
            y = np.zeros(size)
            y[i] = lengths[i]
            forward = self.tried(y)
            behind = self.tried(-y) if both else here
            if forward is None or behind is None:
                return None
            J[:, i] = (forward - behind) / (2 * lengths[i] if both else lengths[i])
        return J

    def turning_damping(self) -> FloatArray:
        """Compute minus the derivative of the wrench with respect to the object's angular velocity, (r, r).

        The result includes the damping of the torsion of soft fingers. Its columns for translations are zero.
        """
        B = np.zeros((self.r, self.r))
        for i, axis in enumerate(self.axes):
            before = self.changing.copy()
            if axis >= 3:
                columns = []
                for rate in (RATE, -RATE):
                    self.changing[:] = before
                    self.grasped.body_state[body.ANGULAR_VELOCITY + axis - 3] = rate
                    now = self.forces()
                    columns.append(np.zeros(self.m + self.r) if now is None else now)
                B[:, i] = (columns[1] - columns[0])[self.m :] / (2 * RATE)
            self.changing[:] = before
        return B

    def wrenches(self, arms: FloatArray) -> FloatArray:
        """Compute the grasp matrix G (r, m): from forces to the wrench in the object's free degrees of freedom.

        Args:
            arms: Points at which the forces act, relative to the object's centre, (n, d) [m].
        """
        wide = np.zeros((self.n, 3))
        wide[:, : self.d] = arms
        full = np.hstack([np.vstack([np.eye(3), cross(arm)])[:, : self.d] for arm in wide])
        return np.asarray(full[np.array(ROWS[self.d])[self.free]])

    def inertia(self) -> FloatArray:
        """Compute the inertia matrix of the object in its free degrees of freedom, (r, r)."""
        state, full = self.grasped.body_state, np.zeros((6, 6))
        R = state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
        full[:3, :3] = state[body.MASS] * np.eye(3)
        full[3:, 3:] = R @ np.diag(state[body.INERTIA : body.INERTIA + 3]) @ R.T
        return np.asarray(full[np.ix_(self.axes, self.axes)])

    def lengths(self) -> FloatArray:
        """Return steps of difference quotients (m + r,), each of which moves no fingertip by more than `SHIFT`."""
        g = self.grasped
        arms = g.finger_position - g.body_state[body.POSITION : body.POSITION + self.d]
        far = max(float(np.linalg.norm(arms, axis=1).max(initial=0.0)), 1e-3)
        turning = self.axes >= 3
        return np.concatenate([np.full(self.m, SHIFT), np.where(turning, SHIFT / far, SHIFT)])


def compiled_sample(grasped: GraspedObject) -> Callable[[], int]:
    """Return `GraspedObject.sample` as machine code, about a hundred times faster and with identical results.

    If machine code is not available, the method itself is returned.
    """
    if not is_machine_code():
        return grasped.sample
    return partial(program().bind(grasped.block, np.empty(1)).brief, 0, 0, -1, 0)


# Friction cones ------------------------------------------------------------------------------------------------------


def grip_margins(grasped: GraspedObject) -> FloatArray:
    """Compute the ratio f_t/(mu f_n) of the last elastic force of each finger, (n,).

    f_n is the normal force, f_t the tangential force, and mu the coefficient of friction. The ratio is 1 on the edge of
    the friction cone, and nan if mu or f_n is not positive. For a soft finger, f_t includes the torsion tau divided by
    the radius rho of the contact patch: sqrt(f_t^2 + (tau/rho)^2).
    """
    margins = np.full(grasped.fingers, np.nan)
    for i, (normal, tangent) in enumerate(_forces(grasped)):
        mu = grasped.array(FingerState.coefficient)[i]
        if mu > 0.0 and normal > 0.0:
            torsion = grasped.array(FingerState.local)[i, 3]
            margins[i] = float(np.hypot(np.linalg.norm(tangent), torsion)) / (mu * normal)
    return margins


def edge_directions(grasped: GraspedObject, fingers: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Compute the directions of sliding T, and the normals V of the friction cones, for contacts on their cones' edges.

    A column of T is the unit vector t along a finger's tangential force. The corresponding column v of V gives
    v'f = f_t - mu f_n for contact forces f (n d,), which remains zero while the contact slides along t.

    Args:
        grasped: Object with its fingers, after a sample.
        fingers: Indices of the fingers among those of the object.

    Returns:
        T and V in world axes, (n d, fingers) each.
    """
    n, d = grasped.fingers, grasped.dimensions
    R = grasped.body_state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
    forces = list(_forces(grasped))
    T, V = np.zeros((n * d, len(fingers))), np.zeros((n * d, len(fingers)))
    for column, i in enumerate(fingers):
        tangent = forces[i][1]
        t = tangent / max(float(np.linalg.norm(tangent)), 1e-300)
        x = slice(i * d, i * d + d)
        T[x, column] = (R @ t)[:d]
        normal = grasped.array(FingerState.normal)[i]
        V[x, column] = (R @ (t - grasped.array(FingerState.coefficient)[i] * normal))[:d]
    return T, V


def _forces(grasped: GraspedObject) -> Iterator[tuple[float, FloatArray]]:
    """Yield the normal force of each finger, and its tangential force in the object's axes (3,)."""
    local = grasped.array(FingerState.local)
    for normal, force in zip(grasped.array(FingerState.normal), local[:, :3].copy(), strict=True):
        force[grasped.dimensions :] = 0.0
        along = float(normal @ force)
        yield along, force - along * normal


def sliding_notes(
    linear: Linearisation, T: FloatArray, V: FloatArray, names: Sequence[str]
) -> Iterator[str]:  # fmt: skip
    """Yield notes about contacts on the edges of their friction cones whose sliding would be unstable.

    The result is not used as a stability limit, because a grasp is often stable even if its contacts would be unstable
    while they slide.

    Args:
        linear: Loop in equilibrium, with sticking contacts.
        T, V: Directions from `edge_directions` in the coordinates of the loop, (m, contacts).
        names: Name of the finger of each contact.
    """
    count = len(names)
    sizes = range(1, count + 1) if count <= ALL_SETS else (1, count)
    for size in sizes:
        for sliders in combinations(range(count), size):
            some, of = list(sliders), ", ".join(names[i] for i in sliders)
            t, v = T[:, some], V[:, some]
            K = released(linear.stiffness, t, v)
            if K is None:
                yield f"if {of} slid, Coulomb's law would have no solution (det V'K T <= 0), and forces could jump"
                continue
            D = released(linear.damping, t, v) if linear.damping.any() else linear.damping
            radius = radius_of(linear.with_changes(stiffness=K, damping=linear.damping if D is None else D))
            if radius > 1.0 + GROWTH:
                yield f"if {of} slid, oscillations would grow during the sliding, spectral radius {radius:.6f}"


# Ground --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Ground:
    """Obstacles on which an object stands.

    Attributes:
        names: Names of the obstacles.
        stiffness, damping: Stiffness and damping matrix of the contacts with the obstacles, in the object's free
            degrees of freedom, (r, r). All contact points stick.
        points: Number of contact points.
    """

    names: tuple[str, ...]
    stiffness: FloatArray
    damping: FloatArray
    points: int


def ground_under(parts: Parts, index: int, grip: Grip, *, lower: float = 0.0) -> Ground | None:
    """Return the ground under an object; None if no half-space or plane supports the object.

    The stiffness matrix is K_g = sum c k J'J over the supporting points. J (d, r) is the Jacobian of the point's
    position, k the contact stiffness of the world, and c the share of k that belongs to the point. The damping matrix
    is the same sum with b = 2 sqrt(k m) instead of k, where m is the mass of the object. The result is also None if the
    object is not native, or an obstacle is neither a half-space nor a plane.

    Args:
        parts: Parts of the scene.
        index: Index of the object.
        grip: Object with its fingers.
        lower: Distance by which the object is moved along gravity before contacts are searched [m].
    """
    scene, part, obstacles = parts.scene, parts.objects[index], parts.obstacles
    table, d = part.table, scene.dimensions
    if table.dynamics != "native" or table.shape is None or not scene.obstacle:
        return None
    if any(obstacle.shape.kind not in FLAT_KINDS for obstacle in obstacles):
        return None
    state = grip.grasped.body_state.copy()
    if lower:
        if scene.gravity is None or not any(scene.gravity):
            return None
        state[body.POSITION : body.POSITION + d] += lower * np.array(scene.gravity) / np.linalg.norm(scene.gravity)
    world = scene.world
    meeting = Meeting(world.friction, 0.0, world.stiffness)
    floor = FloorBody(Member(state, part.solid.shape), obstacles, meeting)
    block, names = FloorState(floor.buffer), []
    K, B = np.zeros((grip.r, grip.r)), np.zeros((grip.r, grip.r))
    points = 0
    for i in range(meet(BodyState(state), block, 0.0)):
        contact = block.contacts[i]
        if contact.gap >= 0.0:
            continue
        arm = contact.array(PlaneContact.arm)
        J = np.hstack([np.eye(3), -cross(arm)])[:d, grip.axes]
        share = contact.share * J.T @ J
        K += block.stiffness * share
        B += block.damping * share
        points += 1
        names.append(obstacles[contact.plane].name)
    return Ground(tuple(dict.fromkeys(names)), K, B, points) if points else None


def bearers(scene: Scene, index: int) -> Iterator[str]:
    """Yield the names of obstacles and of other objects that could support an object in addition to its fingers."""
    table = scene.object[index]
    if table.shape is None:
        return
    yield from (obstacle.name for obstacle in scene.obstacle)
    for group in bodies.groups(scene):
        if index in group and bodies.in_world(scene, group) and bodies.collide(scene):
            yield from (scene.object[i].name for i in group if i != index)
