"""Provenance of a run for the header of its recording: scene, files, code, package versions and machine."""

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
    """List a file and, if it is a Python file, the Python files of its own folder or package that it imports.

    Imports by `import` and `from ... import` statements are followed, also in the imported files. Files imported in
    other ways or from other folders, extension modules, and the modules of GraspFX are omitted.
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
    """Yield the folders in which an absolute import of `module` by the file `path` is searched.

    They are the folder of the file and, if `module` is in the file's own package, the folder that contains this
    package.
    """
    folder = path.parent
    if folder.name not in SHARED:
        yield folder
    while (folder / PACKAGE).is_file() and folder != folder.parent:
        name, folder = folder.name, folder.parent
        if not (folder / PACKAGE).is_file() and module.partition(".")[0] == name:
            yield folder


def _modules(root: Path, name: str, is_inside: bool = False) -> Iterator[Path]:
    """Yield the existing files in the folder `root` that an import of the dotted `name` runs."""
    if is_inside:
        yield from filter(Path.is_file, [root / PACKAGE])
    place = root
    for part in name.split("."):
        place = place / part
        yield from filter(Path.is_file, [place.with_name(f"{part}.py"), place / PACKAGE])


GROUPS: tuple[Group, ...] = ("devices", "hands", "dynamics")
LONGEST = 4096  # letters of a path


def files_of(scene: Scene, values: Any = ()) -> dict[str, str]:
    """Compute the digests, by path, of the files that a scene and other values name.

    These files are meshes, recorded paths, other named files, and the Python files of plug-ins (devices, hands and
    dynamics) with their imports (`python_files`).

    Args:
        scene: Scene of the run.
        values: Values that replace values of the scene, nested in any way; texts in them may name files or plug-ins.
    """
    texts = list(dict.fromkeys(texts_in(values)))
    paths = [path for text in chain(_code(scene), _code_in(scene, texts), texts_in(scene.to_dict()), texts)
             if (path := _file(scene, text)) is not None]  # fmt: skip
    whole = dict.fromkeys(each for path in paths for each in python_files(path))
    digests = {str(path): digest_of(str(path)) for path in whole}
    return {path: digest for path, digest in digests.items() if digest is not None}


def by_name(files: Mapping[str, str]) -> dict[str, str]:
    """Return digests by file name without folder; digests of files with equal names are joined in order of paths."""
    digests: dict[str, list[str]] = {}
    for path in sorted(files):
        digests.setdefault(Path(path).name, []).append(files[path])
    return {name: " ".join(each) for name, each in digests.items()}


def file_changes(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """Return a text for each difference between two sets of digests by name, those "there" and those "here"."""
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
    """Return the path of the file that a text names; None if the text does not name an existing file."""
    try:
        path = to_path("file", text, folder=scene.source.folder).resolve()
        return path if len(text) < LONGEST and path.is_file() else None
    except (OSError, RuntimeError, ValueError, GraspFXError):
        return None


def _code(scene: Scene) -> Iterator[str]:
    """Yield the paths of a scene's plug-ins (devices, hands and dynamics)."""
    devices = [*scene.device, *(finger.device for finger in scene.finger if not isinstance(finger.device, str))]
    hands = [*scene.hand, *(finger.hand for finger in scene.finger if not isinstance(finger.hand, str | None))]
    yield from _of_group(scene, "devices", [each.name for each in devices])
    yield from _of_group(scene, "hands", [getattr(each, "kind", "") for each in hands if each.form == "made"])
    yield from _of_group(scene, "dynamics", [each.dynamics for each in scene.object])


def _code_in(scene: Scene, texts: Sequence[str]) -> Iterator[str]:
    """Yield the paths of the plug-ins, of any group, whose names are among the texts."""
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
    """Return a text for each key whose values differ between two tables of a scene, those "there" and those "here"."""
    return [f"the scene's {key} is {brief(one)} there, {brief(two)} here" for key, one, two in _changes(there, here)]


def brief(value: Any) -> str:
    """Format a value, a text as itself and any other value as JSON, and shorten it to 60 characters."""
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
    """List the distributions of the dynamics that are named in a scene or in values that replace the scene's."""
    names = {thing.dynamics for thing in scene.object} | {text for text in texts_in(values) if text in DYNAMICS}
    return sorted({package for name in names if (package := dynamics_of(name).distribution)})


def engine_versions(scene: Scene, values: Any = ()) -> dict[str, str]:
    """Return the version of each distribution from `engines_of`."""
    return {package: version_of(package) for package in engines_of(scene, values)}


def version_of(package: str) -> str:
    """Return the version of a distribution, or "not installed"."""
    return installed.version(package) or "not installed"


def header_of(parts: Parts, objects: Sequence[GraspedPart] = ()) -> Header:
    """Make the header of a run's recording, with the split rules of the grasped `objects`."""
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
    """Return the versions of packages, cached because later installations do not change the imported packages."""
    return versions(*packages)


def source_name(source: Source) -> str:
    """Return the name of a scene's file without extension; for a scene without a file, the name used in messages."""
    return source.path.stem.replace("_", "-") if source.path is not None else source.name


def split_rules(objects: Sequence[GraspedPart]) -> dict[str, dict[str, Any]]:
    """Return the present split rule of each object's grasp, by name of the object, as a table for a header."""
    return {part.name: part.grasped.split_rule.table() for part in objects}
