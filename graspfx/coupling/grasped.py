"""Grasped object: its state block, named views of the block, and the computation of samples."""

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
    """Start of the present fade [m], and the largest shortfall and required start of earlier fades in the run [m]."""

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
        shape: Shape of the object; None is allowed only for attached contacts, which are at the object's centre until
            `attach` is called.
        fill_body: Function that writes the parameters and the initial state of the object to a block of a `BodyState`.
        radius: Radius of the ball fingertips, one for all fingers or (n,) [m]; zero for point fingertips.
        limit: Largest force of each finger, one for all fingers or (n,) [N], infinite for a finger without a limit;
            None for no limits.
        live: Names of fields of `GraspState` that may change during a run.

    Raises:
        InputError: If an argument is invalid, if contacts are unilateral and there is no shape or a stiffness is zero,
            or if fingers are soft and not in 3-D, with matrix gains, without friction, or attached without a shape.
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
        """Use the law of another grasped object, and the fade in this block, which already has that object's values."""
        self.law = other.law
        if self.state.fade:
            self.set_fade(self.state.fade_start, self.state.fade_end)

    def array(self, field: Any) -> FloatArray:
        """Return a field of all fingers as a view of the block, (n,) or (n, entries)."""
        return self.state.fingers.array(field)

    @property
    def wrench(self) -> FloatArray:
        """Wrench f_v of eq. (2) about the object's centre, (w,): forces [N], then moments [N m]."""
        return self.block[self.where["wrench"]]

    @property
    def structure(self) -> Index:
        """Indices of entries of `block` that are constant in a run and select what is computed."""
        return structure_entries(self.state, self.live)

    @property
    def gain_entries(self) -> list[int]:
        """Indices in `block` of the scalar gains, and of the switches that depend on these gains."""
        return gain_entries()

    @property
    def watched_entries(self) -> list[int]:
        """Indices of entries of `block` that are constant in every run and are also read outside of samples.

        These entries are the gains, from which matrices are composed once, and the data of the projector P, by which a
        recording splits forces.
        """
        return [*gain_entries(), *matrix_entries(self.state), *split_entries(self.state)]

    @property
    def implicit(self) -> bool:
        """Whether the body's free motion must be predicted before each sample."""
        return self.state.implicit

    @property
    def shortfall(self) -> float:
        """Largest distance by which the fade started too close to the surface in the run so far [m].

        The distance is 0 if the fade never started too close.
        """
        return max(self._fades.shortfall, self.state.shortfall)

    @property
    def fade_needed(self) -> float:
        """Gap at which the fade should have started in the run so far [m]; 0 if it started far enough away."""
        return max(self._fades.needed, _needed(self.state.fade_start, self.state.shortfall))

    def fade_asked(self) -> tuple[float, float] | None:
        """Return the start of the fade and the start that the last forces require [m].

        The result is None if fingers do not fade, or if the internal and external gains are equal.
        """
        if not self.state.fade or self.state.equal:
            return None
        pushes = sum(normal_force(finger) for finger in self._grasp.fingers)
        return self.state.fade_start, release_compliance(self.law, self.fingers, self.dimensions) * float(pushes)

    @property
    def blended(self) -> int:
        """Number of samples in which a rotation had a partial weight in the split."""
        return int(self.state.in_band)

    def set_fade(self, low: float, high: float) -> None:
        """Set the gaps between which a free finger fades out of the grasp [m]."""
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
        """Attach contacts at points (n, d) in the object's frame [m].

        Without this call, attached contacts are at the object's centre.
        """
        self.array(FingerState.contact)[:, : self.dimensions] = contacts

    def meet(self, position: FloatArray) -> None:
        """Find the contact point and face of each finger on the shape from the initial positions, (n, d) [m].

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
        """Compute penetration depths as vectors from the surface to the fingers, in world axes, (n, d) [m].

        The depth of a finger outside the object is zero. For attached contacts the result is the displacement from the
        contact point.

        Args:
            position: Finger positions (n, d) [m]; they must be those of the last call of `meet`.
        """
        if not self._shaped:  # contacts are attached to the object's centre, and `meet` does not move them
            self.finger_position[:] = position
            approach(self._grasp)
        away: FloatArray = position - self.contact_position
        if not self.state.attached:
            away[self.array(FingerState.gap) >= 0.0] = 0.0
        return away

    def sample(self) -> int:
        """Compute forces and wrench from the motions of the fingers and the object; return 0 or a fault.

        With the implicit integrator, the motion of the object is its predicted motion.
        """
        return sample(self._grasp)

    def damper_compliance(self, *, at_rest: bool = True) -> FloatArray:
        """Compute the compliance C_i of each finger's series damper, (n,) [m/(N s)]; it is zero at full damping.

        Args:
            at_rest: If True, use the forces of the last sample, in which all rates must have been zero. If False, use
                zero forces, for which the compliances are infinite.
        """
        if not self.state.gradual:
            return np.zeros(self.fingers)
        if not at_rest:
            return np.full(self.fingers, np.inf)
        grasp = self._grasp
        weighted = [compliance(grasp, finger, normal_force(finger)) for finger in grasp.fingers]
        return np.array(weighted) / self.array(FingerState.weight)

    def pad_stiffness(self) -> FloatArray:
        """Compute the tangent stiffness 3/2 k^(2/3) f_n^(1/3) of each fingertip, (n,) [N/m].

        Here k is the pad's stiffness, and f_n the last normal force. The result is inf for a rigid fingertip.
        """
        k = self.array(FingerState.pad)
        f = np.array([max(normal_force(finger), 0.0) for finger in self._grasp.fingers])
        return np.where(k > 0.0, 1.5 * np.cbrt(k * k * f), np.inf)

    @property
    def split_rule(self) -> SplitRule:
        """Data that determine the projector P, except contact points and gaps, read from the block."""
        return SplitRule.of(self.state)

    def object_gains(self) -> tuple[FloatArray, ...]:
        """Compute K of translations, K of rotations, internal K, external D and internal D, (m, m) in object axes.

        If some finger is soft, every finger has an additional row after its forces, for its torsion divided by the
        patch length.

        The matrices use the contacts and weights of the last sample. If the object's stiffness K_o couples translations
        with rotations, the whole external K is returned as that of translations, because the remainder for rotations
        would not be a stiffness matrix.
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
        """Return the name of a switch in the block that contradicts the gains, or "" if no switch does."""
        return contradiction(self._grasp.buffer)

    def check_activity(self) -> None:
        """Warn if a matrix K or D can generate energy, for the largest skew part so far.

        The warning is given once, and again when the skew part is ten times as large.

        Samples themselves do not warn; the caller that runs the samples calls this method.
        """
        if self.matrices:
            self.law.warn_if_active("stiffness", self.state.skewest_stiffness.array(self.state.components))
            self.law.warn_if_active("damping", self.state.skewest_damping.array(self.state.components))

    def let_go(self) -> None:
        """Set force and wrench to zero."""
        let_go(self._grasp)


def share_of_object(grasp: GraspState, name: str) -> FloatArray:
    """Compute the matrix of an object gain on the contacts, (m, m) in the object's axes; overwrite K in the block."""
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
    """Return the message for a force above the bound, with the gain that contributes most to it."""
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
        f"the law gives a finger {state.excess:.3g} N, above coupling.force_bound = {state.force_bound:g} N: the "
        f"largest contribution is coupling.{share}.{quantity} = {most:g} {per} times {size:.3g} {unit} ({finger}); "
        "all forces are zero"
    )
