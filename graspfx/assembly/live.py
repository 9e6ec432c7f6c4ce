"""Keys of a scene whose values may change during a run, and reasons why other values may not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from graspfx.errors import GraspFXError, InputError, UnknownNameError, closest
from graspfx.scene.keys import LISTS, NAMES, general, number_of, reaches

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

GAINS = tuple(
    f"coupling.{share}.{quantity}" for share in ("external", "internal") for quantity in ("stiffness", "damping")
)
OBJECT_GAINS = ("coupling.external.object_stiffness", "coupling.external.object_damping")
RULES = ("coupling.friction", "finger.*.friction", "coupling.damping_depth", "coupling.fade", "coupling.blend")
INERTIA = ("object.*.mass", "object.*.density", "object.*.inertia")
BODY = (*INERTIA, "object.*.viscosity", "object.*.rotational_viscosity", "gravity")
DEVICE = ("finger.*.device.mass", "finger.*.device.damping", "device.*.mass", "device.*.damping")
OF_HANDS = (
    "stiffness", "damping", "rest", "squeeze", "squeeze_ramp", "motion", "turn", "arm", "grip", "share",
    "limb", "stiffening", "reaction.stiffness", "reaction.damping", "reaction.force", "tremor", "noise.share",
)  # fmt: skip
GUIDE = tuple(f"{table}.guide.{name}" for table in ("finger.*.hand", "hand.*") for name in ("offset", "squeeze"))
HAND = (*(f"{table}.{name}" for table in ("finger.*.hand", "hand.*") for name in OF_HANDS), *GUIDE)

REASONS = {
    ("period", "duration"): "ticks are counted in periods, and a session runs until it is closed",
    ("dimensions", "engine", "title", "preset"): "its value is fixed for the whole run",
    ("object.*.position", "object.*.orientation", "object.*.velocity", "object.*.angular_velocity", "finger.*.start"): (
        "its value defines the start of the run; afterwards, objects and fingers continue from their present state"
    ),
    (
        "coupling.contact",
        "coupling.form",
        "coupling.axes",
        "coupling.reaction",
        "coupling.absent",
        "coupling.metric",
        "coupling.split",
        "coupling.weights",
        "coupling.external.object_point",
    ): ("its value selects the computation of forces"),
    ("coupling.enter",): "its value only affects the start of the run",
    ("coupling.passivity",): "its value selects whether energy is observed or controlled in the whole run",
    ("safety", "finger.*.safety"): "limits of the safety chain are fixed for the whole run",
    ("object", "obstacle", "world"): "its value defines which bodies exist and how they move",
    ("hand.*.guide", "finger.*.hand.guide"): "of a guide, only offset and squeeze can change",
    ("finger.*.hand.reaction", "hand.*.reaction"): "of a reaction, only stiffness, damping and force can change",
    ("finger.*.hand.noise", "hand.*.noise"): "of a noise, only the share can change",
    ("finger", "device", "hand"): "its value defines the connected devices, or the memory layout of contacts",
}


def live_fields(keys: Iterable[str]) -> frozenset[str]:
    """Return the names of the fields of grasps' blocks that select the computation and depend on live keys.

    Raises:
        InputError: If a key is not a text, or its value cannot change during a run; the message states the reason.
        UnknownNameError: If a key exists in no scene.
    """
    return frozenset().union(*(_choices(general(require(key))) for key in keys))


def _choices(plain: str) -> frozenset[str]:
    if plain in GAINS:
        _, share, quantity = plain.split(".")
        kinds = ("damped", "singular", "gradual") if quantity == "damping" else ()
        return frozenset({f"{share}_{quantity}", "equal", "rays", "stiffness_rule", "damping_rule", *kinds})
    if plain == "coupling.damping_depth":
        return frozenset({"gradual"})
    return frozenset({"rays"}) if plain.endswith("friction") else frozenset()


def require(key: str) -> str:
    """Check that the value of a key may change during a run, and return the key.

    Raises:
        InputError: If the key is not a text, or its value cannot change during a run; the message states the reason.
        UnknownNameError: If the key exists in no scene.
    """
    if not isinstance(key, str):
        raise InputError("live", key, "dotted keys of the scene, such as 'coupling.internal.stiffness'")
    plain = general(key)
    if is_live(plain):
        return key
    if close := closest(plain, (*GAINS, *OBJECT_GAINS, *RULES, *BODY, *DEVICE, *HAND), 0.9):
        raise UnknownNameError("live key", key, (), f"did you mean {close!r}?")
    first = key.partition(".")[0]
    if plain == f"{first}.*":
        do = f"{key!r} denotes whole tables: give the dotted key of each value in them that may change"
        raise InputError("live", key, "a key that may change during a run", do)
    reason = next((text for keys, text in REASONS.items() if reaches(keys, plain)), "")
    if not reason:
        raise UnknownNameError("live key", key, (*GAINS, *OBJECT_GAINS, *RULES, *BODY, *DEVICE, *HAND))
    raise InputError("live", key, "a key that may change during a run", reason)


def is_live(plain: str) -> bool:
    """Return whether the value of a key in general form may change during a run."""
    return plain in (*GAINS, *OBJECT_GAINS, *RULES, *BODY, *DEVICE) or is_of_a_hand(plain)


def is_of_a_hand(plain: str) -> bool:
    """Return whether a key in general form belongs to a hand and may change during a run."""
    return any(plain == each or plain.startswith(f"{each}.") for each in HAND)


def covers(live: str, key: str) -> bool:
    """Return whether `live` includes `key`: `*` includes every number, and the key of a table includes all its keys."""
    ours, theirs = _indexed(live), _indexed(key)
    return len(ours) <= len(theirs) and all(a in ("*", b) for a, b in zip(ours, theirs, strict=False))


def numbered(scene: Scene, key: str) -> str:
    """Replace the name of a table in a key by its number: `finger.left.radius` becomes `finger.0.radius`.

    Raises:
        InputError: If the key is not a text.
    """
    if not isinstance(key, str):
        raise InputError("key", key, "a dotted key of the scene, such as 'coupling.internal.stiffness'")
    first, *rest = key.split(".")
    tables = getattr(scene, first, None) if first in LISTS else None
    if tables and rest and rest[0] not in type(tables[0]).model_fields:
        number = number_of(rest[0], [vars(each) for each in tables])
        rest = [rest[0] if number is None else str(number), *rest[1:]]
    return ".".join([first, *rest])


def keys_of(live: Any) -> list[str]:
    """Return a list of live keys, given as a list or as a single key.

    Raises:
        InputError: If `live` is neither a string nor iterable.
    """
    if isinstance(live, str):
        return [live]
    try:
        return list(live)
    except TypeError:
        do = "for example live=['coupling.internal.stiffness'], or live=() for no key"
        raise InputError("live", live, "a list of keys of the scene", do) from None


def require_value(scene: Scene, key: str) -> None:
    """Check that a scene has a value for a live key, in which tables are denoted by numbers.

    Raises:
        UnknownNameError: If the scene has no such value; the message lists the live keys for which it has values.
    """
    if not _has(scene, key):
        present = [each for each in (*GAINS, *OBJECT_GAINS, *RULES, *BODY, *DEVICE, *HAND) if _has(scene, each)]
        raise UnknownNameError("live key", key, present, "this scene has no such value")


def _has(scene: Scene, key: str) -> bool:
    try:
        return bool(list(_values(scene, _indexed(key))))
    except GraspFXError:
        return False


def value_of(scene: Scene, key: str) -> Any:
    """Return the present value of a key of a scene.

    If the key contains `*`, the value is that of all tables if they are equal, otherwise a tuple of their values. Mass
    and damping of a device are None if the scene does not set them.

    Raises:
        UnknownNameError: If the key is unknown, or the scene has no table of the name or number in the key.
        InputError: If the scene does not set the setting of a device, so that the driver's default applies; if the key
            goes through a name that refers to another table; or if the key continues after a value.
    """
    path, (first, *rest) = _indexed(key), key.split(".")
    tables: tuple[Any, ...] = getattr(scene, first) if rest and first in LISTS else ()
    if len(tables) > 1 and rest[0] not in type(tables[0]).model_fields:
        path = [first, *rest]  # a number, or a name that no table has
    values = list(_values(scene, path))
    if not values:
        raise InputError(
            "key", key, "a key of a table that the scene has",
            "if a finger refers to a table by its name, use the key of this table, such as hand.NAME.stiffness",
        )  # fmt: skip
    return values[0] if all(each == values[0] for each in values) else tuple(values)


def _indexed(key: str) -> list[str]:
    """Split a key at its dots, and insert the number 0 if the number of a table in a list is omitted."""
    first, *rest = key.split(".")
    if general(key).split(".")[1:2] == ["*"] and not (rest and (rest[0] == "*" or rest[0].isdecimal())):
        rest = ["0", *rest]
    return [first, *rest]


def _values(part: Any, path: list[str], at: str = "") -> Iterator[Any]:
    """Yield the values at the end of a path that starts at a part of the scene; `at` is the key of this part."""
    if not path:
        yield part
    elif isinstance(part, tuple):
        yield from _of_several(part, path, at)
    elif isinstance(part, Mapping):
        yield from _below(part, path, at)
    elif hasattr(part, "model_fields_set"):
        settings = getattr(part, "settings", {})
        fields = {name: getattr(part, name) for name in type(part).model_fields}
        if path[0] in ("*", "0") and path[1:]:
            yield from _values(part, path[1:], at)  # a single table is treated as a list of one
        elif hasattr(part, "settings") and path[0] in ("mass", "damping") and path[0] not in settings:
            yield None  # left to the device's driver
        elif hasattr(part, "settings") and path[0] not in fields | settings and not closest(path[0], fields | settings):
            do = "the driver's default applies; set a value in the scene"
            raise InputError("key", f"{at}.{path[0]}", "a setting that is in the scene", do)
        else:
            yield from _below(fields | settings, path, at)
    elif part is not None and not isinstance(part, str):  # None, or the name of a table elsewhere
        raise InputError("key", f"{at}.{'.'.join(path)}", "a key of the scene", f"{at} is a value and has no parts")


def _of_several(items: tuple[Any, ...], path: list[str], at: str) -> Iterator[Any]:
    name, *rest = path
    if name != "*" and not (name.isdecimal() and int(name) < len(items)):
        names = [getattr(each, key, None) for each in items for key in NAMES]
        numbers = [str(i) for i in range(len(items))]
        raise UnknownNameError(f"name or number of {at}", name, {*numbers, *(each for each in names if each)})
    for i in range(len(items)) if name == "*" else [int(name)]:
        yield from _values(items[i], rest, f"{at}.{i}")


def _below(values: Mapping[str, Any], path: list[str], at: str) -> Iterator[Any]:
    name, *rest = path
    if name not in values:
        raise UnknownNameError(f"key of {at}" if at else "key", name, values)
    yield from _values(values[name], rest, f"{at}.{name}" if at else name)
