"""The certificates of a scene by themselves: squeezed, provisional, or at the rest that a recording ends with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any, overload

from graspfx.card import Card, Carded
from graspfx.certificate.certificate import NOT_GRASPING, NOT_STABLE, STABLE, Certificate
from graspfx.certificate.certificate_lines import lines
from graspfx.certificate.certificates import certificates
from graspfx.certificate.rest.from_recording import recording_of
from graspfx.errors import InputError
from graspfx.loop.recording.record import Recording
from graspfx.scene.load import to_scene
from graspfx.scene.model import Scene


@dataclass(frozen=True, eq=False, repr=False)
class Certificates(Carded, Sequence[Certificate]):
    """The certificates of a scene, one for every object that fingers touch, in the order of the scene's objects.

    Attributes:
        scene: its name.
        each: a `Certificate` for each object.
        provisional: no rest was sought: the squeeze is that of one step from the start.
    """

    scene: str
    each: tuple[Certificate, ...]
    provisional: bool = False

    @property
    def stable(self) -> bool:
        """Whether every object's loop is stable as it is."""
        return all(certificate.stable for certificate in self.each)

    def to_dict(self) -> dict[str, Any]:
        """Write the certificates for JSON."""
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

    def __iter__(self) -> Iterator[Certificate]:
        return iter(self.each)

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
    """Certify a scene: how far each gain can go before the sampled loop of devices, hands and objects is unstable.

    The grasp is taken at rest: where hands that neither move nor turn bring it, sought by closing them slowly. Contacts
    that slide on the way stick where they have slid to; a run, which closes its hands at their own speed, leaves them
    some per cent elsewhere, and `recording` takes the rest that it ended with. A limit is that of one gain with the
    others as they are, the squeeze held.

    Args:
        scene: from `load`, or made in Python; or its name, or a path.
        quick: hold the squeeze of one linear step from the start instead of seeking a rest. The result is provisional.
        recording: of the scene, or its path: the grasp is that of its last row.

    Returns:
        One `Certificate` for each object that has fingers; as text they say what `graspfx check` does. One that no
        finger touches, not even with the hands closed, is not stable: its `gap` says how far away the nearest is.

    Raises:
        InputError: both `quick` and a recording, a recording of another scene, or a device that does not tell its mass
            or friction.
        NoRestError: a grasp for which no rest is found, or a recording that ends without one.
        SceneError: of a scene that is loaded.
        RecordingError: a path that leads to no recording.
    """
    scene_ = to_scene(scene)
    if quick and recording is not None:
        raise InputError("quick", True, "False with a recording", "a recording has its rest, and none is sought")
    if recording is not None:
        rest = recording_of(scene_, recording)
        answers = certificates(scene_, "recorded", rest)
    else:
        answers = certificates(scene_, "provisional" if quick else "squeezed")
    path = scene_.source.path
    name = path.stem.replace("_", "-") if path is not None else scene_.title or scene_.source.name
    return Certificates(name, tuple(answers), quick)
