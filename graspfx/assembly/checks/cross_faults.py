"""Faults that concern several fields of a scene, in the order of the scene's tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from graspfx import plugins
from graspfx.assembly import bodies
from graspfx.assembly.bodies import Stock
from graspfx.assembly.checks.body_faults import (
    light_faults,
    mass_faults,
    may_turn,
    meeting_faults,
    shape_faults,
    viscosity_faults,
)
from graspfx.assembly.checks.hand_faults import own_hand_faults, shared_hand_faults
from graspfx.assembly.checks.settings import length_faults as _length
from graspfx.assembly.checks.settings import load_plugin, numbers, reason, record_faults, setting_faults
from graspfx.assembly.resolve import placement_faults
from graspfx.assembly.wiring import wiring_faults
from graspfx.cones.friction import LEAST
from graspfx.errors import InputError, abbreviate, closest
from graspfx.loop.device import Device, is_hardware
from graspfx.objects.dynamics_table import dynamics_of
from graspfx.objects.integrators import SIZE
from graspfx.scene.keys import Finding, Key
from graspfx.scene.tables.fields import NotValid
from graspfx.scene.tables.part_tables import ObjectImpedance
from graspfx.scene.tables.reading import WIDTHS
from graspfx.scene.tables.scene_table import OBJECT, SceneTable


def safety_faults(scene: SceneTable) -> Iterator[Finding]:
    """Find the faults of a scene's table `safety`."""
    table = scene.safety
    if table is not None:
        yield from _box_faults(scene, ("safety",), table)
        if table.watchdog is not None and table.watchdog < scene.period:
            text = f"expected no less than the period, {scene.period:g} s; given {table.watchdog:g}"
            yield ("safety", "watchdog"), text


def host_faults(scene: SceneTable) -> Iterator[Finding]:
    """Find tables that a scene with a host must not define, because the host program simulates objects and contacts."""
    if scene.host is None:
        return
    with suppress(NotValid):
        things = scene.object
        if (
            len(things) != 1
            or things[0].name != OBJECT["name"]
            or things[0].shape is not None
            or any(scene.free(things[0]))
        ):
            yield ("object",), "expected no object with [host], whose program simulates the object; remove it"
    if scene.obstacle:
        yield ("obstacle",), "expected no obstacle with [host], whose program simulates the world; remove it"
    with suppress(NotValid):
        law = scene.coupling
        if law.passivity != "off" or law.contact != "attached":
            yield ("coupling",), "expected no coupling with [host], whose program computes contacts; remove it"


def finger_safety_faults(scene: SceneTable, i: int, finger: Any) -> Iterator[Finding]:
    """Find the faults of the table `safety` of finger i."""
    if finger.safety is not None:
        yield from _box_faults(scene, ("finger", i, "safety"), finger.safety)


def chain_faults(scene: SceneTable, connected: Mapping[Key, Device]) -> Iterator[Finding]:
    """Find fingers' limits in a simulation without a safety chain, and hardware without a soft start."""
    hardware = any(map(is_hardware, connected.values()))
    if scene.safety is None:
        for i, finger in enumerate(scene.finger):
            if finger.safety is not None and not hardware and scene.host is None:
                text = "without a table [safety], a simulation has no safety chain that uses these limits; add [safety]"
                yield ("finger", i, "safety"), text
    elif hardware and scene.safety.soft_start == 0.0:
        yield ("safety", "soft_start"), "expected a time above zero, because a person holds the hardware; given 0"


def _box_faults(scene: SceneTable, at: Key, table: Any) -> Iterator[Finding]:
    box = table.workspace
    if isinstance(box, tuple) and len(box[0]) != scene.dimensions:
        expected = numbers(scene.dimensions)
        yield (*at, "workspace"), f"expected two corners of {expected} each; given {abbreviate([list(x) for x in box])}"


def own_coefficient(scene: SceneTable, at: Key, finger: Any) -> Iterator[Finding]:
    """Find a friction coefficient in a finger's table that the coupling does not allow."""
    if finger.friction is None:
        return
    if scene.coupling.contact == "attached":
        yield at, "attached contacts (coupling.contact = 'attached') do not slip: remove the friction coefficient"
    elif scene.coupling.friction == "stick":
        yield (
            at,
            "coupling.friction = 'stick' prevents all slip: remove the finger's coefficient, or set a number there",
        )


def soft_faults(scene: SceneTable, i: int, finger: Any) -> Iterator[Finding]:
    """Find settings that a soft finger lacks or does not support, and settings of soft fingers on a hard finger."""
    at: Key = ("finger", i, "patch")
    if finger.model == "hard":
        if finger.patch is not None:
            yield at, "only soft fingers have this setting (model = 'soft')"
        return
    if scene.dimensions != 3:
        yield (
            ("finger", i, "model"),
            f"a soft finger has torsion, which requires three dimensions; given {scene.dimensions}: use model = 'hard'",
        )
        return
    if finger.patch is None:
        yield at, "required for a soft finger: the radius of its contact patch [m], which determines its torsion"
    coupling = scene.coupling
    parts = [part for part in (coupling.external, coupling.internal) if not isinstance(part, ObjectImpedance)]
    if any(np.ndim(gain) for part in parts for gain in (part.stiffness, part.damping)):
        yield (
            ("finger", i, "model"),
            "soft fingers require one number for each gain, or a stiffness of the object as a matrix",
        )
    if coupling.contact == "attached":
        if scene.object[scene.finger_objects[i]].shape is None:
            yield ("finger", i, "model"), "a soft finger requires an object with a shape: torsion is about the normal"
    elif coupling.friction != "stick" and scene.coefficients[i] == 0.0:
        yield (
            ("finger", i, "model"),
            "torsion of a soft finger requires friction: set coupling.friction or the finger's friction",
        )


def pad_faults(scene: SceneTable, i: int, finger: Any) -> Iterator[Finding]:
    """Find a finger with a compliant pad if the coupling or the object's integrator does not support pads."""
    if finger.pad is None:
        return
    at: Key = ("finger", i, "pad")
    coupling, thing = scene.coupling, scene.object[scene.finger_objects[i]]
    if coupling.contact == "attached":
        yield at, "expected unilateral contact: a pad can only push, but attached contacts also pull"
    implicit = thing.dynamics == "native" and thing.integrator == "implicit"
    if implicit and any(np.any(part.damping) for part in (coupling.external, coupling.internal)):
        text = "expected no damping with the integrator 'implicit', which solves for elastic and damping force together"
        yield at, f"{text}, whereas a pad deforms under the elastic force alone; use another integrator, or no damping"


def contact_axes_faults(scene: SceneTable, share: str) -> Iterator[Finding]:
    """Find gain matrices of a share, "external" or "internal", that are not allowed in contact axes.

    An allowed matrix is diagonal, with the gain along the normal first, and equal gains along all tangents.
    """
    coupling, d = scene.coupling, scene.dimensions
    if isinstance(getattr(coupling, share), ObjectImpedance):
        if coupling.axes != "object":
            yield ("coupling", "axes"), "expected 'object': the stiffness of an object is defined in the object's axes"
        return
    if coupling.axes != "contact":
        return
    for quantity in ("stiffness", "damping"):
        at: Key = ("coupling", share, quantity)
        gain = np.asarray(getattr(getattr(coupling, share), quantity), dtype=float)
        if gain.ndim < 2:
            continue
        if gain.shape[-1] != d:
            yield at, f"with contact axes, expected one {d} x {d} matrix, or one {d} x {d} matrix per finger"
            continue
        even = gain * np.eye(d)
        if np.array_equal(even, gain) and (gain[..., d - 1, d - 1] == gain[..., 1 % d, 1 % d]).all():
            continue
        form = {1: "[[k_n]]", 2: "[[k_n, 0], [0, k_t]]", 3: "[[k_n, 0, 0], [0, k_t, 0], [0, 0, k_t]]"}[d]
        yield at, f"with contact axes, expected {form}, with the gain along the normal first and equal tangential gains"
    if share == "external" and coupling.contact == "attached" and any(thing.shape is None for thing in scene.object):
        yield ("coupling", "axes"), "'contact' requires objects with a shape, which have normals"


def control_faults(scene: SceneTable, connected: Mapping[Key, Device]) -> Iterator[Finding]:
    """Find devices that do not report their mass, which passivity control requires to limit its damping."""
    if scene.coupling.passivity != "control":
        return
    for at, device in connected.items():
        if device.features.mass is None:
            where = ".".join(map(str, at))
            text = f"'control' requires every device to report its mass; the device of {where} does not"
            yield ("coupling", "passivity"), f"{text} ('observe' requires no mass)"


def metric_faults(scene: SceneTable, connected: Mapping[Key, Device]) -> Iterator[Finding]:
    """Find invalid weights of the split, and devices that do not report the mass that a mass metric requires."""
    coupling = scene.coupling
    if coupling.metric == "mass" and coupling.split != "mass":
        yield ("coupling", "metric"), f"coupling.split = {coupling.split!r} defines the weights: remove the metric"
    weights, n = coupling.weights, len(scene.finger)
    if (weights is not None) != (coupling.split == "weights"):
        wanted = "a number above zero for each finger" if weights is None else "no weights without split = 'weights'"
        yield ("coupling", "weights"), f"expected {wanted}"
    elif weights is not None and (len(weights) != n or not all(weight > 0.0 for weight in weights)):
        yield ("coupling", "weights"), f"expected {n} numbers above zero, one per finger; given {list(weights)}"
    if coupling.split != "mass":
        return
    key = "metric" if coupling.metric == "mass" else "split"
    for at, device in connected.items():
        if device.features.mass is None:
            where = ".".join(map(str, at))
            yield ("coupling", key), f"'mass' requires every device to report its mass; the device of {where} does not"


UNIT = 1e-6  # tolerance of a quaternion's norm; more is a typing error, not rounding
NAME_KEYS = {"object": "name", "device": "label", "hand": "name"}


def cross_faults(scene: SceneTable, stock: Stock) -> list[Finding]:
    """Find the faults that concern several valid fields of a scene or of a draft."""
    faults: list[Finding] = []
    for check in _checks(scene, stock, faults):
        with suppress(NotValid):
            for finding in check:
                faults.append(finding)  # not by `extend`, so that faults found before an invalid field are kept
    return faults


def _checks(scene: SceneTable, stock: Stock, faults: list[Finding]) -> Iterator[Iterator[Finding]]:
    yield _enough(scene)
    yield _length(scene, (), scene, "gravity")
    for table in (*NAME_KEYS, "finger"):
        yield _unique(scene, table)
    for i, thing in enumerate(_items(scene, "object")):
        for field in ("position", "velocity"):
            yield _length(scene, ("object", i), thing, field)
        yield shape_faults(scene, ("object", i), thing, stock)
        yield mass_faults(scene, ("object", i), thing)
        for rule in (_free, _inertia, _turning, _orientation, _angular_velocity):
            yield rule(scene, ("object", i), thing)
        yield viscosity_faults(scene, ("object", i), thing, stock)
        yield _body(scene, ("object", i), thing, stock, faults)
        yield _dynamics(("object", i), thing, stock.folder)
        yield light_faults(scene, ("object", i), thing, stock)
    for i, thing in enumerate(_items(scene, "obstacle")):
        yield _length(scene, ("obstacle", i), thing, "position")
        yield shape_faults(scene, ("obstacle", i), thing, stock)
        yield _orientation(scene, ("obstacle", i), thing)
    yield _unique(scene, "obstacle")
    yield meeting_faults(scene, stock, faults)
    yield host_faults(scene)
    yield safety_faults(scene)
    for i, finger in enumerate(_items(scene, "finger")):
        yield _start(scene, i, finger, stock)
        for field in NAME_KEYS:
            yield _reference(scene, ("finger", i, field), finger, field)
        yield own_hand_faults(scene, i, stock)
        yield own_coefficient(scene, ("finger", i, "friction"), finger)
        yield soft_faults(scene, i, finger)
        yield pad_faults(scene, i, finger)
        yield finger_safety_faults(scene, i, finger)
        yield _own_device(scene, ("finger", i, "device"), finger, stock)
    for i, device in enumerate(_items(scene, "device")):
        yield setting_faults(scene, ("device", i), device, stock)
    for i, hand in enumerate(_items(scene, "hand")):
        yield shared_hand_faults(scene, ("hand", i), hand, stock)
    yield _channels(scene)
    yield wiring_faults(scene, stock.devices)
    yield metric_faults(scene, stock.devices)
    yield control_faults(scene, stock.devices)
    yield chain_faults(scene, stock.devices)
    for table in ("device", "hand"):
        yield _unused(scene, table)
    for share in ("external", "internal"):
        for quantity in ("stiffness", "damping"):
            yield _gain(scene, share, quantity)
        yield _stiff(scene, share)
        yield contact_axes_faults(scene, share)
    for quantity in ("stiffness", "damping"):
        yield _ratio(scene, quantity)
    yield record_faults(scene)
    yield _pair(scene, "fade", "auto", "h", "<=")
    yield _pair(scene, "blend", "off", "l", "<")


def _start(scene: SceneTable, i: int, finger: Any, stock: Stock) -> Iterator[Finding]:
    if isinstance(finger.start, tuple):
        yield from _length(scene, ("finger", i), finger, "start")
        return
    wrong = list(_length(scene, ("finger", i, "start"), finger.start, "toward"))
    yield from wrong or placement_faults(scene, i, stock)


def _items(scene: SceneTable, table: str) -> tuple[Any, ...]:
    try:
        items: tuple[Any, ...] = getattr(scene, table)
    except NotValid:
        return ()
    return items


def _enough(scene: SceneTable) -> Iterator[Finding]:
    for table in ("object", "finger"):
        if getattr(scene, table) == ():
            yield (table,), "expected at least one"


def _unique(scene: SceneTable, table: str) -> Iterator[Finding]:
    key = NAME_KEYS.get(table, "name")
    given = [getattr(item, key, NotValid) for item in _items(scene, table)]
    names = scene.finger_names if table == "finger" else given  # fingers without a name are numbered
    for i, name in enumerate(names):
        if name is not NotValid and name in names[:i]:
            yield (table, i, key), f"{name!r} is the name of an earlier {table}; expected a different name"


def _free(scene: SceneTable, at: Key, thing: Any) -> Iterator[Finding]:
    width = WIDTHS[scene.dimensions]
    if thing.free is not None and len(thing.free) != width:
        moves = {1: "translation", 3: "two translations, one rotation", 6: "three translations, three rotations"}[width]
        yield (*at, "free"), f"expected {width} values, true or false ({moves}); given {abbreviate(list(thing.free))}"


def _inertia(scene: SceneTable, at: Key, thing: Any) -> Iterator[Finding]:
    inertia, d = thing.inertia, scene.dimensions
    if inertia is None:
        if may_turn(scene, thing) and thing.shape is None and scene.coupling.contact == "attached":
            yield (*at, "inertia"), "required if a rotation is free and there is no shape from which to compute it"
        return
    values = inertia if isinstance(inertia, tuple) else (inertia,)
    if d == 1:
        yield (*at, "inertia"), "an object in one dimension does not rotate: remove the inertia"
    elif isinstance(inertia, tuple) and len(values) != (3 if d == 3 else 1):
        expected = "a number or 3 numbers" if d == 3 else "a number"
        yield (*at, "inertia"), f"expected {expected}; given {abbreviate(list(values))}"
    elif min(values) <= 0:
        yield (*at, "inertia"), f"expected more than 0; given {abbreviate(inertia)}"


def _turning(scene: SceneTable, at: Key, thing: Any) -> Iterator[Finding]:
    if thing.rotational_viscosity is None and may_turn(scene, thing):
        yield (
            (*at, "rotational_viscosity"),
            "required if a rotation is free, because otherwise a grasp is not stable; or lock the rotation with `free`",
        )


def _orientation(scene: SceneTable, at: Key, thing: Any) -> Iterator[Finding]:
    yield from _turned(scene, at, "orientation", thing.orientation, "a quaternion of 4 numbers x, y, z, w", 4)
    value = thing.orientation
    if scene.dimensions == 3 and isinstance(value, tuple) and len(value) == 4:
        norm = float(np.linalg.norm(value))
        if abs(norm - 1.0) > UNIT:
            yield (*at, "orientation"), f"expected a unit quaternion; its norm is {norm:.6g}"


def _angular_velocity(scene: SceneTable, at: Key, thing: Any) -> Iterator[Finding]:
    yield from _turned(scene, at, "angular_velocity", thing.angular_velocity, "3 numbers", 3)


def _turned(scene: SceneTable, at: Key, field: str, value: Any, in_space: str, count: int) -> Iterator[Finding]:
    if value is None:
        return
    if scene.dimensions == 1:
        yield (*at, field), f"an object in one dimension does not rotate: remove {field}"
    elif scene.dimensions == 2 and isinstance(value, tuple):
        yield (*at, field), f"expected a number in the plane; given {abbreviate(list(value))}"
    elif scene.dimensions == 3 and (not isinstance(value, tuple) or len(value) != count):
        yield (*at, field), f"expected {in_space}; given {abbreviate(value)}"


def _body(scene: SceneTable, at: Key, thing: Any, stock: Stock, faults: list[Finding]) -> Iterator[Finding]:
    """Find errors in filling the object's block; find none if an earlier fault concerns the object or gravity."""
    if any(place[: len(at)] == at or place == ("gravity",) for place, _ in faults):
        return
    try:
        bodies.fill(scene, thing, stock.solid(at, thing), np.zeros(SIZE))
    except InputError as error:
        yield (*at, error.name), reason(error)


def _dynamics(at: Key, thing: Any, folder: Path | None) -> Iterator[Finding]:
    if thing.dynamics not in plugins.BUILT_IN["dynamics"]:
        module = load_plugin("dynamics", "dynamics", thing.dynamics, folder, "create(state)")
        if isinstance(module, str):
            yield (*at, "dynamics"), module
    engine = dynamics_of(thing.dynamics)
    if engine.missing:
        yield (
            (*at, "dynamics"),
            f"{engine.name!r} needs the package {engine.package}, which is not installed: {engine.remedy}",
        )


def _reference(scene: SceneTable, at: Key, finger: Any, table: str) -> Iterator[Finding]:
    name = getattr(finger, table)
    if not isinstance(name, str):
        return
    names = [getattr(item, NAME_KEYS[table]) for item in getattr(scene, table)]
    if name not in names:
        close = closest(name, names)
        hint = f"; did you mean {close!r}?" if close else f" (known: {', '.join(names)})" if names else ""
        yield at, f"no [[{table}]] has the {NAME_KEYS[table]} {name!r}{hint}"


def _own_device(scene: SceneTable, at: Key, finger: Any, stock: Stock) -> Iterator[Finding]:
    if not isinstance(finger.device, str):
        yield from setting_faults(scene, at, finger.device, stock)


def _channels(scene: SceneTable) -> Iterator[Finding]:
    users: dict[tuple[str, int], int] = {}
    for i, finger in enumerate(scene.finger):
        try:
            key = (finger.device, finger.channel)
        except NotValid:
            continue
        if not isinstance(key[0], str):
            continue
        if key in users:
            yield ("finger", i, "channel"), f"channel {key[1]} of {key[0]!r} is already used by finger {users[key]}"
        users.setdefault((key[0], key[1]), i)


def _unused(scene: SceneTable, table: str) -> Iterator[Finding]:
    used = {getattr(finger, table) for finger in scene.finger if isinstance(getattr(finger, table), str)}
    for i, item in enumerate(getattr(scene, table)):
        if getattr(item, NAME_KEYS[table]) not in used:
            name = getattr(item, NAME_KEYS[table])
            yield (
                (table, i, NAME_KEYS[table]),
                f"no finger refers to {name!r}: use it in a finger, or remove the {table}",
            )


def _gain(scene: SceneTable, share: str, quantity: str) -> Iterator[Finding]:
    part = getattr(scene.coupling, share)
    if isinstance(part, ObjectImpedance):
        yield from _object_gain(scene, part, quantity)
        return
    value = np.asarray(getattr(part, quantity))
    n, d, objects = len(scene.finger), scene.dimensions, len(scene.object)
    m = n * d
    forms: dict[int, list[tuple[int, ...]]] = {0: [()], 1: [(n,)], 2: [(d, d), (m, m)], 3: [(n, d, d)]}
    at = ("coupling", share, quantity)
    if value.shape not in forms[value.ndim]:
        sizes = " or ".join(" x ".join(map(str, shape)) for shape in forms[value.ndim])
        yield at, f"expected {sizes} numbers for {n} fingers in {d} dimensions; given {_size(value.shape)}"
    elif value.ndim == 2 and value.shape != (d, d) and objects > 1:
        yield at, f"a {m} x {m} matrix couples all fingers: expected a scene with one object; given {objects}"


def _object_gain(scene: SceneTable, part: ObjectImpedance, quantity: str) -> Iterator[Finding]:
    value, d = getattr(part, f"object_{quantity}"), scene.dimensions
    w = WIDTHS[d]
    shape = np.shape(value)
    if value is not None and shape not in ((w, w), (w,), *([()] if w == 1 else [])):
        expected = f"{w} x {w} numbers on the object's degrees of freedom, or {w} on its diagonal"
        yield ("coupling", "external", f"object_{quantity}"), f"expected {expected}; given {_size(shape) or 'a number'}"
    if quantity == "stiffness" and part.object_point is not None and len(part.object_point) != d:
        yield ("coupling", "external", "object_point"), f"expected {d} coordinates [m]"


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def _stiff(scene: SceneTable, share: str) -> Iterator[Finding]:
    if scene.coupling.contact != "unilateral":
        return
    part = getattr(scene.coupling, share)
    stiffness = np.asarray(part.stiffness)
    if stiffness.ndim > 1 and stiffness.shape[0] != stiffness.shape[1]:
        return
    key = "object_stiffness" if isinstance(part, ObjectImpedance) else "stiffness"
    least = float((np.linalg.eigvalsh(stiffness) if stiffness.ndim > 1 else stiffness).min())
    if least <= 0.0:
        expected = "eigenvalues of more than 0" if stiffness.ndim > 1 else "more than 0"
        yield (
            ("coupling", share, key),
            f"unilateral contact requires {expected}; the smallest is {least:.6g} (contact = 'attached' allows 0)",
        )


def _ratio(scene: SceneTable, quantity: str) -> Iterator[Finding]:
    if scene.coupling.contact != "unilateral":
        return
    gains = {share: np.asarray(getattr(getattr(scene.coupling, share), quantity)) for share in ("external", "internal")}
    if any(gain.ndim for gain in gains.values()):
        return
    small, large = sorted(gains, key=lambda share: float(gains[share]))
    if 0.0 < gains[small] < LEAST * gains[large]:
        unit, instead = ("N/m", "") if quantity == "stiffness" else ("N s/m", ", or 0")
        yield (
            ("coupling", small, quantity),
            f"unilateral contact requires at least {LEAST:g} times coupling.{large}.{quantity} "
            f"({LEAST * gains[large]:.6g} {unit}){instead}; given {gains[small]:.6g} (contact = 'attached' allows any)",
        )


def _pair(scene: SceneTable, key: str, word: str, letter: str, relation: str) -> Iterator[Finding]:
    """Find a pair of lengths in `coupling` that is not `0 <= low < high`, or `0 < low < high` if `relation` is "<".

    The value `word` instead of a pair is valid.
    """
    pair = getattr(scene.coupling, key)
    if pair == word:
        return
    low, high = pair
    if not (0.0 <= low < high if relation == "<=" else 0.0 < low < high):
        expected = f"[{letter}1, {letter}2] with 0 {relation} {letter}1 < {letter}2"
        yield ("coupling", key), f"expected {expected}; given {abbreviate([low, high])}"
