"""Certificates of a scene, for its squeezed grasps at rest or for the state at the end of a recording."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.card import Card, Carded
from graspfx.certificate.certificate import NOT_GRASPING, NOT_STABLE, STABLE, Certificate, lines
from graspfx.certificate.grip import sliding_notes
from graspfx.certificate.linearise import Linearised, linearise
from graspfx.certificate.mode_limits import mode_limits, number_of, pushing_limits, spectral_radius, standing_limits
from graspfx.certificate.operating_point import NotGraspingError
from graspfx.certificate.recorded import recording_of
from graspfx.errors import InputError
from graspfx.recording.record import Recording
from graspfx.scene.load import to_scene
from graspfx.scene.model import Scene

if TYPE_CHECKING:
    from graspfx.analysis.passivity.grasp_leak import CouplingLimits


@dataclass(frozen=True, eq=False, repr=False)
class Certificates(Carded, Sequence[Certificate]):
    """Certificates of the grasped objects of a scene, in the order of the objects.

    Attributes:
        scene: Name of the scene.
        each: `Certificate` of each object.
        provisional: True if the equilibrium of the grasps was approximated by one linear step from the start.
    """

    scene: str
    each: tuple[Certificate, ...]
    provisional: bool = False

    @property
    def stable(self) -> bool:
        """Whether the loop of every object is stable with the scene's gains."""
        return all(certificate.stable for certificate in self.each)

    def to_dict(self) -> dict[str, Any]:
        """Return the certificates as data for JSON."""
        return {
            "scene": self.scene,
            "stable": self.stable,
            "provisional": self.provisional,
            "certificates": [certificate.to_dict() for certificate in self.each],
        }

    @overload
    def __getitem__(self, index: int) -> Certificate: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Certificate, ...]: ...

    def __getitem__(self, index: int | slice) -> Certificate | tuple[Certificate, ...]:
        return self.each[index]

    def __len__(self) -> int:
        return len(self.each)

    def _card(self) -> Card:
        unstable = any(each.grasps and not each.stable for each in self.each)
        verdict = STABLE if self.stable else NOT_STABLE if unstable else NOT_GRASPING
        rows = [(certificate.object, "\n".join(lines(certificate))) for certificate in self.each]
        calls = "[index], .stable, .to_dict()"
        return Card(f"{self.scene}: {'provisional, ' if self.provisional else ''}{verdict}", rows, calls)


def certify(
    scene: Scene | str | PathLike[str],
    quick: bool = False,
    recording: Recording | str | PathLike[str] | None = None,
) -> Certificates:
    """Compute how large each gain can be before the sampled loop of devices, hands and objects is unstable.

    The loop is linearised about an equilibrium of the grasp, which is reached when the hands close slowly and neither
    move nor rotate. Contacts that slide while the hands close are assumed to stick where they stop. In a run, hands
    close faster; if contacts slide, the forces in the equilibrium of the run may therefore differ by a few per cent. To
    use the equilibrium of a run, pass its `recording`. Each limit is computed for one gain; the contact forces in
    equilibrium and the other gains stay constant.

    Args:
        scene: Scene, name of a built-in scene, or path of a scene file.
        quick: Whether to approximate the equilibrium by one linear step from the start.
        recording: Recording of the scene, or its path. The grasp is judged in the state of the last row.

    Returns:
        A `Certificate` for each object that has fingers; `graspfx check` prints the same text. If no finger touches an
        object although the hands are closed, its certificate is not stable, and `gap` is the distance to the nearest
        finger.

    Raises:
        InputError: If `quick` is not a bool, or is True although a recording is given; if the recording is of another
            scene; or if a device does not state its mass or friction.
        NoRestError: If no equilibrium of a grasp is found; or if, in the last row of the recording, only some fingers
            touch the object, a finger pulls, or the forces do not converge.
        SceneError: If the scene file has faults.
        RecordingError: If the file at the path of the recording is missing or not a recording.
    """
    scene_ = to_scene(scene)
    if not isinstance(quick, bool):
        raise InputError("quick", quick, "True or False", "to change values of a scene, pass gx.load(scene, values)")
    if quick and recording is not None:
        raise InputError("quick", True, "False, because a recording is given", "the recording provides the equilibrium")
    if recording is not None:
        rest = recording_of(scene_, recording)
        answers = certificates(scene_, "recorded", rest)
    else:
        answers = certificates(scene_, "provisional" if quick else "squeezed")
    return Certificates(name_of(scene_), tuple(answers), quick)


def name_of(scene: Scene) -> str:
    """Return the name of a scene's file; if the scene has no file, its title, or the name that messages use."""
    path = scene.source.path
    return path.stem.replace("_", "-") if path is not None else scene.title or scene.source.name


@one_blas_thread()
def certificates(scene: Scene, at: str = "squeezed", recording: Recording | None = None) -> list[Certificate]:
    """Compute the certificate of every object that has fingers.

    Each limit is computed for one gain, with the other gains at the scene's values. If the loop is unstable at the
    scene's values, the other gains are set to half the largest stable common multiple of the scene's values.

    Args:
        scene: Scene.
        at: State about which the loop is linearised, as for `linearise`.
        recording: Recording of the scene if `at` is "recorded".

    Raises:
        InputError: If a device does not state its mass or friction.
    """
    names = [scene.object[i].name for i in sorted(set(scene.finger_objects))]
    return [_certificate(scene, at, name, recording) for name in names]


def _certificate(scene: Scene, at: str, name: str, recording: Recording | None) -> Certificate:
    try:
        loop = linearise(scene, at, name, recording)
    except NotGraspingError as error:
        return Certificate(name, at, math.nan, (), (), None, "no finger touches the object", gap=error.gap)
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
        notes=(*_sliding(scene, loop), *_squeezed(scene, loop)),
        fade=loop.fade[0],
    )


def _squeezed(scene: Scene, loop: Linearised) -> Iterator[str]:
    """Yield a note about the rotational stiffness that contact forces add to a specified stiffness of the object."""
    geometric = loop.geometric[0]
    if geometric is None:
        return
    thing = next(each for each in scene.object if each.name == loop.objects[0])
    turns = int(sum(scene.free(thing)[scene.dimensions :]))
    if turns:
        part = geometric[-turns:, -turns:]
        low, high = np.linalg.eigvalsh(0.5 * (part + part.T))[[0, -1]]
        change = f"{low:+.3g}" if turns == 1 else f"{low:+.3g} to {high:+.3g}"
        yield f"object_stiffness does not include the effect of contact forces, which add {change} N m/rad in rotations"


def _sliding(scene: Scene, loop: Linearised) -> Iterator[str]:
    """Yield notes about instabilities if contacts on the edges of their friction cones slide.

    One note lists soft fingers on the edge, for which sliding is not examined.
    """
    soft = [k for k, i in enumerate(loop.edge) if scene.finger[i].patch]
    hard = [k for k in range(len(loop.edge)) if k not in soft]
    T, V = loop.slip
    yield from sliding_notes(loop.linear, T[:, hard], V[:, hard], [scene.finger_names[loop.edge[k]] for k in hard])
    if soft:
        yield f"sliding of {', '.join(scene.finger_names[loop.edge[k]] for k in soft)} is not examined"


def _passive(scene: Scene, loop: Linearised) -> tuple[CouplingLimits | None, str]:
    linear, coupling = loop.linear, scene.coupling
    dampings = [number_of(part.damping) for part in (coupling.external, coupling.internal)]
    obstacles = (
        (linear.ground is not None, "the object stands on an obstacle"),
        (np.isnan(dampings).any(), "the damping is given by matrices"),
        (loop.pads is not None, "fingertips are compliant"),
        (loop.compliance.any(), "the damping grows with depth and is below its full value here"),
        (linear.delay.any() or linear.latency.any(), "devices display forces with a delay"),
        (linear.integrator != "exact", f"the object has the integrator {linear.integrator}, not exact"),
    )
    for is_there, why in obstacles:
        if is_there:
            return None, why
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
