"""Identity of a sweep: a digest of its scene, of the files that it names, of its variants and what is measured."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx import __version__, plugins
from graspfx.build.scene_cache import data_files
from graspfx.environment import to_path
from graspfx.errors import GraspFXError
from graspfx.plugins import BUILT_IN, Group
from graspfx.scene.source import texts_in
from graspfx.sweeps.variant_grid import VariantGrid

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

RESULTS = 1  # counts changes of what the numbers in a sweep's files mean
LONGEST = 60  # letters of a value that is said
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
) -> dict[str, Any]:
    """List all that the results of a sweep depend on, as data that JSON writes."""
    lists = {key: [_written(each) for each in items] for key, items in variants.lists.items()}
    return {
        "scene": json.loads(json.dumps(scene.to_dict())),
        "files": _by_name(files),
        "variants": {key: _brief(items) for key, items in lists.items()},
        "values": sha256(json.dumps([lists, list(variants.shape), variants.numbers.tolist()]).encode()).hexdigest(),
        "shape": list(variants.shape),
        "sample": [variants.sample, variants.seed] if variants.sample else [],
        "measure": list(measure),
        "statistics": list(statistics),
        "duration": duration,
        "version": [__version__, RESULTS],
    }


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Say in which ways a sweep is another one than that of a folder."""
    lines = []
    for key, one, two in _changes(there.get("scene", {}), here["scene"], ""):
        lines.append(f"the scene's {key} is {_short(one)} there, {_short(two)} here")
    files, own = there.get("files", {}), here["files"]
    lines += [f"the file {name} has changed" for name in sorted({*files, *own}) if files.get(name) != own.get(name)]
    values, here_values = there.get("variants", {}), here["variants"]
    for key in dict.fromkeys([*values, *here_values]):
        one, two = values.get(key, "not swept"), here_values.get(key, "not swept")
        if one != two:
            lines.append(f"{key}: {one} there, {two} here")
    for name in ("shape", "sample", "measure", "statistics", "duration", "version"):
        if there.get(name) != here[name]:
            lines.append(f"{name}: {_short(there.get(name))} there, {_short(here[name])} here")
    return lines or ["its values are not the same to the last digit, or in another order"]


# Files ----------------------------------------------------------------------------------------------------------------


def files_of(scene: Scene, variants: VariantGrid) -> dict[str, str]:
    """Digest the files that a scene or a value of its variants names: meshes, paths, and Python that is no shelf's."""
    names = [*_code(scene), *data_files(scene), *texts_in(variants.lists)]
    digests: dict[str, str] = {}
    for name in names:
        try:
            path = to_path("file", name, folder=scene.source.folder).resolve()
            digest = digest_of(str(path)) if len(str(name)) < 4096 and path.is_file() else None
        except (OSError, RuntimeError, GraspFXError):  # no name of a file
            continue
        if digest is not None:
            digests[str(path)] = digest
    return digests


def _by_name(files: Mapping[str, str]) -> dict[str, str]:
    """List digests by the names of files, wherever these are; of some of one name together."""
    digests: dict[str, list[str]] = {}
    for path, digest in files.items():
        digests.setdefault(Path(path).name, []).append(digest)
    return {name: " ".join(sorted(each)) for name, each in digests.items()}


def digest_of(path: str) -> str | None:
    """Digest a file; None where there is none."""
    try:
        return sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return None


def _code(scene: Scene) -> Iterator[str]:
    """List the files of devices, hands and dynamics that do not come with GraspFX."""
    devices = [*scene.device, *(finger.device for finger in scene.finger if not isinstance(finger.device, str))]
    hands = [*scene.hand, *(finger.hand for finger in scene.finger if not isinstance(finger.hand, str | None))]
    yield from _of_group(scene, "devices", [each.name for each in devices])
    yield from _of_group(scene, "hands", [getattr(each, "kind", "") for each in hands if each.form == "made"])
    yield from _of_group(scene, "dynamics", [each.dynamics for each in scene.object])


def _of_group(scene: Scene, group: Group, names: Sequence[str]) -> Iterator[str]:
    for name in dict.fromkeys(names):
        if name in BUILT_IN.get(group, {}):
            continue
        path = plugins.find(group, name, scene.source.folder)
        if group in BUILT_IN or not path.is_relative_to(plugins.shelf(group)):
            yield str(path)


# Words ----------------------------------------------------------------------------------------------------------------


def _written(value: Any) -> Any:
    """Write a value as JSON has it; of another kind as Python writes it."""
    try:
        return json.loads(json.dumps(value))
    except (TypeError, ValueError):
        return repr(value)


def _brief(items: Sequence[Any]) -> str:
    if len(items) <= FEW:
        return ", ".join(_short(each) for each in items)
    return f"{len(items)} values from {_short(items[0])} to {_short(items[-1])}"


def _short(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _changes(one: Any, two: Any, key: str) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(one, Mapping) and isinstance(two, Mapping):
        for name in dict.fromkeys([*one, *two]):
            yield from _changes(one.get(name), two.get(name), f"{key}.{name}" if key else str(name))
    elif isinstance(one, list) and isinstance(two, list) and len(one) == len(two):
        for k, (a, b) in enumerate(zip(one, two, strict=True)):
            yield from _changes(a, b, f"{key}.{k}")
    elif one != two:
        yield key, one, two
