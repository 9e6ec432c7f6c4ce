"""The certificates of a scene: what its gains are, how far each can go, and what is passive for any operator."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.analysis.linearisation import Linearisation
from graspfx.certificate.certificate import Certificate
from graspfx.certificate.linearise import Linearised, linearise
from graspfx.certificate.mode_limits import mode_limits, number_of, pushing_limits, standing_limits
from graspfx.certificate.rest.cone_edge import sliding_notes
from graspfx.certificate.rest.place import NotGraspingError
from graspfx.certificate.whole_loop import Family, WholeLoop
from graspfx.loop.recording.record import Recording
from graspfx.scene.model import Scene

if TYPE_CHECKING:
    from graspfx.analysis.passivity.grasp_leak import CouplingLimits


@one_blas_thread()
def certificates(scene: Scene, at: str = "squeezed", recording: Recording | None = None) -> list[Certificate]:
    """Judge every object that fingers touch.

    Gains are those of the scene; a limit is that of one gain with the others as they are (half the common limit where
    as they are nothing is stable), the squeeze held.

    Raises:
        InputError: a device that does not tell its mass or damping.
    """
    touched = sorted(set(scene.finger_objects))
    return [_certificate_of(scene, at, scene.object[i].name, recording) for i in touched]


def _certificate_of(scene: Scene, at: str, name: str, recording: Recording | None) -> Certificate:
    try:
        return _certificate(scene, linearise(scene, at, name, recording))
    except NotGraspingError as error:
        return Certificate(name, at, math.nan, (), (), None, "no finger touches the object", gap=error.gap)


def _certificate(scene: Scene, loop: Linearised) -> Certificate:
    passive, why = _passive(scene, loop)
    return Certificate(
        object=loop.objects[0],
        at=loop.at[0],
        spectral_radius=spectral_radius(loop.linear),
        limits=(*mode_limits(scene, loop), *standing_limits(loop), *pushing_limits(scene, loop)),
        assumed=loop.assumed,
        passive=passive,
        why_not_passive=why,
        grip={
            scene.finger_names[i]: float(margin)
            for i, margin in zip(loop.fingers, loop.margins, strict=True)
            if not math.isnan(margin)
        },
        edge=tuple(scene.finger_names[i] for i in loop.edge),
        notes=tuple(_sliding(scene, loop)),
        fade=loop.fade[0],
    )


def spectral_radius(linear: Linearisation) -> float:
    """Find the largest |z| of a loop as it is."""
    return Family(WholeLoop(linear, [linear.stiffness]), lambda s: linear.stiffness).radius(1.0)


def _sliding(scene: Scene, loop: Linearised) -> Iterator[str]:
    """Say what contacts on their cones' edges could do if they slid; soft ones, which also spin, are named."""
    soft = [k for k, i in enumerate(loop.edge) if scene.finger[i].patch]
    hard = [k for k in range(len(loop.edge)) if k not in soft]
    T, V = loop.slip
    yield from sliding_notes(loop.linear, T[:, hard], V[:, hard], [scene.finger_names[loop.edge[k]] for k in hard])
    if soft:
        yield f"what sliding of {', '.join(scene.finger_names[loop.edge[k]] for k in soft)} does is not looked at"


def _passive(scene: Scene, loop: Linearised) -> tuple[CouplingLimits | None, str]:
    linear, coupling = loop.linear, scene.coupling
    if linear.ground is not None:
        return None, "the object stands on something"
    dampings = [number_of(part.damping) for part in (coupling.external, coupling.internal)]
    if any(math.isnan(value) for value in dampings):
        return None, "its damping is given by matrices"
    if loop.pads is not None:
        return None, "its fingertips are compliant"
    if loop.compliance.any():
        return None, "its damping grows with depth, and is not whole here"
    if linear.delay.any() or linear.latency.any():
        return None, "its devices display forces late"
    if linear.integrator != "exact":
        return None, f"it takes an object with the integrator exact, not {linear.integrator}"
    from graspfx.analysis.passivity.grasp_leak import coupling_limits

    limits = coupling_limits(
        linear.G,
        float(linear.friction.min()),
        linear.period,
        np.diag(np.diag(linear.viscosity)),
        external_damping=dampings[0],
        internal_damping=dampings[1],
    )
    return limits, ""
