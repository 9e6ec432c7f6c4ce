"""Keys of a scene that may change in mid-run, and why others may not."""

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
    ("period", "duration"): "time is counted in periods, and a session runs as long as it is stepped",
    ("dimensions", "engine", "title", "preset"): "it belongs to the whole run",
    ("object.*.position", "object.*.orientation", "object.*.velocity", "object.*.angular_velocity", "finger.*.start"): (
        "it says where the run starts; what moves goes on from where it is"
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
    ): ("it decides what is computed"),
    ("coupling.enter",): "it says how the run begins",
    ("coupling.passivity",): "whether energy is booked decides what is recorded",
    ("safety", "finger.*.safety"): "limits hold for a whole run",
    ("object", "obstacle", "world"): "it decides what bodies are made and how they move",
    ("hand.*.guide", "finger.*.hand.guide"): "of a guide the goals change, its offset and its squeeze",
    ("finger.*.hand.reaction", "hand.*.reaction"): "of a reaction its stiffness, damping and force change",
    ("finger.*.hand.noise", "hand.*.noise"): "of a noise its share changes",
    ("finger", "device", "hand"): "it decides what is connected, or how contacts are laid out",
}


def live_fields(keys: Iterable[str]) -> frozenset[str]:
    """Name the fields of grasps' blocks that choose what is computed, and that may change where these keys are live.

    Raises:
        InputError: keys that are no names.
        UnknownNameError: a key that cannot change in mid-run, with the reason.
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
    """Require a key that can change in mid-run.

    Raises:
        InputError: no text, or a key that cannot change in mid-run, with the reason.
        UnknownNameError: no scene has such a key.
    """
    if not isinstance(key, str):
        raise InputError("live", key, "keys of the scene with dots, such as 'coupling.internal.stiffness'")
    plain = general(key)
    if is_live(plain):
        return key
    if close := closest(plain, (*GAINS, *OBJECT_GAINS, *RULES, *BODY, *DEVICE, *HAND), 0.9):
        raise UnknownNameError("live key", key, (), f"did you mean {close!r}?")
    first = key.partition(".")[0]
    if plain == f"{first}.*":
        do = f"{key!r} stands for whole tables: name the values in them that may change, with dots"
        raise InputError("live", key, "a key that may change in mid-run", do)
    reason = next((text for keys, text in REASONS.items() if reaches(keys, plain)), "")
    if not reason:
        raise UnknownNameError("live key", key, (*GAINS, *OBJECT_GAINS, *RULES, *BODY, *DEVICE, *HAND))
    raise InputError("live", key, "a key that may change in mid-run", reason)


def is_live(plain: str) -> bool:
    """Tell whether a key in its general form can change in mid-run."""
    return plain in (*GAINS, *OBJECT_GAINS, *RULES, *BODY, *DEVICE) or is_of_a_hand(plain)


def is_of_a_hand(plain: str) -> bool:
    """Tell whether a key in its general form is one of a hand that can change."""
    return any(plain == each or plain.startswith(f"{each}.") for each in HAND)


def covers(live: str, key: str) -> bool:
    """Tell whether a live key stands for a key: `*` for every number, a table for what is below it."""
    ours, theirs = _indexed(live), _indexed(key)
    return len(ours) <= len(theirs) and all(a in ("*", b) for a, b in zip(ours, theirs, strict=False))


def numbered(scene: Scene, key: str) -> str:
    """Write a key with numbers for the names of tables: `finger.left.hand.stiffness` is `finger.0.hand.stiffness`.

    Raises:
        InputError: no text.
    """
    if not isinstance(key, str):
        raise InputError("key", key, "a key of the scene with dots, such as 'coupling.internal.stiffness'")
    first, *rest = key.split(".")
    tables = getattr(scene, first, None) if first in LISTS else None
    if tables and rest and rest[0] not in type(tables[0]).model_fields:
        number = number_of(rest[0], [vars(each) for each in tables])
        rest = [rest[0] if number is None else str(number), *rest[1:]]
    return ".".join([first, *rest])


def keys_of(live: Any) -> list[str]:
    """List live keys, of which one may stand by itself.

    Raises:
        InputError: no keys.
    """
    if isinstance(live, str):
        return [live]
    try:
        return list(live)
    except TypeError:
        do = "such as live=['coupling.internal.stiffness']; live=() for none"
        raise InputError("live", live, "a list of keys of the scene", do) from None


def require_value(scene: Scene, key: str) -> None:
    """Require that a scene has a key that may change in mid-run, with numbers for names: its value is there.

    Raises:
        UnknownNameError: it does not, with keys that come close.
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
    """Give the value of a key now; of `*` the one value of all, or a tuple of them.

    Raises:
        UnknownNameError: no scene has such a key, or this one no table of that name or number.
        InputError: a setting that is left to its driver, or a table that stands elsewhere.
    """
    path, (first, *rest) = _indexed(key), key.split(".")
    tables: tuple[Any, ...] = getattr(scene, first) if rest and first in LISTS else ()
    if len(tables) > 1 and rest[0] not in type(tables[0]).model_fields:
        path = [first, *rest]  # a number, or a name that none of them has
    values = list(_values(scene, path))
    if not values:
        raise InputError(
            "key", key, "a key of a table that the scene has",
            "where a name stands for a table, ask for that one, as in hand.NAME.stiffness",
        )  # fmt: skip
    return values[0] if all(each == values[0] for each in values) else tuple(values)


def _indexed(key: str) -> list[str]:
    """Split a key at its dots, with the number 0 where a list's is left out."""
    first, *rest = key.split(".")
    if general(key).split(".")[1:2] == ["*"] and not (rest and (rest[0] == "*" or rest[0].isdecimal())):
        rest = ["0", *rest]
    return [first, *rest]


def _values(part: Any, path: list[str], at: str = "") -> Iterator[Any]:
    """Follow a path into a part of the scene that stands at a key, and give what is there."""
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
            yield from _values(part, path[1:], at)  # a lone table as a list of one
        elif hasattr(part, "settings") and path[0] in ("mass", "damping") and path[0] not in settings:
            yield None  # left to the device's driver
        elif hasattr(part, "settings") and path[0] not in fields | settings and not closest(path[0], fields | settings):
            raise InputError("key", f"{at}.{path[0]}", "a setting that the scene gives", "its driver's own value holds")
        else:
            yield from _below(fields | settings, path, at)
    elif part is not None and not isinstance(part, str):  # nothing, or a name that stands for a table elsewhere
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
