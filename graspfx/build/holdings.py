"""The hands of a scene made to move: motions, turns and squeezes from their tables, and hands of a plug-in's own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path as FilePath
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.errors import InputError
from graspfx.loop import plant
from graspfx.loop.hand import Hand
from graspfx.loop.motion import motion as motions
from graspfx.loop.motion.turn import Turn
from graspfx.scene.tables.reading import AXES, listed

if TYPE_CHECKING:
    from graspfx.scene.tables.hands import Axis as AxisTable
    from graspfx.scene.tables.hands import MadeHand, Moving, OwnHand, SharedHand, SharedMadeHand
    from graspfx.scene.tables.hands import Motion as MotionTable
    from graspfx.scene.tables.hands import Turn as TurnTable
    from graspfx.scene.tables.scene_table import SceneTable

FloatArray = NDArray[np.float64]
Location = tuple[str | int, ...]

AUTOMATIC = frozenset({"rest", "inward"})  # given to a plug-in's `hold` that takes them


@dataclass(frozen=True)
class Holding:
    """The fingers that one hand holds, and its table (None: nobody holds them) with where that stands."""

    at: Location
    table: OwnHand | SharedHand | MadeHand | SharedMadeHand | None
    fingers: list[int]


def holdings(scene: SceneTable) -> list[Holding]:
    """The hands of a scene in the order of their first fingers; a finger without one stands alone."""
    shared = {table.name: (("hand", k), table) for k, table in enumerate(scene.hand)}
    found: dict[Location, Holding] = {}
    for i, finger in enumerate(scene.finger):
        named = finger.hand
        at, table = shared[named] if isinstance(named, str) else (("finger", i, "hand"), named)
        found.setdefault(at, Holding(at, table, [])).fingers.append(i)
    return list(found.values())


def hold(
    scene: SceneTable, folder: FilePath | None, holding: Holding, start: FloatArray, inward: FloatArray
) -> plant.Hand:
    """The hand that a table describes.

    Args:
        folder: where relative paths in the scene start.
        start: of all fingers of the scene (n, d) [m].
        inward: unit normals into the objects where they touch (n, d).
    """
    table, rest, normals = holding.table, start[holding.fingers], inward[holding.fingers]
    if table is None:
        return Hand(rest, 0.0)
    if table.form == "made":
        return made(plugins.load_blaming("hands", table.kind, folder), table, rest, normals)
    motion = make_motions(scene, folder, table)
    turns = make_turns(scene, table, holding.fingers)
    if table.form == "own":
        if table.rest is not None:
            rest = np.array([table.rest])
        closing = normals if table.closing == "normal" else np.array([table.closing], dtype=float)
        return Hand(
            rest, table.stiffness, table.damping, motion, make_squeeze(table), closing, table.squeeze_ramp, turns=turns
        )
    return Hand.arm_and_grip(
        rest,
        arm=(table.arm.stiffness, table.arm.damping),
        grip=(table.grip.stiffness, table.grip.damping),
        motion=motion,
        squeeze=make_squeeze(table),
        inward=closing_directions(table, rest, normals),
        squeeze_ramp=table.squeeze_ramp,
        share=table.share,
        turns=turns,
    )


def made(module: ModuleType, table: MadeHand, rest: FloatArray, inward: FloatArray) -> plant.Hand:
    """The hand that a plug-in's `hold` gives, found to be one.

    Raises:
        InputError: what it gives is no hand for these fingers.
        PluginError: whatever else it raises, with its line.
    """
    taken = signature(module.hold).parameters
    given = {"rest": rest.copy(), "inward": inward.copy()}
    with plugins.blaming(FilePath(module.__file__ or module.__name__)):
        hand: plant.Hand = module.hold(**{key: given[key] for key in given if key in taken}, **table.settings)
        lacking = [name for name in ("stiffness", "damping", "target") if not hasattr(hand, name)]
        if lacking:
            raise InputError("hold()", hand, f"a hand, with {', '.join(lacking)}", "see graspfx.loop.plant.Hand")
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
            raise InputError(f"{name} of what hold() gives", array, f"an array {shape} of finite numbers")
    return hand


def closing_directions(table: SharedHand, rest: FloatArray, normals: FloatArray) -> FloatArray:
    """Where each finger goes when the hand closes, (n, d)."""
    if table.closing == "normal":
        return normals
    if table.closing == "centre":
        return np.asarray(rest.mean(axis=0) - rest)
    return np.array(table.closing, dtype=float)


def make_motions(scene: SceneTable, folder: FilePath | None, table: Moving) -> motions.Motion:
    """The intended motion of a hand: that of its table, or the sum of several."""
    found = [make_motion(scene, folder, each) for each in listed(table.motion)]
    if len(found) > 1:
        return motions.Sum(found)
    return found[0] if found else motions.Rest()


def make_motion(scene: SceneTable, folder: FilePath | None, table: MotionTable) -> motions.Motion:
    """The motion that a table describes."""
    if table.kind == "rest":
        return motions.Rest()
    if table.kind == "sine":
        along = axis_of(table.axis, scene.dimensions)
        return motions.Sine(table.amplitude, table.frequency, along, table.begin, table.ramp)
    if table.kind == "reach":
        return motions.Reach(table.displacement, table.begin, table.duration)
    if table.file is not None:
        return motions.Path.read(table.file, folder)
    assert table.times is not None and table.positions is not None
    return motions.Path(table.times, table.positions)


def make_squeeze(table: Moving) -> float | motions.Motion:
    """How far a hand closes in time: a number as it is, steps as levels."""
    if isinstance(table.squeeze, int | float):
        return table.squeeze
    return motions.Levels([[step.to, step.begin, step.duration] for step in listed(table.squeeze)])


def make_turns(scene: SceneTable, table: Moving, fingers: Sequence[int]) -> list[Turn]:
    """The turns of a hand that holds these fingers."""
    return [_turn(scene, each, fingers) for each in listed(table.turn)]


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


def axis_of(axis: AxisTable, dimensions: int) -> FloatArray:
    """The unit vector (d,) along an axis by its name or number, or along a vector."""
    if isinstance(axis, tuple):
        return motions.direction(axis, dimensions)
    return motions.direction(AXES[axis] if isinstance(axis, str) else axis, dimensions)


def descriptions(scene: SceneTable) -> Iterator[str]:
    """Every hand in words: its name, the fingers that it holds, what it does in time."""
    own: dict[str, list[str]] = {}
    for holding in holdings(scene):
        names = [scene.finger_names[i] for i in holding.fingers]
        if holding.table is not None and holding.at[0] == "hand":
            yield f"{scene.hand[int(holding.at[1])].name} holds {', '.join(names)} ({doing(holding.table)})"
        elif holding.table is not None:
            own.setdefault(doing(holding.table), []).extend(names)
    for what, names in own.items():
        yield f"{', '.join(names)} by {'itself' if len(names) == 1 else 'themselves'} ({what})"


def doing(table: OwnHand | SharedHand | MadeHand) -> str:
    """What a hand does in time, in words."""
    if table.form == "made":
        return f"as {table.kind} has it"
    said = [f"motion: {' + '.join(each.kind for each in listed(table.motion)) or 'rest'}"]
    if table.turn is not None:
        said.append(f"turn: {', then '.join(each.kind for each in listed(table.turn))}")
    if not isinstance(table.squeeze, int | float):
        said.append("squeeze: " + ", ".join(f"{1e3 * s.to:g} mm at {s.begin:g} s" for s in listed(table.squeeze)))
    elif table.squeeze:
        said.append(f"squeeze: {1e3 * table.squeeze:g} mm")
    return "; ".join(said)
