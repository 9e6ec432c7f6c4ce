"""What the fields of a scene must be to one another; each check skips what has a fault of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from graspfx import plugins
from graspfx.errors import InputError, UnknownNameError, closest, shown
from graspfx.loop import motion
from graspfx.loop.device import Device
from graspfx.objects.body import VISCOUS_LIMIT
from graspfx.objects.kernels import SIZE
from graspfx.scene import bodies
from graspfx.scene.fields import NotValid
from graspfx.scene.hands import Path as RecordedPath
from graspfx.scene.hands import Reach, Sine
from graspfx.scene.parts import WIDTHS, SceneTable
from graspfx.scene.rubbing import metric_faults, own_coefficient, soft_faults
from graspfx.scene.settings import reason, setting_faults
from graspfx.scene.wiring import wiring_faults

Location = tuple[str | int, ...]
Found = tuple[Location, str]

VECTORS = {"box": "size", "ellipsoid": "semi_axes", "half-space": "normal", "plane": "normal"}  # of d numbers
UNIT = 1e-6  # how far from 1 the norm of a quaternion may be: more is a slip of the pen, not rounding
NAMED = {"object": "name", "device": "label", "hand": "name"}
AXES = {"x": 0, "y": 1, "z": 2}


def cross_faults(scene: SceneTable, folder: Path | None) -> list[Found]:
    """Faults between the valid fields of a scene, or of a draft of one."""
    faults: list[Found] = []
    for check in _checks(scene, folder, faults):
        with suppress(NotValid):
            for found in check:
                faults.append(found)  # one by one: those before a field that is not valid stay
    return faults


def _checks(scene: SceneTable, folder: Path | None, faults: list[Found]) -> Iterator[Iterator[Found]]:
    connected: dict[Location, Device] = {}
    yield _enough(scene)
    yield _length(scene, (), scene, "gravity")
    for table in NAMED:
        yield _unique(scene, table)
    yield _finger_names(scene)
    for i, thing in enumerate(_items(scene, "object")):
        for field in ("position", "velocity"):
            yield _length(scene, ("object", i), thing, field)
        for rule in (_shape, _free, _inertia, _turning, _orientation, _angular_velocity, _step):
            yield rule(scene, ("object", i), thing)
        yield _body(scene, ("object", i), thing, faults)
        yield _dynamics(("object", i), thing, folder)
    for i, finger in enumerate(_items(scene, "finger")):
        yield _length(scene, ("finger", i), finger, "start")
        for field in NAMED:
            yield _reference(scene, ("finger", i, field), finger, field)
        yield own_coefficient(scene, ("finger", i, "friction"), finger)
        yield soft_faults(scene, i, finger)
        yield _own_hand(scene, ("finger", i, "hand"), finger, folder)
        yield _own_device(scene, ("finger", i, "device"), finger, folder, connected)
    for i, device in enumerate(_items(scene, "device")):
        yield setting_faults(scene, ("device", i), device, folder, connected)
    for i, hand in enumerate(_items(scene, "hand")):
        yield _motion(scene, ("hand", i, "motion"), hand, folder)
        for half in ("arm", "grip"):
            yield _spring(scene, ("hand", i, half), hand, half)
    yield _channels(scene)
    yield wiring_faults(scene, connected)
    yield metric_faults(scene, connected)
    for table in ("device", "hand"):
        yield _unused(scene, table)
    for share in ("external", "internal"):
        for quantity in ("stiffness", "damping"):
            yield _gain(scene, share, quantity)
        yield _stiff(scene, share)
    yield _fade(scene)
    yield _blend(scene)


def _items(scene: SceneTable, table: str) -> tuple[Any, ...]:
    try:
        items: tuple[Any, ...] = getattr(scene, table)
    except NotValid:
        return ()
    return items


def _enough(scene: SceneTable) -> Iterator[Found]:
    for table in ("object", "finger"):
        if getattr(scene, table) == ():
            yield (table,), "expected at least one"


def _length(scene: SceneTable, at: Location, part: Any, field: str) -> Iterator[Found]:
    value = getattr(part, field)
    if value is not None and len(value) != scene.dimensions:
        yield (*at, field), f"expected {_numbers(scene.dimensions)}; given {shown(list(value))}"


def _numbers(count: int) -> str:
    return "1 number (dimensions = 1)" if count == 1 else f"{count} numbers (dimensions = {count})"


def _unique(scene: SceneTable, table: str) -> Iterator[Found]:
    seen: set[str] = set()
    for i, item in enumerate(_items(scene, table)):
        try:
            name = getattr(item, NAMED[table])
        except NotValid:
            continue
        if name in seen:
            yield (table, i, NAMED[table]), f"{name!r} is taken; every {table} needs a name of its own"
        seen.add(name)


def _finger_names(scene: SceneTable) -> Iterator[Found]:
    names = scene.finger_names
    for i, name in enumerate(names):
        if name in names[:i]:
            yield ("finger", i, "name"), f"{name!r} is taken; every finger needs a name of its own"


def _shape(scene: SceneTable, at: Location, thing: Any) -> Iterator[Found]:
    shape = thing.shape
    if shape is None and scene.coupling.contact == "unilateral":
        yield (*at, "shape"), "required for unilateral contact (coupling.contact = 'attached' needs none)"
    if shape is None:
        return
    wrong = list(_length(scene, (*at, "shape"), shape, VECTORS[shape.kind])) if shape.kind in VECTORS else []
    yield from wrong
    if not wrong:
        try:
            made = bodies.make_shape(thing)
            fits = made is None or made.dimensions_ok(scene.dimensions)
        except InputError as error:
            yield (*at, "shape", error.name), f"given {shown(error.given)}, expected {error.expected}"
            return
        if not fits:
            yield (*at, "shape", "kind"), f"there is no {shape.kind} in {scene.dimensions} dimension(s)"


def _free(scene: SceneTable, at: Location, thing: Any) -> Iterator[Found]:
    width = WIDTHS[scene.dimensions]
    if thing.free is not None and len(thing.free) != width:
        what = {1: "translation", 3: "two translations, one rotation", 6: "three translations, three rotations"}[width]
        yield (*at, "free"), f"expected {width} of true or false ({what}); given {shown(list(thing.free))}"


def _turns(scene: SceneTable, thing: Any) -> bool:
    free = scene.free(thing)
    return len(free) == WIDTHS[scene.dimensions] and any(free[scene.dimensions :])


def _inertia(scene: SceneTable, at: Location, thing: Any) -> Iterator[Found]:
    inertia, d = thing.inertia, scene.dimensions
    if inertia is None:
        if _turns(scene, thing) and thing.shape is None and scene.coupling.contact == "attached":
            yield (*at, "inertia"), "required where a rotation is free and there is no shape to compute it from"
        return
    values = inertia if isinstance(inertia, tuple) else (inertia,)
    if d == 1:
        yield (*at, "inertia"), "a line has no rotation: leave it out"
    elif isinstance(inertia, tuple) and len(values) != (3 if d == 3 else 1):
        expected = "a number or 3 numbers" if d == 3 else "a number"
        yield (*at, "inertia"), f"expected {expected}; given {shown(list(values))}"
    elif min(values) <= 0:
        yield (*at, "inertia"), f"expected more than 0; given {shown(inertia)}"


def _turning(scene: SceneTable, at: Location, thing: Any) -> Iterator[Found]:
    if thing.rotational_viscosity is None and _turns(scene, thing):
        yield (
            (*at, "rotational_viscosity"),
            "required where a rotation is free: without it a grasp is not stable; `free` locks it",
        )


def _orientation(scene: SceneTable, at: Location, thing: Any) -> Iterator[Found]:
    yield from _turned(scene, at, "orientation", thing.orientation, "a quaternion of 4 numbers x, y, z, w", 4)
    value = thing.orientation
    if scene.dimensions == 3 and isinstance(value, tuple) and len(value) == 4:
        norm = float(np.linalg.norm(value))
        if abs(norm - 1.0) > UNIT:
            yield (*at, "orientation"), f"expected a quaternion of norm 1; its norm is {norm:.6g}"


def _angular_velocity(scene: SceneTable, at: Location, thing: Any) -> Iterator[Found]:
    yield from _turned(scene, at, "angular_velocity", thing.angular_velocity, "3 numbers", 3)


def _turned(scene: SceneTable, at: Location, field: str, value: Any, in_space: str, count: int) -> Iterator[Found]:
    if value is None:
        return
    if scene.dimensions == 1:
        yield (*at, field), "a line has no rotation: leave it out"
    elif scene.dimensions == 2 and isinstance(value, tuple):
        yield (*at, field), f"expected a number in the plane; given {shown(list(value))}"
    elif scene.dimensions == 3 and (not isinstance(value, tuple) or len(value) != count):
        yield (*at, field), f"expected {in_space}; given {shown(value)}"


def _step(scene: SceneTable, at: Location, thing: Any) -> Iterator[Found]:
    if thing.dynamics != "native" or thing.integrator not in ("explicit", "semi-implicit"):
        return
    if any(scene.free(thing)[: scene.dimensions]):
        yield from _slowed(scene, at, thing, "viscosity", thing.viscosity, "mass", thing.mass)
    if thing.rotational_viscosity is not None and _turns(scene, thing):
        with suppress(InputError):  # a shape of another number of dimensions has its own fault
            moments = np.atleast_1d(np.asarray(bodies.inertia(scene, thing) or 0.0, dtype=float))
            least = float(moments[-1] if scene.dimensions == 2 else moments.min())
            if least > 0.0:
                viscosity = thing.rotational_viscosity
                yield from _slowed(scene, at, thing, "rotational_viscosity", viscosity, "inertia", least)


def _slowed(
    scene: SceneTable, at: Location, thing: Any, key: str, viscosity: float, by: str, inertia: float
) -> Iterator[Found]:
    ratio = viscosity * scene.period / inertia
    if ratio >= VISCOUS_LIMIT:
        yield (
            (*at, key),
            f"{key} * period / {by} is {ratio:.4g}, and {thing.integrator} integration is stable only below "
            f"{VISCOUS_LIMIT:g}; integrator = 'exact' always is",
        )


def _body(scene: SceneTable, at: Location, thing: Any, faults: list[Found]) -> Iterator[Found]:
    """What the body itself refuses, where nothing else has been found."""
    if any(found[: len(at)] == at or found == ("gravity",) for found, _ in faults):
        return
    try:
        bodies.fill(scene, thing, np.zeros(SIZE))
    except InputError as error:
        yield (*at, error.name), reason(error)


def _dynamics(at: Location, thing: Any, folder: Path | None) -> Iterator[Found]:
    try:
        plugins.find("dynamics", thing.dynamics, folder)
    except (UnknownNameError, InputError) as error:
        yield (*at, "dynamics"), reason(error)
    if thing.dynamics == "bullet" and find_spec("pybullet") is None:
        yield (
            (*at, "dynamics"),
            "'bullet' needs the package pybullet, which is not installed: pip install 'graspfx[bullet]', "
            "or dynamics = 'native'",
        )


def _reference(scene: SceneTable, at: Location, finger: Any, table: str) -> Iterator[Found]:
    name = getattr(finger, table)
    if not isinstance(name, str):
        return
    names = [getattr(item, NAMED[table]) for item in getattr(scene, table)]
    if name not in names:
        close = closest(name, names)
        hint = f"; did you mean {close!r}?" if close else f" (known: {', '.join(names)})" if names else ""
        yield at, f"no [[{table}]] has the {NAMED[table]} {name!r}{hint}"


def _own_hand(scene: SceneTable, at: Location, finger: Any, folder: Path | None) -> Iterator[Found]:
    hand = finger.hand
    if hand is None or isinstance(hand, str):
        return
    for check in (
        _length(scene, at, hand, "rest"),
        _spring(scene, at, finger, "hand"),
        _motion(scene, (*at, "motion"), hand, folder),
    ):
        with suppress(NotValid):
            yield from check


def _own_device(
    scene: SceneTable, at: Location, finger: Any, folder: Path | None, connected: dict[Location, Device]
) -> Iterator[Found]:
    if not isinstance(finger.device, str):
        yield from setting_faults(scene, at, finger.device, folder, connected)


def _spring(scene: SceneTable, at: Location, owner: Any, field: str) -> Iterator[Found]:
    spring = getattr(owner, field)
    for quantity in ("stiffness", "damping"):
        if isinstance(getattr(spring, quantity), tuple):
            yield from _length(scene, at, spring, quantity)


def _motion(scene: SceneTable, at: Location, hand: Any, folder: Path | None) -> Iterator[Found]:
    meant = hand.motion
    if isinstance(meant, Sine) and AXES.get(str(meant.axis), meant.axis) not in range(scene.dimensions):
        yield (*at, "axis"), f"expected an axis of {scene.dimensions} dimensions; given {shown(meant.axis)}"
    elif isinstance(meant, Reach):
        yield from _length(scene, at, meant, "displacement")
    elif isinstance(meant, RecordedPath):
        yield from _recorded(scene, at, meant, folder)


def _recorded(scene: SceneTable, at: Location, path: RecordedPath, folder: Path | None) -> Iterator[Found]:
    times, positions = path.times, path.positions
    if path.file is not None:
        if times is not None or positions is not None:
            yield (*at, "file"), "expected either a file or times and positions, not both"
            return
        try:
            recorded = motion.Path.read((folder or Path()) / Path(path.file).expanduser())
        except InputError as error:
            yield (*at, "file"), reason(error)
            return
        if recorded.dimensions != scene.dimensions:
            yield (*at, "file"), f"expected {_numbers(scene.dimensions)} after the time; given {recorded.dimensions}"
        return
    if times is None or positions is None:
        yield at, "expected a file, or times and positions"
        return
    if len(times) < 2 or min(np.diff(times)) <= 0.0:
        yield (*at, "times"), "expected at least two times, rising"
    if len(times) != len(positions):
        yield (*at, "positions"), f"expected one for each of the {len(times)} times; given {len(positions)}"
    for i, position in enumerate(positions):
        if len(position) != scene.dimensions:
            yield (*at, "positions", i), f"expected {_numbers(scene.dimensions)}; given {shown(list(position))}"
            return


def _channels(scene: SceneTable) -> Iterator[Found]:
    taken: dict[tuple[str, int], int] = {}
    for i, finger in enumerate(scene.finger):
        try:
            key = (finger.device, finger.channel)
        except NotValid:
            continue
        if not isinstance(key[0], str):
            continue
        if key in taken:
            yield ("finger", i, "channel"), f"channel {key[1]} of {key[0]!r} is finger {taken[key]}'s already"
        taken.setdefault((key[0], key[1]), i)


def _unused(scene: SceneTable, table: str) -> Iterator[Found]:
    used = {getattr(finger, table) for finger in scene.finger if isinstance(getattr(finger, table), str)}
    for i, item in enumerate(getattr(scene, table)):
        if getattr(item, NAMED[table]) not in used:
            yield (table, i, NAMED[table]), f"no finger names {getattr(item, NAMED[table])!r}"


def _gain(scene: SceneTable, share: str, quantity: str) -> Iterator[Found]:
    given = np.asarray(getattr(getattr(scene.coupling, share), quantity))
    n, d, objects = len(scene.finger), scene.dimensions, len(scene.object)
    m = n * d
    forms: dict[int, list[tuple[int, ...]]] = {0: [()], 1: [(n,)], 2: [(d, d), (m, m)], 3: [(n, d, d)]}
    at = ("coupling", share, quantity)
    if given.shape not in forms[given.ndim]:
        sizes = " or ".join(" x ".join(map(str, shape)) for shape in forms[given.ndim])
        yield at, f"expected {sizes} numbers for {n} fingers in {d} dimensions; given {_size(given.shape)}"
    elif given.ndim == 2 and given.shape != (d, d) and objects > 1:
        yield at, "an m x m matrix couples all fingers: it needs a scene with one object"


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def _stiff(scene: SceneTable, share: str) -> Iterator[Found]:
    if scene.coupling.contact != "unilateral":
        return
    stiffness = np.asarray(getattr(scene.coupling, share).stiffness)
    least = float((np.linalg.eigvalsh(stiffness) if stiffness.ndim > 1 else stiffness).min())
    if least <= 0.0:
        what = "eigenvalues of more than 0" if stiffness.ndim > 1 else "more than 0"
        yield (
            ("coupling", share, "stiffness"),
            f"unilateral contact expects {what}; the least is {least:.6g} (contact = 'attached' takes 0)",
        )


def _fade(scene: SceneTable) -> Iterator[Found]:
    low, high = scene.coupling.fade
    if not 0.0 <= low < high:
        yield ("coupling", "fade"), f"expected [h1, h2] with 0 <= h1 < h2; given {shown([low, high])}"


def _blend(scene: SceneTable) -> Iterator[Found]:
    low, high = scene.coupling.blend
    if not 0.0 < low < high:
        yield ("coupling", "blend"), f"expected [l1, l2] with 0 < l1 < l2; given {shown([low, high])}"
