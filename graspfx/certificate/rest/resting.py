"""A grasp at rest: where hands that do not move leave fingers and object, and how its forces change about there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.certificate.rest.compiled_sample import compiled_sample
from graspfx.certificate.rest.cone_edge import edge_directions, released
from graspfx.compile.records import numbers, start_of
from graspfx.cones.problem import SLIDE
from graspfx.coupling import block as at
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.objects import integrators as body
from graspfx.objects.body import FREEDOMS
from graspfx.spatial import Vector, exponential, quaternion_matrix

FloatArray = NDArray[np.float64]

STEPS = 24  # in which the hands close, then the weight comes on
SETTLING = 40  # further steps, each longer than the last
SLIDING = 1500  # steps after those, where contacts slid
SETTLED = 1e-9  # of the largest force: what may be left unbalanced
REFRESH = 16  # of those steps for one stiffness
MEETING = 8  # steps after a finger has begun or ceased to touch, in which nothing moves far
DISTRUST = 8  # steps of frozen contacts after one of sliding contacts that has not helped
ROUGH = 1e3  # times its coefficient: that of a frozen contact
RATE = 1e-5  # of a difference quotient [rad/s]
SHIFT = 2e-6  # of a difference quotient [m]: 1e-9 of a radius of 25 mm, squared, and 1e-10 in rounding


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

    def lengths(self) -> FloatArray:
        """Give a small motion for each coordinate: that of `SHIFT` at the fingertips."""
        g = self.grasped
        arms = g.finger_position - g.body_state[body.POSITION : body.POSITION + self.d]
        far = max(float(np.linalg.norm(arms, axis=1).max(initial=0.0)), 1e-3)
        turning = self.axes >= 3
        return np.concatenate([np.full(self.m, SHIFT), np.where(turning, SHIFT / far, SHIFT)])


def softened(grip: Grip, J: FloatArray, sliding: NDArray[np.bool_]) -> FloatArray:
    """Give J of contacts that slide on the way that they slide now; J itself where friction leaves no answer."""
    wide = np.zeros((2, len(J), int(sliding.sum())))
    wide[:, : grip.m] = edge_directions(grip.grasped, np.flatnonzero(sliding).tolist())
    softer = released(J, *wide)
    return J if softer is None else softer


@dataclass(frozen=True)
class Settlement:
    """How a search for rest went.

    Attributes:
        rest: whether it was reached.
        slid: (n,), which contacts slid on the way.
        sliding: (n,), which ones still slid at the end.
        steps: that it took.
    """

    rest: bool
    slid: NDArray[np.bool_]
    sliding: NDArray[np.bool_]
    steps: int


def settle(grip: Grip, course: FloatArray, hands: FloatArray, weight: FloatArray) -> Settlement | None:
    """Bring fingers and object to rest: K_h (r - p) = f, wrench + weight = 0. None if a sample's forces fault.

    The hands close along `course`, then the weight comes on: implicit steps of a motion that friction alone resists,
    its time step growing until they are Newton's. A step knows nothing of contacts that are not there yet: where one
    begins or ends, the next steps are resisted as by the stiffest one, or an object would be thrown from finger to
    finger.

    Contacts keep what a run would keep: faces, anchors, what has slipped. Each step is that of contacts frozen where
    they are, and the forces left over are the true ones: where contacts slide they shrink in proportion only, by
    k/(k + k_h) a step or so. So after a while steps are those of contacts that slide on, as long as that helps.

    Args:
        course: intended positions r (STEPS, m) [m], the last ones from then on.
        hands: K_h (m, m) [N/m].
        weight: on the free freedoms (r,) [N, N m].
    """
    m, size = grip.m, grip.m + grip.r
    lengths = grip.lengths()
    scale = (SHIFT / lengths) ** 2
    drag = float(np.abs(np.diag(hands)).max(initial=0.0)) or 1.0
    every = 1 if size <= 24 else 6
    p, status = grip.grasped.finger_position, grip.grasped.rows[:, at.STATUS]
    slid = np.zeros(grip.n, dtype=bool)
    J: FloatArray | None = None
    touching, met, stiffest = grip.grasped.touching.copy(), 0, drag
    end, trusted = STEPS + SETTLING, STEPS
    before = np.inf
    for k in range(end + SLIDING):
        falling = weight * min(1.0, max(0.0, (k - STEPS) / STEPS))
        r = course[min(k, STEPS - 1)]
        now = grip.forces()
        if now is None:
            return None
        sliding = status == SLIDE
        slid |= sliding
        left = np.concatenate([hands @ (r - p.ravel()) - now[:m], now[m:] + falling])
        force = max(float(np.abs(now[:m]).max(initial=0.0)), 1e-6)
        if k > 2 * STEPS and np.abs(left[:m]).max(initial=0.0) < SETTLED * force:
            turns = np.abs(left[m:] * (lengths[m:] / SHIFT)).max(initial=0.0)
            if turns < SETTLED * force:
                return Settlement(True, slid, sliding, k)
        if k >= end and not slid.any():
            break
        if k % (every if k < end else REFRESH) == 0 or J is None:
            with grip.frozen() if slid.any() else nullcontext():
                J = grip.stiffness(lengths, both=False)
            if J is None:
                return None
        unbalanced = float(np.linalg.norm(left * lengths / SHIFT))
        if unbalanced > before:
            trusted = max(trusted, k + DISTRUST)
        before = unbalanced
        tangent = softened(grip, J, sliding) if k >= trusted and sliding.any() else J
        A = np.vstack([tangent[:m], -tangent[m:]])
        A[:m, :m] += hands
        slow = drag * (1.0 if k < STEPS else 10.0 ** -(min(k - STEPS, 24) / 3.0))
        stiffest = max(stiffest, float(np.abs(np.diag(J)[:m]).max(initial=0.0)))
        if not np.array_equal(touching, grip.grasped.touching):
            touching, met = grip.grasped.touching.copy(), k + MEETING
        if k < met:
            slow = max(slow, grip.n * stiffest)
        step = np.linalg.solve(A + slow * np.diag(scale), left)
        longest = float(np.abs(step * SHIFT / lengths).max(initial=0.0))
        grip.move(step * min(1.0, 1e-3 / longest) if longest > 1e-3 else step)
    return Settlement(False, slid, sliding, k)
