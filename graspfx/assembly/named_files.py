"""Files on which the runs of a scene depend: data and Python that it or a value names, and what that Python imports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx import plugins
from graspfx.assembly.own_imports import python_files
from graspfx.environment import to_path
from graspfx.errors import GraspFXError
from graspfx.plugins import BUILT_IN, Group
from graspfx.scene.source import texts_in

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

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
