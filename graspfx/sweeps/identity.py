"""Identity of a sweep: a digest of its scene, of the files that it names, of its variants and what is measured."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from graspfx import __version__
from graspfx.assembly.provenance import brief, by_name, file_changes, scene_changes
from graspfx.sweeps.variant_grid import VariantGrid

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

RESULTS = 1  # counts changes of what the numbers in a sweep's files mean
FEW = 6  # values that are listed one by one


def identity_of(parts: Mapping[str, Any]) -> str:
    """Digest what a sweep is made of."""
    return sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def sweep_parts(
    scene: Scene,
    variants: VariantGrid,
    duration: float,
    measure: Sequence[str],
    statistics: Sequence[str],
    files: Mapping[str, str],
    engines: Mapping[str, str],
) -> dict[str, Any]:
    """List all that the results of a sweep depend on, as data that JSON writes."""
    lists = {key: [_written(each) for each in items] for key, items in variants.lists.items()}
    return {
        "scene": json.loads(json.dumps(scene.to_dict())),
        "files": by_name(files),
        "variants": {key: _brief(items) for key, items in lists.items()},
        "values": sha256(json.dumps([lists, list(variants.shape), variants.numbers.tolist()]).encode()).hexdigest(),
        "shape": list(variants.shape),
        "sample": [variants.sample, variants.seed] if variants.sample else [],
        "measure": list(measure),
        "statistics": list(statistics),
        "duration": duration,
        "version": [__version__, RESULTS, *(" ".join(each) for each in engines.items())],
    }


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Say in which ways a sweep is another one than that of a folder."""
    lines = [
        *scene_changes(there.get("scene", {}), here["scene"]),
        *file_changes(there.get("files", {}), here["files"]),
    ]
    values, here_values = there.get("variants", {}), here["variants"]
    for key in dict.fromkeys([*values, *here_values]):
        one, two = values.get(key, "not swept"), here_values.get(key, "not swept")
        if one != two:
            lines.append(f"{key}: {one} there, {two} here")
    for name in ("shape", "sample", "measure", "statistics", "duration", "version"):
        if there.get(name) != here[name]:
            lines.append(f"{name}: {brief(there.get(name))} there, {brief(here[name])} here")
    return lines or ["its values are not the same to the last digit, or in another order"]


# Words ----------------------------------------------------------------------------------------------------------------


def _written(value: Any) -> Any:
    """Write a value as JSON has it; of another kind as Python writes it."""
    try:
        return json.loads(json.dumps(value))
    except (TypeError, ValueError):
        return repr(value)


def _brief(items: Sequence[Any]) -> str:
    if len(items) <= FEW:
        return ", ".join(brief(each) for each in items)
    return f"{len(items)} values from {brief(items[0])} to {brief(items[-1])}"
