"""Changes of live keys in a running servo: new values are validated and written into the servo's memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.build import build
from graspfx.assembly.hands import PARTS
from graspfx.assembly.live import (
    BODY,
    DEVICE,
    GAINS,
    GUIDE,
    INERTIA,
    OBJECT_GAINS,
    covers,
    is_live,
    is_of_a_hand,
    require,
    value_of,
)
from graspfx.assembly.process.orders import goal_places
from graspfx.compile.records import entries_of, name_of, start_of
from graspfx.coupling.block_entries import compliant_entry, has_problems, matrix_entries
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.errors import InputError
from graspfx.loop.plant import FusedHand
from graspfx.loop.played import Playback
from graspfx.loop.safety.chain import changing_entry, goal_entries, steered_entries
from graspfx.loop.servo import Steerable, Update
from graspfx.objects.body import NativeBody
from graspfx.objects.body_state import BodyState
from graspfx.scene.keys import general

if TYPE_CHECKING:
    from graspfx.coupling.grasped import GraspedObject
    from graspfx.loop.servo import Servo
    from graspfx.loop.servo_parts import PlantWiring
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
Numbers = tuple[FloatArray, Index, FloatArray]  # a memory, its entries and the values written there

# Fields of a grasp's block with a scene's numbers and dependent values; all other fields are state of the run.
NUMBERS = (
    "external_stiffness", "external_damping", "internal_stiffness", "internal_damping",
    "equal", "damped", "singular", "gradual", "rays", "stiffness_rule", "damping_rule", "release", "stiffest",
    "damping_depth", "fade_start", "fade_end", "arm_low", "arm_high",
)  # fmt: skip
OF_BODY = ("mass", "inertia", "viscosity", "rotational_viscosity", "gravity")
OF_FINGERS = ("coefficient",)
ALL_GAINS = (*GAINS, *OBJECT_GAINS)
CACHES = {"gains_known": ALL_GAINS, "pads_known": ALL_GAINS, "split_known": ("coupling.blend",)}  # values to recompute


class Steering:
    """Live keys of a servo, and updates of the servo for new values of these keys.

    Args:
        servo: Servo that was built with these live keys.
        scene: Scene of the servo.
        keys: Live keys, in which tables are denoted by numbers.
        playback: Playback that replaces the servo's devices, hands and plants, so that their keys have no effect; None
            without a playback.

    Raises:
        InputError: If the parts of the scene do not allow changes of a key; the message states the reason.
    """

    def __init__(
        self, servo: Servo, scene: Scene, keys: Iterable[str], playback: Playback | None = None
    ) -> None:  # fmt: skip
        self.servo, self.scene, self.keys, self._playback = servo, scene, tuple(keys), playback
        for key in self.keys:
            reason = self._obstacle(general(require(key)))
            if reason:
                raise InputError("live", key, "a key that may change during a run", reason)

    def _obstacle(self, plain: str) -> str:
        """Return the reason why the parts of the scene do not allow changes of a key; empty if they allow changes."""
        servo, coupling = self.servo, self.scene.coupling
        if self._playback is not None and (plain in DEVICE or is_of_a_hand(plain)):
            return ""
        if plain in (*BODY, *DEVICE) and coupling.passivity != "off":
            return "the energy ledger of coupling.passivity uses the initial value in every sample"
        if plain in ALL_GAINS and servo.safety is not None and any(part.grasped.matrices for part in servo.objects):
            return "the energy tank of [safety], which limits increases of gains, does not support matrices"
        if plain in BODY and not all(isinstance(mover.body, NativeBody) for mover in servo.movers):
            return "a physics engine moves an object, and has its own copy of the value"
        if plain in DEVICE and coupling.split == "mass":
            return "coupling.split = 'mass' weights fingers by the masses of their devices"
        if plain in DEVICE and not (
            servo.layout.simulated and all(isinstance(m.plant, Steerable) for m in servo.plants)
        ):
            return "only the mechanics of a simulated point device can change"
        if is_of_a_hand(plain) and not all(_is_steerable(m.hand) for m in servo.plants):
            return "a hand or a motion of a plug-in does not use the values in the scene's memory"
        return ""

    def update(self, scene: Scene, values: Mapping[str, Any]) -> Update:
        """Make the update of the servo for new values of live keys.

        Args:
            scene: Scene of the servo with the new values.
            values: New values by live key, in which tables are denoted by numbers.

        Raises:
            InputError: If a new value has another form, requires another memory layout or selects another computation;
                or if a key does not affect a run.
            SceneError, DeviceError: As for `build`.
        """
        for key, value in values.items():
            if not is_live(general(key)):  # a change of the key would be recorded but have no effect
                raise InputError(key, value, "a key of a value in the run", "denote tables by numbers, not by names")
        keys = [general(key) for key in values]
        with build(scene, engine="interpreted", live=self.keys, playback=self._playback) as other:
            entries: list[Numbers] = []
            parts: list[tuple[Steerable, Any]] = []
            for i, (own, new) in enumerate(zip(self.servo.objects, other.objects, strict=True)):
                _require_structure(own.grasped, new.grasped, values)
                entries += self._entries(own.grasped, new.grasped, keys)
                entries += self._of_chain(i, other)
                parts.append((own.grasped, new.grasped))
            if any(key in INERTIA for key in keys):
                bodies = [
                    (mover.body, fresh.body) for mover, fresh in zip(self.servo.movers, other.movers, strict=True)
                ]
                parts += [pair for pair in bodies if isinstance(pair[0], Steerable)]  # bodies that collide with planes
            if self.servo.ticks and all(key in GUIDE for key in keys):  # only goals of guided hands change
                return Update(dict(values), [*entries, *self._goals(other)], parts)
            plants = list(self._plants(other, values))
            for _, (wiring, anew) in plants:
                _require_hand(wiring.hand, anew.hand, values)
                parts.append((wiring.hand, anew.hand))  # type: ignore[arg-type]
                if any(key in DEVICE for key in keys):
                    parts.append((wiring.plant, anew.plant))  # type: ignore[arg-type]
        return Update(dict(values), entries, parts, [j for j, _ in plants])

    def _plants(self, other: Servo, values: Mapping[str, Any]) -> Iterator[tuple[int, tuple[PlantWiring, PlantWiring]]]:
        """Yield index and wiring of each plant that needs an update, with the corresponding wiring of `other`.

        A plant needs an update if a key of hands or devices changes. Before the first tick, every plant whose hand can
        change needs an update, because hands close along the normals at the fingers' start positions. With the
        integrator "implicit", these normals depend on the free motion of the object, and thus on mass, viscosity and
        gravity.
        """
        if self._playback is not None:
            return
        moves = any(key in DEVICE or is_of_a_hand(key) for key in map(general, values))
        for j, (wiring, anew) in enumerate(zip(self.servo.plants, other.plants, strict=True)):
            if moves or (self.servo.ticks == 0 and _is_steerable(wiring.hand)):
                yield j, (wiring, anew)
            elif self.servo.ticks == 0 and not np.array_equal(_normals(self.servo), _normals(other)):
                raise InputError(
                    ", ".join(values), list(values.values()), "values that preserve the normals at the fingers' start",
                    "a hand or a motion of a plug-in already uses the normals; start a run with these values",
                )  # fmt: skip

    def _goals(self, other: Servo) -> Iterator[Numbers]:
        """Yield the entries of guided hands' goals; a change of goals does not require a call of the plants' `hold`."""
        if self._playback is None:
            for own, new in zip(goal_places(self.servo), goal_places(other), strict=True):
                yield own.memory, own.entries, new.memory[new.entries]

    def _entries(self, own: GraspedObject, new: GraspedObject, keys: Sequence[str]) -> Iterator[Numbers]:
        """Yield the entries of a grasp's block that an update writes; before the first tick, all entries."""
        if self.servo.ticks == 0:
            yield own.block, np.arange(own.block.size), new.block.copy()
            return
        places = _places(own)
        if self.servo.safety is not None:  # the safety chain's energy tank limits increases of gains
            places = np.setdiff1d(places, steered_entries(own))
        yield own.block, places, new.block[places]
        yield from _caches(own, new, keys)

    def _of_chain(self, i: int, other: Servo) -> Iterator[Numbers]:
        """Yield the entries of the safety chain's buffer for object i that an update writes.

        Before the first tick, these are all entries.
        """
        own, new = self.servo.safety, other.safety
        if own is None or new is None:
            return
        entries = np.arange(own.buffers[i].size)
        if self.servo.ticks > 0:
            entries = np.array([*goal_entries(), *changing_entry()], dtype=np.intp)
        numbers = new.buffers[i][entries]
        if self.servo.ticks > 0:
            numbers[-1] = 1.0
        yield own.buffers[i], entries, numbers

    def require_live(self, key: str, value: Any) -> None:
        """Check that a key, in which tables are denoted by numbers, is live.

        Raises:
            InputError: If the key is not live.
            UnknownNameError: If the key is unknown.
        """
        if not any(covers(each, key) for each in self.keys):
            with suppress(InputError):  # an omitted setting or table
                value_of(self.scene, key)
            live = f"live keys are {', '.join(self.keys)}" if self.keys else "there are no live keys"
            raise InputError(key, value, "a live key", f"{live}: add it, as in gx.open(scene, live=[{key!r}, ...])")


def _is_steerable(hand: Any) -> bool:
    """Return whether the values of a hand may change during a run."""
    return isinstance(hand, Steerable) and isinstance(hand, FusedHand)


def _normals(servo: Servo) -> FloatArray:
    """Return the unit normals into the objects at the fingers' contacts, object by object, (n, d)."""
    return np.concatenate([part.grasped.inward() for part in servo.objects])


def _require_structure(own: GraspedObject, new: GraspedObject, values: Mapping[str, Any]) -> None:
    """Raise an error if new values change the layout of a grasp's block, or a switch that no live key may change."""
    key, value = next(iter(values.items()))
    keys = key if len(values) == 1 else ", ".join(values)
    slips, stays = (each.array(FingerState.coefficient) > 0.0 for each in (new, own))
    if not np.array_equal(slips, stays):
        raise InputError(
            keys, value, "coefficients of friction that are above zero for the same fingers as before",
            "contacts with and without friction have different states; start a run with this value",
        )  # fmt: skip
    if new.block.size != own.block.size:
        raise InputError(
            keys, value, "a value of the same form as at the start",
            "another form requires another memory layout; start a run with this value",
        )  # fmt: skip
    places = own.structure
    same = own.block[places].view(np.int64) == new.block[places].view(np.int64)
    if not same.all():
        field = name_of(GraspState, int(places[np.flatnonzero(~same)[0]]), own.block)
        raise InputError(
            keys, value, "a value that changes only numbers",
            f"{field} would also change, which selects the computation; start a run with this value",
        )  # fmt: skip


def _places(grasped: GraspedObject) -> Index:
    """List the entries of a grasp's block with values of the scene, or values that depend on them."""
    grasp = grasped.state
    places = entries_of(GraspState, *NUMBERS) + entries_of(BodyState, *OF_BODY, at=start_of(GraspState, "body"))
    for finger in grasp.fingers:
        places += entries_of(FingerState, *OF_FINGERS, at=finger.offset)
    places += matrix_entries(grasp)
    if has_problems(grasp):
        places.append(compliant_entry(grasp.damping_problem))
    return np.array(places, dtype=np.intp)


def _caches(
    own: GraspedObject, new: GraspedObject, keys: Iterable[str]
) -> Iterator[tuple[FloatArray, Index, FloatArray]]:
    """Yield the entries that mark values in the block `own` as computed, set to zero, if their inputs have changed."""
    for name, inputs in CACHES.items():
        if any(key in inputs for key in keys):
            entry = np.array(entries_of(GraspState, name), dtype=np.intp)
            yield own.block, entry, np.zeros(len(entry))


def _require_hand(own: Any, new: Any, values: Mapping[str, Any]) -> None:
    """Raise an error if new values change the structure of a hand, or whether a hand has an operator model."""
    if (getattr(own, "operator", None) is None) != (getattr(new, "operator", None) is None):
        raise InputError(
            ", ".join(values), list(values.values()), f"a hand with one of {', '.join(PARTS)} either always or never",
            "a hand with such a part is simulated differently; start a run with a part that has no effect, such "
            "as stiffening = { stiffness = 0, lag = 0.1 }",
        )  # fmt: skip
    same = own.state.shape == new.state.shape and np.array_equal(own.structure, new.structure)
    if not same or not np.array_equal(own.state[own.structure], new.state[new.structure]):
        raise InputError(
            ", ".join(values), list(values.values()), "the same kinds of motions and turns, and as many as before",
            "a hand's motion has a fixed memory layout; start a run with this motion",
        )  # fmt: skip
