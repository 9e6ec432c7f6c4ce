"""Damping that grows with depth, as a scene asks for it: whether it runs, and notes where it changes nothing."""

from __future__ import annotations

import numpy as np

from graspfx.scene.model import Scene


def is_damped(scene: Scene) -> bool:
    """Tell whether the coupling has any damping."""
    return any(np.any(np.asarray(each.damping)) for each in (scene.coupling.external, scene.coupling.internal))


def why_not_gradual(scene: Scene) -> str:
    """Say why damping does not grow with depth; empty where it does."""
    if not is_damped(scene):
        return "there is no damping"
    if scene.coupling.contact == "attached":
        return "attached contacts have all their damping always"
    if scene.coupling.damping_depth == 0.0:
        return "coupling.damping_depth = 0: a finger that touches has all its damping at once"
    return ""


def depth_notes(scene: Scene) -> list[str]:
    """Warn of a `coupling.damping_depth` that changes nothing."""
    depth = scene.coupling.damping_depth
    if depth == 0.0:
        return []
    why = why_not_gradual(scene)
    return [f"coupling.damping_depth = {depth:g} m changes nothing: {why}"] if why else []
