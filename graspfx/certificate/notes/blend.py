"""Grasps so small or so nearly on a line that the blend of a rotation makes their forces others than eq. (4)'s."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from graspfx.build.grasps import grasps
from graspfx.coupling import block as at
from graspfx.grasp.rigid_modes import NO_ARM, smoothstep
from graspfx.objects import integrators as body

if TYPE_CHECKING:
    from graspfx.build.resolve import Parts
    from graspfx.coupling.grasped import GraspedObject


def blend_notes(parts: Parts) -> list[str]:
    """Say of each grasp at the start that lies in the band of `coupling.blend` how far its forces are from eq. (4)."""
    scene = parts.scene
    if scene.coupling.blend == "off" or not any(map(scene.turns, scene.object)):
        return []
    return [note for part in grasps(parts) for note in _notes(part.name, part.grasped)]


def arms(grasped: GraspedObject) -> list[float]:
    """Compute the rms arms of the free rotations about their principal axes, the least first [m].

    They are the singular values of the fields a_k x (c_i - c) of the weighted contacts, less what the free translations
    move, over the root of the weights' sum; those that are rounding are left out.
    """
    rows, S = grasped.rows, grasped.body_state
    points = rows[:, at.CONTACT : at.CONTACT + 3] @ S[body.ROTATION : body.ROTATION + 9].reshape(3, 3).T
    weights = rows[:, at.SHARE]
    free = S[body.FREE : body.FREE + 6] != 0.0
    root = np.sqrt(weights)[:, None]
    fields = [root * np.cross(axis, points) for axis in np.eye(3)[free[3:]]]
    shifts = np.array([(root * axis).ravel() for axis in np.eye(3)[free[:3]]]).reshape(-1, 3 * len(points))
    shifts /= math.sqrt(weights.sum())
    turns = np.array([field.ravel() for field in fields]).reshape(-1, 3 * len(points))
    turns -= turns @ shifts.T @ shifts
    values = np.linalg.svd(turns, compute_uv=False) / math.sqrt(weights.sum())
    return sorted(float(arm) for arm in values if arm > NO_ARM)


def _notes(name: str, grasped: GraspedObject) -> Iterator[str]:
    S = grasped.block
    if S[at.EQUAL] or not S[at.TURNS]:
        return
    low, high = float(S[at.ARM_LOW]), float(S[at.ARM_HIGH])
    small = [arm for arm in arms(grasped) if arm < high]
    if not small:
        return
    blend = smoothstep(small[0], low, high)
    kep, kip = float(S[at.EXTERNAL_STIFFNESS]), float(S[at.INTERNAL_STIFFNESS])
    if grasped.matrices:
        figure = f"{100.0 * (1.0 - blend):.2g} % of its stiffness is the internal one"
    else:
        blended = kip + (kep - kip) * blend
        figure = (
            f"it has {blended:.4g} N/m where eq. (4) has kep = {kep:g} N/m ({100.0 * (blended / kep - 1.0):+.2g} %)"
        )
    yield (
        f"a rotation of {name} on its contacts, of {1e3 * small[0]:.3g} mm arm, lies in the band of coupling.blend, "
        f"{1e3 * low:g} to {1e3 * high:g} mm: {figure}; coupling.blend = 'off' is eq. (4) to the letter"
    )
