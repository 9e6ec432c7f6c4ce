"""Provenance of a run, for the header of its recording: scene, files, code, versions and machine."""

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
from graspfx.loop.servo_parts import GraspedPart
from graspfx.objects.dynamics_table import DYNAMICS, dynamics_of
from graspfx.plugins import BUILT_IN, Group
from graspfx.recording.header import Header, machine, now, versions
from graspfx.scene.source import texts_in

if TYPE_CHECKING:
    from graspfx.scene.model import Scene
    from graspfx.scene.source import Source


PACKAGE = "__init__.py"
SHARED = ("site-packages", "dist-packages")  # folders of installed packages
OURS = Path(__file__).resolve().parents[1]


def python_files(path: Path) -> list[Path]:
    """List a file and, for a Python file, its direct and indirect imports from its own folder or package.

    All `import` and `from ... import` statements are included. Other kinds of import, other folders, extension modules,
    files that are not Python, and GraspFX itself are omitted.
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
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):  # running the file reports the error
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
    """List the folders in which a top-level name is searched: the file's folder, and that of its package."""
    folder = path.parent
    if folder.name not in SHARED:
        yield folder
    while (folder / PACKAGE).is_file() and folder != folder.parent:
        name, folder = folder.name, folder.parent
        if not (folder / PACKAGE).is_file() and module.partition(".")[0] == name:
            yield folder


def _modules(root: Path, name: str, is_inside: bool = False) -> Iterator[Path]:
    """List the existing files that an import of a dotted name runs."""
    if is_inside:
        yield from filter(Path.is_file, [root / PACKAGE])
    place = root
    for part in name.split("."):
        place = place / part
        yield from filter(Path.is_file, [place.with_name(f"{part}.py"), place / PACKAGE])


GROUPS: tuple[Group, ...] = ("devices", "hands", "dynamics")
LONGEST = 4096  # letters of a path


def files_of(scene: Scene, values: Any = ()) -> dict[str, str]:
    """Compute digests, by path, of the files that a scene or a value names.

    They include meshes, recorded paths and any other named file. They also include the Python code of third-party
    devices, hands and dynamics, with its imports from its own folder or package (`python_files`).

    Args:
        scene: Scene of the run.
        values: Values that replace the scene's, nested in any way; each text in them may name a file or a plug-in.
    """
    texts = list(dict.fromkeys(texts_in(values)))
    paths = [path for text in chain(_code(scene), _code_in(scene, texts), texts_in(scene.to_dict()), texts)
             if (path := _file(scene, text)) is not None]  # fmt: skip
    whole = dict.fromkeys(each for path in paths for each in python_files(path))
    digests = {str(path): digest_of(str(path)) for path in whole}
    return {path: digest for path, digest in digests.items() if digest is not None}


def by_name(files: Mapping[str, str]) -> dict[str, str]:
    """List digests by file names without folders; files of the same name are combined in the order of paths."""
    digests: dict[str, list[str]] = {}
    for path in sorted(files):
        digests.setdefault(Path(path).name, []).append(files[path])
    return {name: " ".join(each) for name, each in digests.items()}


def file_changes(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """List the differences between two sets of digests, both from `by_name`."""
    lines = []
    for name in sorted({*there, *here}):
        if name not in there:
            lines.append(f"the file {name} is used here but was not used there")
        elif name not in here:
            lines.append(f"the file {name} was used there but is not used here, or is missing")
        elif there[name] != here[name]:
            lines.append(f"the file {name} has changed")
    return lines


def digest_of(path: str) -> str | None:
    """Compute the digest of a file; None if it cannot be read."""
    try:
        return sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return None


def _file(scene: Scene, text: str) -> Path | None:
    """Find the file named by a text; None if there is none."""
    try:
        path = to_path("file", text, folder=scene.source.folder).resolve()
        return path if len(text) < LONGEST and path.is_file() else None
    except (OSError, RuntimeError, ValueError, GraspFXError):
        return None


def _code(scene: Scene) -> Iterator[str]:
    """List the files of third-party devices, hands and dynamics."""
    devices = [*scene.device, *(finger.device for finger in scene.finger if not isinstance(finger.device, str))]
    hands = [*scene.hand, *(finger.hand for finger in scene.finger if not isinstance(finger.hand, str | None))]
    yield from _of_group(scene, "devices", [each.name for each in devices])
    yield from _of_group(scene, "hands", [getattr(each, "kind", "") for each in hands if each.form == "made"])
    yield from _of_group(scene, "dynamics", [each.dynamics for each in scene.object])


def _code_in(scene: Scene, texts: Sequence[str]) -> Iterator[str]:
    """List the files of plug-ins, of any group, that are named in texts."""
    for group in GROUPS:
        table = plugins.names(group)
        for text in texts:
            if text in table:
                with suppress(GraspFXError):  # two plug-ins of this name: the variant that names one reports them
                    yield from _of_group(scene, group, [text])


def _of_group(scene: Scene, group: Group, names: Sequence[str]) -> Iterator[str]:
    for name in dict.fromkeys(names):
        if name in BUILT_IN.get(group, {}):
            continue
        path = plugins.find(group, name, scene.source.folder)
        if group in BUILT_IN or not path.is_relative_to(plugins.shelf(group)):
            yield str(path)


LONGEST_VALUE = 60  # largest number of letters of a shown value


def scene_changes(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """List the differences between two tables of a scene, key by key."""
    return [f"the scene's {key} is {brief(one)} there, {brief(two)} here" for key, one, two in _changes(there, here)]


def brief(value: Any) -> str:
    """Format a value as JSON, or a text as it is, shortened to 60 letters."""
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
    """List the distributions of the dynamics that a scene, or values that replace its own, name."""
    names = {thing.dynamics for thing in scene.object} | {text for text in texts_in(values) if text in DYNAMICS}
    return sorted({package for name in names if (package := dynamics_of(name).distribution)})


def engine_versions(scene: Scene, values: Any = ()) -> dict[str, str]:
    """Return the version of each distribution from `engines_of`."""
    return {package: version_of(package) for package in engines_of(scene, values)}


def version_of(package: str) -> str:
    """Return the version of a distribution, or a text if it is not installed."""
    return installed.version(package) or "not installed"


def header_of(parts: Parts, objects: Sequence[GraspedPart] = ()) -> Header:
    """Make the header of a run's recording: scene, time, machine, and split rules of the objects."""
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
    """Look up versions once, because packages installed later do not change the imported packages."""
    return versions(*packages)


def source_name(source: Source) -> str:
    """Return the name of a scene: that of its file or, without a file, the name used in messages."""
    return source.path.stem.replace("_", "-") if source.path is not None else source.name


def split_rules(objects: Sequence[GraspedPart]) -> dict[str, dict[str, Any]]:
    """Return the split rule of each object's grasp for a header, read from the running blocks."""
    return {part.name: part.grasped.split_rule.table() for part in objects}
