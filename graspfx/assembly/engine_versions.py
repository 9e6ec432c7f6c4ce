"""Versions of the programs that move the objects of a scene: results are theirs too."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from graspfx import installed
from graspfx.objects.dynamics_table import DYNAMICS, dynamics_of
from graspfx.scene.source import texts_in

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


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
