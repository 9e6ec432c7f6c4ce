"""Replacement of a scene's values by dotted key: `coupling.internal.stiffness`, `finger.*.device.mass`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet
from copy import deepcopy
from typing import Any

from graspfx.errors import Fault, InputError
from graspfx.scene.keys import LISTS, Key, dotted, number_of, other_names
from graspfx.scene.toml_text import DEEPEST, too_deep


def by_key(overrides: Mapping[str, Any] | None) -> dict[str, Any]:
    """Copy overrides into a new dictionary.

    Raises:
        InputError: If the overrides are not values by dotted key, or are nested too deeply.
    """
    values = {} if overrides is None else overrides
    if not isinstance(values, Mapping):
        raise InputError("overrides", overrides, "values by dotted key", "as in {'coupling.internal.stiffness': 50.0}")
    for key, value in values.items():
        if str(key).count(".") >= DEEPEST or too_deep(value):
            raise InputError("overrides", str(key), f"keys and values of at most {DEEPEST} levels")
    return {str(key): value for key, value in values.items()}


def toml_value(text: str, argument: str) -> Any:
    """Parse a value as TOML.

    Args:
        text: Text of the value, on one or more lines.
        argument: Name of the argument in messages.

    Raises:
        InputError: If other keys follow the value on their own lines.
        TOMLDecodeError: If the text is not TOML.
    """
    import tomllib

    table = tomllib.loads(f"value = {text}")
    if len(table) > 1:
        raise InputError(argument, text, "one value", "give each KEY=VALUE as a separate argument")
    return table["value"]


def overridden(data: Mapping[str, Any], overrides: Mapping[str, Any]) -> tuple[dict[str, Any], set[Key], list[Fault]]:
    """Copy nested tables with values replaced; list the replaced keys, and a fault for each key that cannot be set.

    Without overrides the copy shares its inner tables with `data`.

    In a list, a number selects an item, a name selects the table of that name, and `*` selects all. A single table is
    treated as a list of one table, whose index may be omitted; keys of the table take precedence over its name. Missing
    intermediate tables are created; the validation of the scene decides whether a key exists.
    """
    changed: dict[str, Any] = deepcopy(dict(data)) if overrides else dict(data)
    replaced: set[Key] = set()
    faults: list[Fault] = []
    for key, value in overrides.items():
        for outcome in _replace(changed, (), key.split("."), value):
            if isinstance(outcome, str):
                faults.append(Fault(key, outcome))
            else:
                replaced.add(outcome)
    return changed, replaced, faults


def replacing(data: Mapping[str, Any], overrides: Mapping[str, Any], key: Key) -> str | None:
    """Find the override, valid or invalid, that refers to a key or to an enclosing table; None without one."""
    for name, value in overrides.items():
        if name == dotted(key) or is_within(key, overridden(data, {name: value})[1]):
            return name
    return None


def is_within(key: Key, replaced: AbstractSet[Key]) -> bool:
    """True if a key, or a table that contains it, was replaced."""
    return any(key[:length] in replaced for length in range(1, len(key) + 1))


def _replace(holder: Any, at: Key, path: list[str], value: Any) -> Iterator[Key | str]:
    """Follow the path into a table or list; yield each replaced key, or a reason why it cannot be replaced."""
    part, *rest = path
    if not part:
        yield "an override needs a key between its dots"
    elif isinstance(holder, dict):
        if rest and not at and part == "record" and isinstance(holder.get(part), list | str):
            holder[part] = {"columns": holder[part]}  # a list of columns is short for the table with `columns`
        is_item = len(at) == 1 and at[0] in LISTS and number_of(part, [holder]) == 0
        if rest and part not in holder and (part in ("*", "0") or is_item):
            yield from _replace(holder, at, rest, value)  # treat a single table as a list of one
        elif rest:
            is_new = part not in holder
            for outcome in _replace(holder.setdefault(part, {}), (*at, part), rest, value):
                yield (*at, part) if is_new and not isinstance(outcome, str) else outcome
        else:
            for name in other_names(holder.get("name"), part):
                holder.pop(name, None)  # remove the same setting under its former or current name
            holder[part] = deepcopy(value)
            yield (*at, part)
    elif isinstance(holder, list):
        yield from _replace_item(holder, at, part, rest, value)
    elif isinstance(holder, str):
        yield f"{dotted(at)} is the name {holder!r}: override the table of that name"
    else:
        yield f"{dotted(at)} is a value and has no parts"


def _replace_item(items: list[Any], at: Key, part: str, rest: list[str], value: Any) -> Iterator[Key | str]:
    if part == "*":
        numbers = range(len(items))
    elif part.isdecimal():
        numbers = range(int(part), int(part) + 1)
    elif len(items) == 1 and not _names_lone(part, rest, items[0], value):
        yield from _replace(items[0], (*at, 0), [part, *rest], value)
        return
    elif (number := number_of(part, [item if isinstance(item, dict) else {} for item in items])) is not None:
        numbers = range(number, number + 1)
    else:
        yield f"{dotted(at)} is a list of {len(items)}: select one by its number or name, or all with '*'"
        return
    for i in numbers:
        if i >= len(items):
            yield f"{dotted(at)} has {len(items)} entries; the last is {dotted((*at, len(items) - 1))}"
        elif rest:
            yield from _replace(items[i], (*at, i), rest, value)
        else:
            items[i] = deepcopy(value)
            yield (*at, i)


def _names_lone(part: str, rest: list[str], item: Any, value: Any) -> bool:
    """True if part of a key is the name of the only table of a list, and not a key of that table."""
    if not isinstance(item, dict) or part in item or number_of(part, [item]) is None:
        return False
    return bool(rest) or isinstance(value, Mapping)
