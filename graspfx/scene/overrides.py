"""Replacement of values in nested tables by dotted keys, such as `coupling.internal.stiffness`, `finger.*.hand`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet
from copy import deepcopy
from typing import Any

from graspfx.errors import Fault, InputError
from graspfx.scene.keys import LISTS, Key, dotted, number_of, other_names
from graspfx.scene.toml_text import DEEPEST, too_deep


def by_key(overrides: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return overrides as a new dictionary with strings as keys.

    Raises:
        InputError: If the overrides are not values by dotted key, or if they are nested too deeply.
    """
    values = {} if overrides is None else overrides
    if not isinstance(values, Mapping):
        raise InputError("overrides", overrides, "values by dotted key", "as in {'coupling.internal.stiffness': 50.0}")
    for key, value in values.items():
        if str(key).count(".") >= DEEPEST or too_deep(value):
            raise InputError("overrides", str(key), f"keys and values of at most {DEEPEST} levels")
    return {str(key): value for key, value in values.items()}


def toml_value(text: str, argument: str) -> Any:
    """Return the value that a TOML text represents.

    Args:
        text: Text of one value, in one or more lines.
        argument: Name of the argument, for error messages.

    Raises:
        InputError: If the text contains other keys after the value, on lines of their own.
        TOMLDecodeError: If the text is not TOML.
    """
    import tomllib

    table = tomllib.loads(f"value = {text}")
    if len(table) > 1:
        raise InputError(argument, text, "one value", "give each KEY=VALUE as a separate argument")
    return table["value"]


def overridden(data: Mapping[str, Any], overrides: Mapping[str, Any]) -> tuple[dict[str, Any], set[Key], list[Fault]]:
    """Return a copy of nested tables with values replaced, the replaced keys, and faults for keys that cannot be set.

    Without overrides, the copy shares its inner tables with `data`.

    In a list, a number selects an item, a name selects the table with this name or label, and `*` selects all items. A
    single table in place of a list is treated as a list of one table. The index of a single table may be omitted. A key
    of a single table takes precedence over the table's name. Intermediate tables that are missing are created; the
    validation of the scene later decides whether their keys exist.
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
    """Return the name of the first override, even if invalid, of a key or an enclosing table; None if there is none."""
    for name, value in overrides.items():
        if name == dotted(key) or is_within(key, overridden(data, {name: value})[1]):
            return name
    return None


def is_within(key: Key, replaced: AbstractSet[Key]) -> bool:
    """Return whether a key, or a table that contains the key, was replaced."""
    return any(key[:length] in replaced for length in range(1, len(key) + 1))


def _replace(holder: Any, at: Key, path: list[str], value: Any) -> Iterator[Key | str]:
    """Replace values along a path in a table or list; yield each replaced key, or the reason why it is not replaced."""
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
    """Return whether a part of a path is the name of the only table in a list, and not a key of this table."""
    if not isinstance(item, dict) or part in item or number_of(part, [item]) is None:
        return False
    return bool(rest) or isinstance(value, Mapping)
