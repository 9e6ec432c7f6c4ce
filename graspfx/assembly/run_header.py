"""Header of a run's recording: what the scene, the time and the machine are."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from graspfx.assembly.engine_versions import engines_of
from graspfx.assembly.resolve import Parts
from graspfx.loop.parts import GraspedPart
from graspfx.recording.header import Header, machine, now, versions

if TYPE_CHECKING:
    from graspfx.scene.source import Source


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
        versions=versions(
            "scipy",
            *engines_of(scene),
            *(("trimesh",) if meshes else ()),
        ),
        machine=machine(),
        frames=meshes,
        every=scene.record.every,
        split=split_rules(objects),
    )


def source_name(source: Source) -> str:
    """Name a scene as on the shelf: after its file, or as it stands in messages."""
    return source.path.stem.replace("_", "-") if source.path is not None else source.name


def split_rules(objects: Sequence[GraspedPart]) -> dict[str, dict[str, Any]]:
    """Write for a header how the forces of each object's grasp divide, as the blocks have it that run."""
    return {part.name: part.grasped.split_rule.table() for part in objects}
