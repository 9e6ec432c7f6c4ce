"""Construction of a scene's hands: motions, squeezes, turns, springs and dampers, operator models, plug-ins."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from inspect import signature
from pathlib import Path as FilePath
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.assembly.bodies import Stock
from graspfx.errors import InputError
from graspfx.loop import plant
from graspfx.loop.guided_hand import GuidedHand
from graspfx.loop.hand import Hand
from graspfx.loop.motion import motion as motions
from graspfx.loop.motion.tremor import Tremor
from graspfx.loop.motion.turn import Turn
from graspfx.loop.operator import NOISE, Operator
from graspfx.scene.keys import Key
from graspfx.scene.tables.reading import AXES, listed

if TYPE_CHECKING:
    from graspfx.scene.tables.hand_tables import Axis as AxisTable
    from graspfx.scene.tables.hand_tables import Guide, MadeHand, Moving, OwnHand, SharedHand, SharedMadeHand
    from graspfx.scene.tables.hand_tables import Motion as MotionTable
    from graspfx.scene.tables.hand_tables import Turn as TurnTable
    from graspfx.scene.tables.scene_table import SceneTable


FloatArray = NDArray[np.float64]
PARTS = ("limb", "stiffening", "reaction", "noise")  # parts of a hand's table that define an operator model


def is_operated(table: object) -> bool:
    """Return whether a hand's table defines an operator model in addition to a spring and a damper."""
    return any(getattr(table, name, None) is not None for name in PARTS)


def operator_of(table: Moving, fingers: Sequence[int], dimensions: int) -> Operator | None:
    """Make the operator model of a hand; None if the hand has only a spring and a damper.

    Args:
        table: Table of the hand.
        fingers: Indices of the hand's fingers in the scene, which are part of the seeds of the noise.
        dimensions: Number of dimensions of the scene.
    """
    if not is_operated(table):
        return None
    operator = Operator(len(fingers))
    if table.limb is not None:
        springs = (_per_axis(each, dimensions) for each in (table.limb.stiffness, table.limb.damping))
        operator.set_limb(table.limb.mass, *springs)
    if table.stiffening is not None:
        operator.set_stiffening(table.stiffening.stiffness, table.stiffening.damping, table.stiffening.lag)
    if (own := table.reaction) is not None:
        operator.set_reaction(own.delay, own.stiffness, own.damping, own.force)
    if table.noise is not None:
        seeds = [(table.noise.seed, i, NOISE) for i in fingers]
        operator.set_noise(table.noise.share, table.noise.cutoff, table.noise.lag, seeds)
    return operator


def _per_axis(value: Any, dimensions: int) -> FloatArray:
    return np.array(np.broadcast_to(np.array(value, dtype=float), (dimensions,)))


OPERATOR = (
    ("limb", "a limb's mass"), ("stiffening", "stiffer with grip"), ("reaction", "a late reaction"),
    ("tremor", "tremor"), ("noise", "noise"),
)  # fmt: skip


@dataclass(frozen=True)
class Holding:
    """Location and table of a hand in the scene, and indices of its fingers; the table of no hand is None."""

    at: Key
    table: OwnHand | SharedHand | MadeHand | SharedMadeHand | None
    fingers: list[int]


def holdings(scene: SceneTable) -> list[Holding]:
    """List the hands of a scene, and the fingers without a hand, in the order of their first fingers."""
    shared = {table.name: (("hand", k), table) for k, table in enumerate(scene.hand)}
    hands: dict[Key, Holding] = {}
    for i, finger in enumerate(scene.finger):
        label = finger.hand
        at, table = shared[label] if isinstance(label, str) else (("finger", i, "hand"), label)
        hands.setdefault(at, Holding(at, table, [])).fingers.append(i)
    return list(hands.values())


def axis_of(axis: AxisTable, dimensions: int) -> FloatArray:
    """Return the unit vector (d,) along `axis`, which is the name or number of a coordinate axis, or a vector."""
    if isinstance(axis, tuple):
        return motions.direction(axis, dimensions)
    return motions.direction(AXES[axis] if isinstance(axis, str) else axis, dimensions)


def descriptions(scene: SceneTable) -> Iterator[str]:
    """Yield a text on each hand with its name, fingers and motion; fingers with equal hands share a text."""
    own: dict[str, list[str]] = {}
    for holding in holdings(scene):
        names = [scene.finger_names[i] for i in holding.fingers]
        if holding.table is not None and holding.at[0] == "hand":
            yield f"{scene.hand[int(holding.at[1])].name} holds {', '.join(names)} ({doing(holding.table)})"
        elif holding.table is not None:
            own.setdefault(doing(holding.table), []).extend(names)
    for course, names in own.items():
        yield f"{', '.join(names)} by {'itself' if len(names) == 1 else 'themselves'} ({course})"


def doing(table: OwnHand | SharedHand | MadeHand) -> str:
    """Return a text that describes a hand's motion, squeeze, turns and operator model."""
    if table.form == "made":
        return f"motion by {table.kind}"
    texts = [f"motion: {' + '.join(each.kind for each in listed(table.motion)) or 'rest'}"]
    if table.turn is not None:
        texts.append(f"turn: {', then '.join(each.kind for each in listed(table.turn))}")
    if not isinstance(table.squeeze, int | float):
        texts.append("squeeze: " + ", ".join(f"{1e3 * s.to:g} mm at {s.begin:g} s" for s in listed(table.squeeze)))
    elif table.squeeze:
        texts.append(f"squeeze: {1e3 * table.squeeze:g} mm")
    if table.guide is not None:
        texts.append(f"guided, {1e3 * table.guide.lag:g} ms behind its goals")
    texts += [text for name, text in OPERATOR if getattr(table, name) is not None]
    return "; ".join(texts)


AUTOMATIC = frozenset({"rest", "inward"})  # arguments of a plug-in's `hold`, if it accepts them


@dataclass(frozen=True, eq=False)
class HandPart:
    """A hand of a scene with its intended motion, squeeze and turns.

    Attributes:
        holding: Table and fingers of the hand.
        driver: Module of a plug-in, which defines the hand's motion itself; None for other hands.
        motion: Translation of all fingers of the hand; None without a motion.
        squeeze: Closing distance [m], constant after a ramp or as a motion.
        turns: Turns, in the order in which they are applied.
        guided: Whether the hand follows the guide in its table.
        settled: Whether offsets and squeeze of the guide start at their goals.
    """

    holding: Holding
    driver: ModuleType | None = None
    motion: motions.Motion | None = None
    squeeze: float | motions.Motion = 0.0
    turns: Sequence[Turn] = ()
    guided: bool = True
    settled: bool = False

    @property
    def fingers(self) -> list[int]:
        """Indices of the hand's fingers in the scene."""
        return self.holding.fingers

    def still(self, *, guided: bool = True) -> HandPart:
        """Return the hand without motion and turns; a plug-in's hand is returned unchanged.

        Args:
            guided: Whether the guide displaces the hand to its goals; if False, the guide is ignored.
        """
        return self if self.driver is not None else replace(self, motion=None, turns=(), guided=guided, settled=True)

    def with_course(self) -> HandPart:
        """Return the hand with its squeeze converted to a motion; a plug-in's hand is returned unchanged."""
        table = self.holding.table
        if (
            self.driver is not None
            or table is None
            or table.form == "made"
            or not isinstance(self.squeeze, int | float)
        ):
            return self
        return replace(self, squeeze=motions.Levels([[self.squeeze, 0.0, table.squeeze_ramp]]))

    def hold(self, start: FloatArray, inward: FloatArray) -> plant.Hand:
        """Make the hand for the simulation.

        Args:
            start: Start positions of all fingers of the scene, (n, d) [m].
            inward: Unit normals into the objects at the contacts of all fingers, (n, d).
        """
        table, rest, normals = self.holding.table, start[self.fingers], inward[self.fingers]
        if table is None:
            return Hand(rest, 0.0)
        if table.form == "made":
            assert self.driver is not None
            return plugin_hand(self.driver, table, rest, normals)
        if table.form == "own":
            if table.rest is not None:
                rest = np.array([table.rest])
            closing = normals if table.closing == "normal" else np.array([table.closing], dtype=float)
            hand = Hand(
                rest, table.stiffness, table.damping, self.motion, self.squeeze, closing, table.squeeze_ramp,
                turns=self.turns,
            )  # fmt: skip
            hand.operator = operator_of(table, self.fingers, start.shape[1])
            return self._guided(hand, table.guide)
        hand = Hand.arm_and_grip(
            rest,
            arm=(table.arm.stiffness, table.arm.damping),
            grip=(table.grip.stiffness, table.grip.damping),
            motion=self.motion,
            squeeze=self.squeeze,
            inward=closing_directions(table, rest, normals),
            squeeze_ramp=table.squeeze_ramp,
            share=table.share,
            turns=self.turns,
        )
        hand.operator = operator_of(table, self.fingers, start.shape[1])
        return self._guided(hand, table.guide)

    def _guided(self, hand: Hand, guide: Guide | None) -> plant.Hand:
        if guide is None or not self.guided:
            return hand
        offset = 0.0 if guide.offset is None else np.array(guide.offset, dtype=float)
        return GuidedHand(hand, guide.lag, offset, guide.squeeze, settled=self.settled)


def make_hand(scene: SceneTable, stock: Stock, holding: Holding) -> HandPart:
    """Make the motion, squeeze and turns of a hand, or load the plug-in that defines the hand."""
    table = holding.table
    if table is None:
        return HandPart(holding)
    if table.form == "made":
        return HandPart(holding, plugins.load_blaming("hands", table.kind, stock.folder))
    return HandPart(
        holding,
        motion=_with_tremor(make_motions(scene, stock, table), scene, table, holding.fingers[0]),
        squeeze=make_squeeze(table),
        turns=[_turn(scene, each, holding.fingers) for each in listed(table.turn)],
    )


def plugin_hand(
    module: ModuleType, table: MadeHand | SharedMadeHand, rest: FloatArray, inward: FloatArray
) -> plant.Hand:
    """Call the function `hold` of a plug-in, and check that it returns a hand for n fingers in d dimensions.

    Raises:
        InputError: If the returned object is not a hand, or its arrays have wrong shapes.
        PluginError: If `hold` raises an error that is not an error of GraspFX; the message names the line.
    """
    parameters = signature(module.hold).parameters
    scene = {"rest": rest.copy(), "inward": inward.copy()}
    with plugins.blaming(FilePath(module.__file__ or module.__name__)):
        hand: plant.Hand = module.hold(
            **{key: value for key, value in scene.items() if key in parameters}, **table.settings
        )
        lacking = [name for name in ("stiffness", "damping", "target") if not hasattr(hand, name)]
        if lacking:
            file = plugins.shown_path(FilePath(module.__file__ or module.__name__))
            raise InputError(
                "hold()", hand, "a hand, with stiffness, damping and target(time)",
                f"add {', '.join(lacking)} to the hand of {file}; graspfx.protocols.Hand documents hands",
            )  # fmt: skip
        n, d = rest.shape
        r, v = hand.target(0.0)
        arrays: dict[str, Any] = {
            "stiffness": hand.stiffness,
            "damping": hand.damping,
            "target(0)": r,
            "the rate of target(0)": v,
        }
    for (name, array), shape in zip(arrays.items(), [(d, n, n), (d, n, n), (n, d), (n, d)], strict=True):
        if not isinstance(array, np.ndarray) or array.shape != shape or not np.isfinite(array).all():
            raise InputError(f"{name} of the result of hold()", array, f"an array {shape} of finite numbers")
    return hand


def closing_directions(table: SharedHand, rest: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the directions in which the fingers of a hand move when the hand closes, (n, d)."""
    if table.closing == "normal":
        return normals
    if table.closing == "centre":
        return np.asarray(rest.mean(axis=0) - rest)
    return np.array(table.closing, dtype=float)


def make_motions(scene: SceneTable, stock: Stock, table: Moving) -> motions.Motion:
    """Make the intended motion of a hand, which is the sum of all motions in its table."""
    each = [make_motion(scene, stock, part) for part in listed(table.motion)]
    if len(each) > 1:
        return motions.Sum(each)
    return each[0] if each else motions.Rest()


def _with_tremor(motion: motions.Motion, scene: SceneTable, table: Moving, first: int) -> motions.Motion:
    """Add the tremor of a hand, if it has one, to its motion; the index of the hand's first finger seeds the tremor."""
    own = table.tremor
    if own is None:
        return motion
    seed = (own.seed, first)
    tremor = Tremor(own.amplitude, own.frequency, own.width, scene.dimensions, seed, own.begin, own.ramp)
    return motions.Sum([motion, tremor])


def make_motion(scene: SceneTable, stock: Stock, table: MotionTable) -> motions.Motion:
    """Make one intended motion from its table."""
    if table.kind == "rest":
        return motions.Rest()
    if table.kind == "sine":
        along = axis_of(table.axis, scene.dimensions)
        return motions.Sine(table.amplitude, table.frequency, along, table.begin, table.ramp)
    if table.kind == "reach":
        return motions.Reach(table.displacement, table.begin, table.duration)
    if table.file is not None:
        return stock.path(table.file)
    assert table.times is not None and table.positions is not None
    return motions.Path(table.times, table.positions)


def make_squeeze(table: Moving) -> float | motions.Motion:
    """Return the squeeze in a hand's table: a number, or a motion if the table has steps."""
    if isinstance(table.squeeze, int | float):
        return table.squeeze
    return motions.Levels([[step.to, step.begin, step.duration] for step in listed(table.squeeze)])


def _turn(scene: SceneTable, table: TurnTable, fingers: Sequence[int]) -> Turn:
    angle: motions.Motion
    if table.kind == "reach":
        angle = motions.Reach([table.angle], table.begin, table.duration)
    else:
        angle = motions.Sine(table.amplitude, table.frequency, [1.0], table.begin, table.ramp)
    centre = table.centre
    if centre is None:
        touched = scene.object[scene.finger_objects[fingers[0]]]
        centre = touched.position or (0.0,) * scene.dimensions
    axis = None if scene.dimensions == 2 or table.axis is None else axis_of(table.axis, 3)
    return Turn(angle, centre, axis)
