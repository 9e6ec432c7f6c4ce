"""What a run stands on: scene, files, code, versions and machine, as the header of its recording says."""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx import installed, plugins
from graspfx.assembly.resolve import Parts
from graspfx.environment import to_path
from graspfx.errors import GraspFXError
from graspfx.loop.parts import GraspedPart
from graspfx.objects.dynamics_table import DYNAMICS, dynamics_of
from graspfx.plugins import BUILT_IN, Group
from graspfx.recording.header import Header, machine, now, versions
from graspfx.scene.source import texts_in

if TYPE_CHECKING:
    from graspfx.scene.model import Scene
    from graspfx.scene.source import Source


PACKAGE = "__init__.py"
SHARED = ("site-packages", "dist-packages")  # folders of everybody's packages, which are nobody's own
OURS = Path(__file__).resolve().parents[1]


def python_files(path: Path) -> list[Path]:
    """List a file, and of a Python file what it imports from its own folder or package, and what that imports, ...

    Statements `import` and `from ... import` count, wherever they stand. What is imported by other means or from other
    folders, extension modules, and GraspFX itself are left out; so is what a file imports that is no Python.
    """
    files: dict[Path, None] = {}
    left = [path]
    while left:
        file = left.pop()
        if file in files:
            continue
        files[file] = None
        if file.suffix == ".py":
            left += [each.resolve() for each in _imports(file) if not each.resolve().is_relative_to(OURS)]
    return list(files)


def _imports(path: Path) -> Iterator[Path]:
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):  # whoever runs it says so
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                for root in _roots(path, alias.name):
                    yield from _modules(root, alias.name)
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            roots = [path.parents[node.level - 1]] if 0 < node.level <= len(path.parents) else _roots(path, module)
            for root in roots:
                for alias in node.names:
                    yield from _modules(root, f"{module}.{alias.name}".strip("."), node.level > 0)


def _roots(path: Path, module: str) -> Iterator[Path]:
    """List the folders in which a name at the top level is looked for: the file's own, and that of its package."""
    folder = path.parent
    if folder.name not in SHARED:
        yield folder
    while (folder / PACKAGE).is_file() and folder != folder.parent:
        name, folder = folder.name, folder.parent
        if not (folder / PACKAGE).is_file() and module.partition(".")[0] == name:
            yield folder


def _modules(root: Path, name: str, is_inside: bool = False) -> Iterator[Path]:
    """List the files that an import of a dotted name runs, of those that are there."""
    if is_inside:
        yield from filter(Path.is_file, [root / PACKAGE])
    place = root
    for part in name.split("."):
        place = place / part
        yield from filter(Path.is_file, [place.with_name(f"{part}.py"), place / PACKAGE])


GROUPS: tuple[Group, ...] = ("devices", "hands", "dynamics")
LONGEST = 4096  # letters of a path


def files_of(scene: Scene, values: Any = ()) -> dict[str, str]:
    """Digest the files that a scene or a value names, by their path.

    Meshes, recorded paths and whatever else a text names are among them; so is the Python of devices, hands and
    dynamics that do not come with GraspFX, with what it imports from its own folder or package (`own_imports`).

    Args:
        scene: as it is run.
        values: that take the place of its own, nested in any way; each text in them may name a file or a plug-in.
    """
    texts = list(dict.fromkeys(texts_in(values)))
    paths = [path for text in chain(_code(scene), _code_in(scene, texts), texts_in(scene.to_dict()), texts)
             if (path := _file(scene, text)) is not None]  # fmt: skip
    whole = dict.fromkeys(each for path in paths for each in python_files(path))
    digests = {str(path): digest_of(str(path)) for path in whole}
    return {path: digest for path, digest in digests.items() if digest is not None}


def by_name(files: Mapping[str, str]) -> dict[str, str]:
    """List digests by the names of files, wherever these are; of some of one name together, in the order of paths."""
    digests: dict[str, list[str]] = {}
    for path in sorted(files):
        digests.setdefault(Path(path).name, []).append(files[path])
    return {name: " ".join(each) for name, each in digests.items()}


def file_changes(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """Say which files are not those that were digested before, both as of `by_name`."""
    lines = []
    for name in sorted({*there, *here}):
        if name not in there:
            lines.append(f"the file {name} counts here and did not there")
        elif name not in here:
            lines.append(f"the file {name} counted there and does not here, or is missing")
        elif there[name] != here[name]:
            lines.append(f"the file {name} has changed")
    return lines


def digest_of(path: str) -> str | None:
    """Digest a file; None where there is none."""
    try:
        return sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return None


def _file(scene: Scene, text: str) -> Path | None:
    """Find the file that a text names; None where it names none."""
    try:
        path = to_path("file", text, folder=scene.source.folder).resolve()
        return path if len(text) < LONGEST and path.is_file() else None
    except (OSError, RuntimeError, ValueError, GraspFXError):
        return None


def _code(scene: Scene) -> Iterator[str]:
    """List the files of devices, hands and dynamics that do not come with GraspFX."""
    devices = [*scene.device, *(finger.device for finger in scene.finger if not isinstance(finger.device, str))]
    hands = [*scene.hand, *(finger.hand for finger in scene.finger if not isinstance(finger.hand, str | None))]
    yield from _of_group(scene, "devices", [each.name for each in devices])
    yield from _of_group(scene, "hands", [getattr(each, "kind", "") for each in hands if each.form == "made"])
    yield from _of_group(scene, "dynamics", [each.dynamics for each in scene.object])


def _code_in(scene: Scene, texts: Sequence[str]) -> Iterator[str]:
    """List the files of plug-ins that texts name, whatever group they are of."""
    for group in GROUPS:
        table = plugins.names(group)
        for text in texts:
            if text in table:
                with suppress(GraspFXError):  # a name that two claim, which its variant says
                    yield from _of_group(scene, group, [text])


def _of_group(scene: Scene, group: Group, names: Sequence[str]) -> Iterator[str]:
    for name in dict.fromkeys(names):
        if name in BUILT_IN.get(group, {}):
            continue
        path = plugins.find(group, name, scene.source.folder)
        if group in BUILT_IN or not path.is_relative_to(plugins.shelf(group)):
            yield str(path)


LONGEST_VALUE = 60  # letters of a value that is said


def scene_changes(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Say where the table of a scene is another one than it was, key by key."""
    return [f"the scene's {key} is {brief(one)} there, {brief(two)} here" for key, one, two in _changes(there, here)]


def brief(value: Any) -> str:
    """Format a value as compact JSON."""
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."


def _changes(one: Any, two: Any, key: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(one, Mapping) and isinstance(two, Mapping):
        for name in dict.fromkeys([*one, *two]):
            yield from _changes(one.get(name), two.get(name), f"{key}.{name}" if key else str(name))
    elif isinstance(one, list) and isinstance(two, list) and len(one) == len(two):
        for k, (a, b) in enumerate(zip(one, two, strict=True)):
            yield from _changes(a, b, f"{key}.{k}")
    elif one != two:
        yield key, one, two


def engines_of(scene: Scene, values: Any = ()) -> list[str]:
    """List the distributions whose dynamics a scene names, or a text among values that take the place of its own."""
    names = {thing.dynamics for thing in scene.object} | {text for text in texts_in(values) if text in DYNAMICS}
    return sorted({package for name in names if (package := dynamics_of(name).distribution)})


def engine_versions(scene: Scene, values: Any = ()) -> dict[str, str]:
    """Give the version of each of `engines_of`."""
    return {package: version_of(package) for package in engines_of(scene, values)}


def version_of(package: str) -> str:
    """Give the version of a distribution, in words where it is not installed."""
    return installed.version(package) or "not installed"


def header_of(parts: Parts, objects: Sequence[GraspedPart] = ()) -> Header:
    """Say for a run's recording what the scene, the time and the machine are, and how the objects' forces divide."""
    scene, source, meshes = parts.scene, parts.scene.source, parts.mesh_frames
    return Header(
        period=scene.period,
        scene=source_name(source),
        scene_text=source.text or json.dumps(scene.to_dict(), indent=1),
        scene_table=scene.to_dict(),
        scene_folder=str(source.folder.absolute()) if source.folder is not None else "",
        overrides=source.changes,
        preset=source.preset,
        title=scene.title,
        created=now(),
        versions=dict(_versions("scipy", *engines_of(scene), *(("trimesh",) if meshes else ()))),
        machine=machine(),
        frames=meshes,
        every=scene.record.every,
        split=split_rules(objects),
    )


@cache
def _versions(*packages: str) -> Mapping[str, str]:
    """Look up versions once: a process goes on with what it has imported, whatever is installed meanwhile."""
    return versions(*packages)


def source_name(source: Source) -> str:
    """Name a scene as on the shelf: after its file, or as it stands in messages."""
    return source.path.stem.replace("_", "-") if source.path is not None else source.name


def split_rules(objects: Sequence[GraspedPart]) -> dict[str, dict[str, Any]]:
    """Write for a header how the forces of each object's grasp divide, as the blocks have it that run."""
    return {part.name: part.grasped.split_rule.table() for part in objects}
