"""A grasped object, which owns a state block, offers named views of the block, and computes samples."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.records import Many, size_of, start_of
from graspfx.coupling.block_entries import (
    contradiction,
    gain_entries,
    matrix_entries,
    recorded_entries,
    split_entries,
    structure_entries,
)
from graspfx.coupling.contacts import EXCESSIVE, NOT_FINITE, UNRESOLVED, approach, refactor, turn_axes
from graspfx.coupling.depth import compliance
from graspfx.coupling.fill import Grip, Shape, make_block
from graspfx.coupling.gains import V, W, fill_gains, fill_rows
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.law import normal_force
from graspfx.coupling.object_gains import WIDE, add_object_gain
from graspfx.coupling.rules import Rules, release_compliance
from graspfx.coupling.sample import let_go, sample
from graspfx.coupling.two_forces import SplitRule
from graspfx.grasp.impedance import Coupling
from graspfx.objects.body_state import BodyState
from graspfx.surfaces.triangles.mesh_tree import NEW, MeshFinger

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


UNCOUPLED = 1e-12  # relative bound below which an entry of K_o between translation and rotation is rounding


class _Fades(NamedTuple):
    """Present start of the fade; largest shortfall, and start that was needed, of earlier fades in the run [m]."""

    start: float
    shortfall: float = 0.0
    needed: float = 0.0


class GraspedObject:
    """n fingers coupled to one object in d dimensions.

    In every sample, write `finger_position` and `finger_velocity` (n, d), call `sample()`, and read `force` (n, d), the
    forces on the object. `sample` also writes the object's wrench to the body's part of the block, where `body.step`
    reads it.

    Args:
        fingers: Number of fingers n.
        dimensions: Number of dimensions d.
        period: Sampling period T [s].
        law: Gains of eq. (4).
        rules: Contact rules.
        shape: Shape of the object; None only with attached contacts, which are at the object's centre until `attach`.
        fill_body: Function that writes the object's parameters and initial state into its part of the block.
        radius: Radius of the ball fingertips, one or (n,) [m]; zero for point fingertips.
        limit: Largest force of each finger, one or (n,) [N], infinite for a finger without a limit; None without
            limits.
        live: Names of fields of `GraspState` that may change during a run.

    Raises:
        InputError: If an argument is invalid; if unilateral contact has no shape or a stiffness of zero; or if soft
            fingers are not in 3-D, have matrix gains, have no friction, or are attached without a shape.
    """

    def __init__(
        self,
        fingers: int,
        dimensions: int,
        period: float,
        law: Coupling,
        rules: Rules,
        fill_body: Callable[[FloatArray], None],
        *,
        shape: Shape | None = None,
        radius: ArrayLike = 0.0,
        limit: ArrayLike | None = None,
        live: Collection[str] = (),
    ) -> None:
        n, d = fingers, dimensions
        self.live = frozenset(live)
        grip = Grip(n, d, law, rules, fill_body, shape, radius, limit, self.live)
        self.fingers, self.dimensions, self.law = n, d, law
        self.matrices, self.soft = grip.matrices, grip.soft
        self.block = make_block(grip, period)
        self.state = GraspState(self.block)
        self._fades = _Fades(self.state.fade_start)
        self._grasp = GraspState(memoryview(self.block))  # Python floats, twice as fast as array items
        self._shaped = shape is not None
        self._walks: Many[MeshFinger] | None = None
        if shape is not None and shape.data is not None:
            self._walks = Many(MeshFinger, self.block, self.state.fingers[0].walk.offset, n)
        o = start_of(GraspState, "body")
        self.body_state = self.block[o : o + size_of(BodyState)]
        self.finger_position = self.array(FingerState.position)[:, :d]
        self.finger_velocity = self.array(FingerState.velocity)[:, :d]
        self.contact_position = self.array(FingerState.contact_world)[:, :d]
        self.force = self.array(FingerState.force)[:, :d]
        self.moment = self.array(FingerState.moment)
        self.touching = self.array(FingerState.touching)
        self.limit = None if limit is None else self.array(FingerState.limit)
        self.where = recorded_entries(self.state)
        if self._walks is not None:  # searches extend as far as the fade; without a fade, they have no limit
            end = self.state.fade_end if self.state.fade else np.inf
            self._walks.array(MeshFinger.reach)[:] = end + self.array(FingerState.radius)

    def adopt(self, other: GraspedObject) -> None:
        """Adopt the law and fade range of another grasped object, whose values this block already contains."""
        self.law = other.law
        if self.state.fade:
            self.set_fade(self.state.fade_start, self.state.fade_end)

    def array(self, field: Any) -> FloatArray:
        """Return a field of all fingers as a view of the block, (n,) or (n, entries)."""
        return self.state.fingers.array(field)

    @property
    def wrench(self) -> FloatArray:
        """f_v of eq. (2) about the object's centre, (w,): force [N], then moment [N m]."""
        return self.block[self.where["wrench"]]

    @property
    def structure(self) -> Index:
        """Indices of entries of `block` that are constant in a run and select what is computed."""
        return structure_entries(self.state, self.live)

    @property
    def gain_entries(self) -> list[int]:
        """Indices in `block` of scalar gains, and of the switches that depend on them."""
        return gain_entries()

    @property
    def watched_entries(self) -> list[int]:
        """Indices of entries of `block` that no run changes, and that are also read outside of samples.

        These are the gains, from which matrices are composed once, and the data of P, by which a recording splits
        forces.
        """
        return [*gain_entries(), *matrix_entries(self.state), *split_entries(self.state)]

    @property
    def implicit(self) -> bool:
        """Whether the body's free motion must be predicted before each sample."""
        return self.state.implicit

    @property
    def shortfall(self) -> float:
        """Largest distance by which the fade has started too close to the surface so far [m]; 0 if it has not."""
        return max(self._fades.shortfall, self.state.shortfall)

    @property
    def fade_needed(self) -> float:
        """Gap at which the fade should have started for the forces so far [m]; 0 if the start was far enough away."""
        return max(self._fades.needed, _needed(self.state.fade_start, self.state.shortfall))

    def fade_asked(self) -> tuple[float, float] | None:
        """Return the fade's start and the start that the last forces require [m]; None if equal gains or no fade."""
        if not self.state.fade or self.state.equal:
            return None
        pushes = sum(normal_force(finger) for finger in self._grasp.fingers)
        return self.state.fade_start, release_compliance(self.law, self.fingers, self.dimensions) * float(pushes)

    @property
    def blended(self) -> int:
        """Number of samples in which a rotation had a partial weight in the split."""
        return int(self.state.in_band)

    def set_fade(self, low: float, high: float) -> None:
        """Set the gaps over which a free finger fades out of the grasp [m]."""
        if low != self._fades.start:  # a shortfall is relative to the present start of the fade
            most = max(self._fades.needed, _needed(self._fades.start, self.state.shortfall))
            self._fades = _Fades(low, self.shortfall, most)
            self.state.shortfall = 0.0
        self.state.fade_start, self.state.fade_end = low, high
        if self._walks is not None:
            self._walks.array(MeshFinger.reach)[:] = high + self.array(FingerState.radius)

    def inward(self) -> FloatArray:
        """Compute unit normals into the object at the fingers' contacts, in world axes, (n, d)."""
        o = start_of(BodyState, "motion") + start_of(type(self.state.body.motion), "rotation")
        R = self.body_state[o : o + 9].reshape(3, 3)
        normals: FloatArray = np.einsum("fi,ji->fj", self.array(FingerState.normal), R)
        return normals[:, : self.dimensions]

    def attach(self, contacts: FloatArray) -> None:
        """Attach contacts at points (n, d) in the object's frame [m]; by default they are at the object's centre."""
        self.array(FingerState.contact)[:, : self.dimensions] = contacts

    def meet(self, position: FloatArray) -> None:
        """Find each finger's contact point and face on the shape from its initial position, (n, d) [m].

        Attached contacts keep the points found here.
        """
        if not self._shaped:
            return
        self.finger_position[:] = position
        if self._walks is not None:
            self._walks.array(MeshFinger.mode)[:] = NEW
        attached, touching = self.state.attached, self.touching.copy()
        self.state.attached = False
        self.touching[:] = 0.0
        approach(self._grasp)
        self.state.attached = attached
        self.touching[:] = touching

    def depths(self, position: FloatArray) -> FloatArray:
        """Compute the fingers' penetration depths as vectors from the surface to the finger, world axes, (n, d) [m].

        The depth of a finger outside the object is zero. For attached contacts the result is the displacement from the
        contact point.

        Args:
            position: Finger positions (n, d) [m], those of the last call of `meet`.
        """
        if not self._shaped:  # contacts are attached to the object's centre, and `meet` does not move them
            self.finger_position[:] = position
            approach(self._grasp)
        away: FloatArray = position - self.contact_position
        if not self.state.attached:
            away[self.array(FingerState.gap) >= 0.0] = 0.0
        return away

    def sample(self) -> int:
        """Compute forces and wrench from fingers' and object's motion (predicted, if implicit); return 0 or a fault."""
        return sample(self._grasp)

    def damper_compliance(self, *, at_rest: bool = True) -> FloatArray:
        """Compute compliances C_i of the dampers in series, one per finger (n,) [m/(N s)]; zero at full damping.

        Args:
            at_rest: If True, use the forces of the last sample, whose rates were zero; if False, use zero forces, for
                which the compliances are infinite.
        """
        if not self.state.gradual:
            return np.zeros(self.fingers)
        if not at_rest:
            return np.full(self.fingers, np.inf)
        grasp = self._grasp
        weighted = [compliance(grasp, finger, normal_force(finger)) for finger in grasp.fingers]
        return np.array(weighted) / self.array(FingerState.weight)

    def pad_stiffness(self) -> FloatArray:
        """Tangent stiffness 3/2 k^(2/3) f_n^(1/3) of each fingertip at the last forces, (n,) [N/m]; inf if rigid."""
        k = self.array(FingerState.pad)
        f = np.array([max(normal_force(finger), 0.0) for finger in self._grasp.fingers])
        return np.where(k > 0.0, 1.5 * np.cbrt(k * k * f), np.inf)

    @property
    def split_rule(self) -> SplitRule:
        """Data of P except contact points and gaps, from the present block."""
        return SplitRule.of(self.state)

    def object_gains(self) -> tuple[FloatArray, ...]:
        """Compute K of translations, K of rotations, internal K, external D and internal D, (m, m) in object axes.

        If some finger is soft, every finger has an additional row after its forces: torsion over patch length.

        The matrices use the contacts and weights of the last sample. If K_o couples translations with rotations, all
        of K is returned as translational, because the rotational remainder would not be a stiffness.
        """
        block = self.block.copy()
        grasp = GraspState(block)
        K, D, first = share_of_object(grasp, "kep"), share_of_object(grasp, "ked"), grasp.matrices.offset
        fill_gains(grasp)
        m = grasp.components
        K_i, D_i = grasp.stiffness.array(m) - K, grasp.damping.array(m) - D
        K_o = block[first + grasp.kep.first :][: WIDE * WIDE].reshape(WIDE, WIDE)
        size = np.sqrt(K_o.diagonal()[:3].max() * K_o.diagonal()[3:].max())
        if np.abs(K_o[:3, 3:]).max() > UNCOUPLED * size:
            return K, np.zeros_like(K), K_i, D, D_i
        K_o[3:] = K_o[:, 3:] = 0.0
        K_t = share_of_object(grasp, "kep")
        return K_t, K - K_t, K_i, D, D_i

    def contradiction(self) -> str:
        """Return the name of a switch of the block that contradicts its gains; empty if there is none."""
        return contradiction(self._grasp.buffer)

    def check_activity(self) -> None:
        """Warn if matrix gains, at their largest skew part, can generate energy: once, and again at a tenfold part.

        Samples do not warn; the caller that runs the samples calls this method.
        """
        if self.matrices:
            self.law.warn_if_active("stiffness", self.state.skewest_stiffness.array(self.state.components))
            self.law.warn_if_active("damping", self.state.skewest_damping.array(self.state.components))

    def let_go(self) -> None:
        """Set force and wrench to zero."""
        let_go(self._grasp)


def share_of_object(grasp: GraspState, name: str) -> FloatArray:
    """Compute an object gain's matrix on the contacts, (m, m) in the object's axes; K in the block is overwritten."""
    if grasp.mixed:
        turn_axes(grasp)
    refactor(grasp)
    grasp.gains_known = False
    for k in range(grasp.mode_count):
        fill_rows(grasp, k, False, grasp.stiffness, grasp.stiffness)
    out = grasp.stiffness.array(grasp.components)
    out[:] = 0.0
    add_object_gain(grasp, getattr(grasp, name), W, V, grasp.stiffness)
    return np.array(out)


def _needed(start: float, shortfall: float) -> float:
    return start + shortfall if shortfall else 0.0


def fault_text(fault: int, fingers: Sequence[str], grasped: GraspedObject) -> str:
    """Return the message for a fault of `sample`."""
    if fault == NOT_FINITE:
        return f"a finger's position or velocity is not finite ({', '.join(fingers)}); all forces are zero"
    if fault == UNRESOLVED:
        return "the contact forces did not converge; all forces are zero"
    if fault == EXCESSIVE:
        return _excess_text(fingers, grasped)
    return "the object's motion or a force on it is not finite; all forces are zero"


def _excess_text(fingers: Sequence[str], grasped: GraspedObject) -> str:
    """Name the gain that contributes most to a force above the bound, and the displacement or rate it multiplies."""
    state, shares = grasped.state, []
    for share, part in ("external", grasped.law.external), ("internal", grasped.law.internal):
        for quantity, field, unit, per in (
            ("stiffness", FingerState.displacement, "m", "N/m"),
            ("damping", FingerState.rate, "m/s", "N s/m"),
        ):
            gain = getattr(part if grasped.matrices else state, quantity if grasped.matrices else f"{share}_{quantity}")
            most, sizes = float(np.max(np.abs(gain))), np.linalg.norm(grasped.array(field)[:, :3], axis=1)
            i = int(np.argmax(sizes))
            shares.append((most * sizes[i], share, quantity, most, per, sizes[i], unit, fingers[i]))
    _, share, quantity, most, per, size, unit, finger = max(shares)
    return (
        f"the law gives a finger {state.excess:.3g} N, above coupling.force_bound = {state.force_bound:g} N: mostly by "
        f"coupling.{share}.{quantity} = {most:g} {per} at {size:.3g} {unit} ({finger}); all forces are zero"
    )
