"""Faults of a scene's hands: axes, directions, times, recorded paths, and hands from plug-ins."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from graspfx.assembly.bodies import Stock
from graspfx.assembly.checks.settings import length_faults, load_plugin, numbers, reason, signature_faults
from graspfx.assembly.hands import AUTOMATIC, plugin_hand
from graspfx.assembly.resolve import start_of
from graspfx.errors import GraspFXError, InputError, abbreviate
from graspfx.loop.motion import motion
from graspfx.scene.keys import Finding, Key
from graspfx.scene.tables.fields import NotValid
from graspfx.scene.tables.hand_tables import MadeHand, Reach, SharedHand, Sine, Step
from graspfx.scene.tables.hand_tables import Path as RecordedPath
from graspfx.scene.tables.part_tables import Object
from graspfx.scene.tables.reading import AXES, listed
from graspfx.scene.tables.scene_table import SceneTable

LONGEST = 10_000  # largest delay of a reaction [samples]
NEAR = 1e-9  # relative tolerance: a smaller arm of a finger is rounding of the coordinates


def own_hand_faults(scene: SceneTable, i: int, stock: Stock) -> Iterator[Finding]:
    """Find faults of the hand of finger i."""
    finger, at = scene.finger[i], ("finger", i, "hand")
    hand = finger.hand
    if hand is None or isinstance(hand, str):
        return
    if isinstance(hand, MadeHand):
        yield from _plugin_faults(scene, at, hand, [i], stock)
        return
    yield from _each(
        length_faults(scene, at, hand, "rest"),
        _spring(scene, at, hand),
        _moving(scene, at, hand, [i], stock),
        _own_closing(scene, at, hand),
        _normals(scene, at, hand, [i]),
    )


def shared_hand_faults(scene: SceneTable, at: Key, hand: Any, stock: Stock) -> Iterator[Finding]:
    """Find faults of a hand in the scene's table `hand`, which several fingers may share."""
    name = getattr(hand, "name", None)  # None if the name has its own fault
    fingers = [i for i, finger in enumerate(scene.finger) if name and getattr(finger, "hand", None) == name]
    if isinstance(hand, MadeHand):
        yield from _plugin_faults(scene, at, hand, fingers, stock)
        return
    yield from _each(
        *(_half(scene, (*at, half), hand, half) for half in ("arm", "grip")),
        _moving(scene, at, hand, fingers, stock),
        _closing(scene, at, hand, fingers, stock),
        _normals(scene, at, hand, fingers),
        _share(at, hand, fingers),
    )


def _each(*checks: Iterator[Finding]) -> Iterator[Finding]:
    for check in checks:
        with suppress(NotValid):
            yield from check


def _half(scene: SceneTable, at: Key, hand: Any, half: str) -> Iterator[Finding]:
    yield from _spring(scene, at, getattr(hand, half))


def _spring(scene: SceneTable, at: Key, spring: Any) -> Iterator[Finding]:
    for quantity in ("stiffness", "damping"):
        if isinstance(getattr(spring, quantity), tuple):
            yield from length_faults(scene, at, spring, quantity)


def _moving(scene: SceneTable, at: Key, hand: Any, fingers: Sequence[int], stock: Stock) -> Iterator[Finding]:
    yield from _each(
        *(_motion(scene, where, each, stock) for where, each in _numbered((*at, "motion"), hand, "motion")),
        *(_turn(scene, where, each, fingers) for where, each in _numbered((*at, "turn"), hand, "turn")),
        _squeeze(at, hand),
        _guide(scene, (*at, "guide"), hand, fingers),
        _operator(scene, at, hand),
    )


def _operator(scene: SceneTable, at: Key, hand: Any) -> Iterator[Finding]:
    """Find faults of a hand's limb, tremor and reaction."""
    if hand.limb is not None:
        yield from _spring(scene, (*at, "limb"), hand.limb)
    tremor, reaction = hand.tremor, hand.reaction
    if tremor is not None and tremor.width >= 2.0 * tremor.frequency:
        yield (*at, "tremor", "width"), f"expected less than twice the frequency; given {abbreviate(tremor.width)}"
    if reaction is not None and reaction.delay > LONGEST * scene.period:
        yield (
            (*at, "reaction", "delay"),
            f"expected at most {LONGEST} periods, {LONGEST * scene.period:g} s; given {abbreviate(reaction.delay)}",
        )


def _guide(scene: SceneTable, at: Key, hand: Any, fingers: Sequence[int]) -> Iterator[Finding]:
    guide = hand.guide
    if guide is None or guide.offset is None:
        return
    offset = guide.offset
    if not (offset and isinstance(offset[0], tuple)):
        yield from length_faults(scene, at, guide, "offset")
        return
    if fingers and len(offset) != len(fingers):
        yield (*at, "offset"), f"expected one offset for each of the {len(fingers)} fingers; given {len(offset)}"
    for i, each in enumerate(offset):
        if len(each) != scene.dimensions:
            yield (*at, "offset", i), f"expected {numbers(scene.dimensions)}; given {abbreviate(list(each))}"


def _numbered(at: Key, hand: Any, field: str) -> Iterator[tuple[Key, Any]]:
    """Yield each table of a field, which accepts one table or a list of tables, with the location of the table."""
    try:
        value = getattr(hand, field)
    except NotValid:
        return
    for k, each in enumerate(listed(value)):
        yield ((*at, k) if isinstance(value, tuple) else at), each


def _motion(scene: SceneTable, at: Key, motion: Any, stock: Stock) -> Iterator[Finding]:
    if isinstance(motion, Sine):
        yield from _axis(scene, at, motion)
    elif isinstance(motion, Reach):
        yield from length_faults(scene, at, motion, "displacement")
    elif isinstance(motion, RecordedPath):
        yield from _recorded(scene, at, motion, stock)


def _axis(scene: SceneTable, at: Key, part: Any) -> Iterator[Finding]:
    axis = part.axis
    if isinstance(axis, tuple):
        wrong = list(length_faults(scene, at, part, "axis"))
        yield from wrong or _zero((*at, "axis"), axis)
    elif AXES.get(str(axis), axis) not in range(scene.dimensions):
        yield (*at, "axis"), f"expected an axis of {scene.dimensions} dimensions; given {abbreviate(axis)}"


def _zero(at: Key, vector: Sequence[float]) -> Iterator[Finding]:
    if not any(vector):
        yield at, f"expected a direction that is not zero; given {abbreviate(list(vector))}"


def _recorded(scene: SceneTable, at: Key, path: RecordedPath, stock: Stock) -> Iterator[Finding]:
    times, positions = path.times, path.positions
    if path.file is not None:
        if times is not None or positions is not None:
            yield (*at, "file"), "expected either a file or times and positions, not both"
            return
        try:
            recorded = stock.path(path.file)
        except InputError as error:
            yield (*at, "file"), reason(error)
            return
        if recorded.dimensions != scene.dimensions:
            expected = f"expected {numbers(scene.dimensions)} after the time in each row"
            yield (*at, "file"), f"{expected}; given {recorded.dimensions}"
        return
    if times is None or positions is None:
        yield at, "expected a file, or times and positions"
        return
    if len(times) < 2 or min(np.diff(times)) <= 0.0:
        yield (*at, "times"), "expected at least two times in increasing order"
    if len(times) != len(positions):
        yield (*at, "positions"), f"expected one position for each of the {len(times)} times; given {len(positions)}"
    for i, position in enumerate(positions):
        if len(position) != scene.dimensions:
            yield (*at, "positions", i), f"expected {numbers(scene.dimensions)}; given {abbreviate(list(position))}"
            return


def _turn(scene: SceneTable, at: Key, turn: Any, fingers: Sequence[int]) -> Iterator[Finding]:
    d = scene.dimensions
    if d == 1:
        yield at, "a hand in one dimension does not turn: remove the turn"
        return
    yield from _each(_turn_axis(scene, at, turn), length_faults(scene, at, turn, "centre"))
    if turn.centre is None and len({thing.name for thing in _touched(scene, fingers)}) > 1:
        yield (*at, "centre"), "required if a hand touches several objects"


def _turn_axis(scene: SceneTable, at: Key, turn: Any) -> Iterator[Finding]:
    if scene.dimensions == 3:
        if turn.axis is None:
            yield (*at, "axis"), "required in three dimensions: expected x, y, z or a direction"
        else:
            yield from _axis(scene, at, turn)
    elif turn.axis not in (None, 2, "z"):
        yield (*at, "axis"), f"a turn in two dimensions is about z: remove the axis; given {abbreviate(turn.axis)}"


def _squeeze(at: Key, hand: Any) -> Iterator[Finding]:
    squeeze = hand.squeeze
    if isinstance(squeeze, int | float):
        return
    if "squeeze_ramp" in hand.model_fields_set:
        yield (*at, "squeeze_ramp"), "each step of the squeeze defines its own times: remove squeeze_ramp"
    steps: tuple[Step, ...] = listed(squeeze)
    if not steps:
        yield (*at, "squeeze"), "expected a number, or at least one step"
    for k in range(1, len(steps)):
        before = steps[k - 1]
        if motion.overlap(before.begin, before.duration, steps[k].begin):
            yield (
                (*at, "squeeze", k, "begin"),
                f"expected {before.begin + before.duration:.6g} or more, the end of the previous step; "
                f"given {abbreviate(steps[k].begin)}",
            )


def _normals(scene: SceneTable, at: Key, hand: Any, fingers: Sequence[int]) -> Iterator[Finding]:
    bare = [thing.name for thing in _touched(scene, fingers) if thing.shape is None]
    closes = hand.squeeze != 0.0 or (hand.guide is not None and hand.guide.squeeze != 0.0)
    if bare and hand.closing == "normal" and closes:
        yield (
            (*at, "closing"),
            f"expected a direction: 'normal' requires an object with a shape, and {bare[0]!r} has none",
        )


def _own_closing(scene: SceneTable, at: Key, hand: Any) -> Iterator[Finding]:
    if isinstance(hand.closing, tuple):
        wrong = list(length_faults(scene, at, hand, "closing"))
        yield from wrong or _zero((*at, "closing"), hand.closing)


def _closing(scene: SceneTable, at: Key, hand: SharedHand, fingers: Sequence[int], stock: Stock) -> Iterator[Finding]:
    closing = hand.closing
    if isinstance(closing, tuple):
        if fingers and len(closing) != len(fingers):
            expected = f"expected a direction for each of the {len(fingers)} fingers"
            yield (*at, "closing"), f"{expected}; given {len(closing)}"
        for i, direction in enumerate(closing):
            if len(direction) != scene.dimensions:
                yield (*at, "closing", i), f"expected {numbers(scene.dimensions)}; given {abbreviate(list(direction))}"
    elif closing == "centre":
        start = np.array(_starts(scene, fingers, stock), dtype=float)
        arms = np.linalg.norm(start - start.mean(axis=0), axis=1) if fingers else np.ones(1)
        if arms.min() <= NEAR * np.abs(start).max(initial=0.0):
            yield (*at, "closing"), "a finger starts at the fingers' mean position, so that it has no closing direction"


def _share(at: Key, hand: SharedHand, fingers: Sequence[int]) -> Iterator[Finding]:
    share = hand.share
    if fingers and isinstance(share, tuple) and len(share) != len(fingers):
        yield (*at, "share"), f"expected one number per finger ({len(fingers)}); given {abbreviate(list(share))}"


def _plugin_faults(
    scene: SceneTable, at: Key, table: MadeHand, fingers: Sequence[int], stock: Stock
) -> Iterator[Finding]:
    kind = table.kind
    module = load_plugin("hands", "hand", kind, stock.folder, "hold(**settings)")
    if isinstance(module, str):
        yield (*at, "kind"), module
        return
    parameters, settings = inspect.signature(module.hold).parameters, table.settings
    clashes = [key for key in settings if key in AUTOMATIC and key in parameters]
    wrong = [((*at, key), "this setting is defined by the scene: remove it from the hand") for key in clashes]
    wrong += signature_faults(at, kind, settings, parameters, AUTOMATIC)
    yield from wrong
    starts = _starts(scene, fingers, stock)
    centres = [thing.position or (0.0,) * scene.dimensions for thing in _touched(scene, fingers)]
    if wrong or not starts or any(len(vector) != scene.dimensions for vector in (*starts, *centres)):
        return
    rest = np.array(starts, dtype=float)
    # normals are known only for a built scene: directions to the objects' centres replace them
    arms = np.array(centres, dtype=float) - rest
    inward = arms / np.maximum(np.linalg.norm(arms, axis=1, keepdims=True), np.finfo(float).tiny)
    try:
        plugin_hand(module, table, rest, inward)
    except InputError as error:
        yield ((*at, error.name), reason(error)) if error.name in settings else (at, str(error))
    except GraspFXError as error:
        yield at, f"hand {kind!r} cannot be created: {error}"


def _starts(scene: SceneTable, fingers: Sequence[int], stock: Stock) -> list[tuple[float, ...]]:
    """List the start positions of fingers; raise NotValid if a start is missing, which is reported as another fault."""
    starts = []
    for i in fingers:
        try:
            start = start_of(scene, i, stock)
        except GraspFXError as error:  # the shape of the object has a fault
            raise NotValid("start") from error
        if start is None:
            raise NotValid("start")
        starts.append(start)
    return starts


def _touched(scene: SceneTable, fingers: Sequence[int]) -> list[Object]:
    """List the objects of fingers; raise NotValid if an object is unknown, which is reported as another fault."""
    things = {thing.name: thing for thing in scene.object}
    if not things:
        raise NotValid("object")
    names = [scene.finger[i].object or scene.object[0].name for i in fingers]
    if not things.keys() >= set(names):
        raise NotValid("object")
    return [things[name] for name in names]
