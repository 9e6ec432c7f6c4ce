"""One grasped object with its fingers: how its forces change about where it is, friction cones, and the ground."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.grasp_stiffness import ROWS, cross, released
from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.loop import radius_of
from graspfx.assembly import bodies
from graspfx.assembly.resolve import Parts
from graspfx.compile.records import numbers, start_of
from graspfx.coupling import block as at
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.loop.engine import program
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

ROUGH = 1e3  # times its coefficient: that of a frozen contact
RATE = 1e-5  # of a difference quotient [rad/s]
SHIFT = 2e-6  # of a difference quotient [m]: 1e-9 of a radius of 25 mm, squared, and 1e-10 in rounding
EDGE = 1e-3  # of the largest friction: what a contact on the cone's edge may lack of it
ALL_SETS = 5  # contacts on the edge up to which every set of them may slide; of more, single ones and all
GROWTH = 1e-9  # above 1: a spectral radius that is no rounding
LOW = 2e-5  # [m]: an object of a scene starts up to 10 um inside its floor, or as far above it


@dataclass
class Grip:
    """One grasped object with its fingers, as one coordinate vector y = (fingers n d, object's free freedoms r).

    Fingers in world axes [m]; the object by shifts [m] and turns [rad] from where it is.
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
        self.changing = g.block[: mesh or None]  # all that a sample changes: a mesh, which stands last, is only read

    def forces(self) -> FloatArray | None:
        """Compute (f on the object, wrench on its free freedoms) of one sample here, (m + r,); None if it faults."""
        if self._sample():
            return None
        return np.concatenate([self.grasped.force.ravel(), self.grasped.wrench[self.rows_of_wrench]])

    def move(self, y: FloatArray) -> None:
        """Move fingers and object by y from where they are."""
        g, S = self.grasped, self.grasped.block
        g.finger_position += y[: self.m].reshape(self.n, self.d)
        shift = np.zeros(6)
        shift[self.axes] = y[self.m :]
        o = at.BODY
        S[o + body.POSITION : o + body.POSITION + 3] += shift[:3]
        if shift[3:].any():
            R = S[o + body.ROTATION : o + body.ROTATION + 9].reshape(3, 3)
            turn = quaternion_matrix(exponential(Vector(*shift[3:].tolist())))
            R[:] = np.array(list(numbers(turn))).reshape(3, 3) @ R

    def tried(self, y: FloatArray) -> FloatArray | None:
        """Compute `forces` after a motion y, from which nothing remains."""
        before = self.changing.copy()
        self.move(y)
        forces = self.forces()
        self.changing[:] = before
        return forces

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """Make touching contacts stick where they are, also on their cones' edges; those without friction slip on."""
        mu = self.grasped.rows[:, at.COEFFICIENT]
        coefficients = mu.copy()
        mu *= ROUGH
        try:
            yield
        finally:
            mu[:] = coefficients

    def stiffness(self, lengths: FloatArray, *, both: bool = True) -> FloatArray | None:
        """Compute d(f, wrench)/dy, (m + r, m + r), by difference quotients over `lengths`, central if `both`."""
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
        """Compute -d wrench/d(angular velocity) on the free freedoms (r, r), the damping of torsion included."""
        o = at.BODY + body.ANGULAR_VELOCITY
        B = np.zeros((self.r, self.r))
        for i, axis in enumerate(self.axes):
            before = self.changing.copy()
            if axis >= 3:
                columns = []
                for rate in (RATE, -RATE):
                    self.changing[:] = before
                    self.grasped.block[o + axis - 3] = rate
                    now = self.forces()
                    columns.append(np.zeros(self.m + self.r) if now is None else now)
                B[:, i] = (columns[1] - columns[0])[self.m :] / (2 * RATE)
            self.changing[:] = before
        return B

    def wrenches(self, arms: FloatArray) -> FloatArray:
        """Form G (r, m) of forces at arms (n, d) from the object's centre, on its free freedoms."""
        wide = np.zeros((self.n, 3))
        wide[:, : self.d] = arms
        full = np.hstack([np.vstack([np.eye(3), cross(arm)])[:, : self.d] for arm in wide])
        return np.asarray(full[np.array(ROWS[self.d])[self.free]])

    def inertia(self) -> FloatArray:
        """Form the body's inertia on its free freedoms (r, r)."""
        state, full = self.grasped.body_state, np.zeros((6, 6))
        R = state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
        full[:3, :3] = state[body.MASS] * np.eye(3)
        full[3:, 3:] = R @ np.diag(state[body.INERTIA : body.INERTIA + 3]) @ R.T
        return np.asarray(full[np.ix_(self.axes, self.axes)])

    def lengths(self) -> FloatArray:
        """Give a small motion for each coordinate: that of `SHIFT` at the fingertips."""
        g = self.grasped
        arms = g.finger_position - g.body_state[body.POSITION : body.POSITION + self.d]
        far = max(float(np.linalg.norm(arms, axis=1).max(initial=0.0)), 1e-3)
        turning = self.axes >= 3
        return np.concatenate([np.full(self.m, SHIFT), np.where(turning, SHIFT / far, SHIFT)])


def compiled_sample(grasped: GraspedObject) -> Callable[[], int]:
    """Give a function that computes a sample of this grasp as `GraspedObject.sample` does, some hundred times as fast.

    It is machine code of the step, with the bits of the kernel that Python runs; without LLVM it is that method itself.
    """
    if find_spec("llvmlite") is None:
        return grasped.sample
    return partial(program().bind(grasped.block, np.empty(1)).brief, 0, 0, -1, 0)


# Friction cones ------------------------------------------------------------------------------------------------------


def grip_margins(grasped: GraspedObject) -> FloatArray:
    """Give f_t/(mu f_n) of each finger's last elastic force, (n,); nan for one without coefficient or normal force.

    1 is the edge of the friction cone. The torsion of a soft finger counts as in its limit surface,
    sqrt(f_t^2 + (tau/rho)^2).
    """
    margins = np.full(grasped.fingers, np.nan)
    for i, (normal, tangent) in enumerate(_forces(grasped)):
        mu = grasped.rows[i, at.COEFFICIENT]
        if mu > 0.0 and normal > 0.0:
            margins[i] = float(np.hypot(np.linalg.norm(tangent), grasped.rows[i, at.LOCAL + 3])) / (mu * normal)
    return margins


def edge_directions(grasped: GraspedObject, fingers: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Give T and V (n d, fingers), world axes: along t each contact slides, and V'f = f_t - mu f_n = 0 meanwhile."""
    n, d = grasped.fingers, grasped.dimensions
    R = grasped.body_state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
    forces = list(_forces(grasped))
    T, V = np.zeros((n * d, len(fingers))), np.zeros((n * d, len(fingers)))
    for column, i in enumerate(fingers):
        tangent = forces[i][1]
        t = tangent / max(float(np.linalg.norm(tangent)), 1e-300)
        x = slice(i * d, i * d + d)
        T[x, column] = (R @ t)[:d]
        normal = grasped.rows[i, at.NORMAL : at.NORMAL + 3]
        V[x, column] = (R @ (t - grasped.rows[i, at.COEFFICIENT] * normal))[:d]
    return T, V


def _forces(grasped: GraspedObject) -> Iterator[tuple[float, FloatArray]]:
    """Give the normal force of each finger, and its tangential force in the object's axes (3,)."""
    for row in grasped.rows:
        normal, force = row[at.NORMAL : at.NORMAL + 3], row[at.LOCAL : at.LOCAL + 3].copy()
        force[grasped.dimensions :] = 0.0
        along = float(normal @ force)
        yield along, force - along * normal


def sliding_notes(
    linear: Linearisation, T: FloatArray, V: FloatArray, names: Sequence[str]
) -> Iterator[str]:  # fmt: skip
    """Say which contacts on their cones' edges could not slide calmly at the gains that are there.

    A note, no limit: while they slide the loop also does other things than these linear ones, and the smallest limit
    over all sets of sliding contacts would warn of grasps that stay where they are.

    Args:
        linear: the loop with sticking contacts, at rest.
        T, V: of `edge_directions` in its coordinates, (m, contacts).
        names: of their fingers.
    """
    count = len(names)
    sizes = range(1, count + 1) if count <= ALL_SETS else (1, count)
    for size in sizes:
        for sliders in combinations(range(count), size):
            some, of = list(sliders), ", ".join(names[i] for i in sliders)
            t, v = T[:, some], V[:, some]
            K = released(linear.stiffness, t, v)
            if K is None:
                yield f"if {of} slid, friction would have no answer to it (det V'K T <= 0): a jump is possible"
                continue
            D = released(linear.damping, t, v) if linear.damping.any() else linear.damping
            radius = radius_of(linear.with_changes(stiffness=K, damping=linear.damping if D is None else D))
            if radius > 1.0 + GROWTH:
                yield f"if {of} slid on, the loop would grow while it slides, spectral radius {radius:.6f}"


# Ground --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Ground:
    """Obstacles that an object stands on.

    Attributes:
        names: of the obstacles.
        stiffness, damping: K_g, B_g (r, r) on the object's free freedoms, all contact points sticking.
        points: how many there are.
    """

    names: tuple[str, ...]
    stiffness: FloatArray
    damping: FloatArray
    points: int


def ground_under(parts: Parts, index: int, grip: Grip, *, lower: float = 0.0) -> Ground | None:
    """Give the ground of an object where it is, or `lower` [m] along gravity; None for what no floor or wall bears.

    K_g = sum k J'J over the points that bear, J (d, r) the velocity of a point per motion of the object, k that of the
    world; B_g with b = 2 sqrt(k m). Only native objects on half-spaces and planes.
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
    """Name whatever could carry an object besides its fingers."""
    table = scene.object[index]
    if table.shape is None:
        return
    yield from (obstacle.name for obstacle in scene.obstacle)
    for group in bodies.groups(scene):
        if index in group and bodies.in_world(scene, group) and bodies.collide(scene):
            yield from (scene.object[i].name for i in group if i != index)
