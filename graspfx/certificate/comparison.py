"""The certificate's word on a motion that a recording shows to grow."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from graspfx.errors import GraspFXError

if TYPE_CHECKING:
    from graspfx.certificate.certificate import Certificate, Limit
    from graspfx.scene.model import Scene
    from graspfx.scene.tables.reading import Readable

Beside = Callable[[str, str], dict[str, Any]]


def beside(scene: Readable) -> Beside:
    """Make a function of an object's and a mode's name that gives the scene's certificate for it.

    The certificate is made when it is asked for, once. Keys: `spectral_radius`, `gain` and `limit` [N/m] (None without
    one), and `text`, in words.
    """
    answers: list[dict[str, Certificate] | str] = []

    def say(name: str, mode: str) -> dict[str, Any]:
        if not answers:
            answers.append(_certificates(scene))
        answer = answers[0]
        if isinstance(answer, str):
            return {"spectral_radius": None, "gain": None, "limit": None, "text": f"no certificate: {answer}"}
        return _answer(answer[name], mode)

    return say


def _certificates(scene: Readable) -> dict[str, Certificate] | str:
    from graspfx.certificate.certificates import certificates

    try:
        return {each.object: each for each in certificates(whole_scene(scene))}
    except GraspFXError as error:
        return " ".join(str(error).split())


def whole_scene(scene: Any) -> Scene:
    """Give the scene itself; one from the cache is made again from its tables."""
    from graspfx.scene.model import Scene

    return scene if isinstance(scene, Scene) else Scene(scene.source, **scene.to_dict())


def _answer(certificate: Certificate, mode: str) -> dict[str, Any]:
    from graspfx.certificate.limit_rows import figures

    row = _row(certificate, mode)
    radius = certificate.spectral_radius
    verdict = f"certificate: {'stable' if certificate.stable else 'NOT STABLE'}, spectral radius {radius:.6f}"
    numbers = (None, None) if row is None else (row.gain, row.limit)
    gain, limit = (value if value is not None and math.isfinite(value) else None for value in numbers)
    text = verdict if row is None else f"{verdict}; {row.mode} {figures(row)}"
    return {"spectral_radius": radius, "gain": gain, "limit": limit, "text": text}


def _row(certificate: Certificate, mode: str) -> Limit | None:
    """Find the limit of a mode by its name, or of the mode that it is a part of."""
    rows = {row.mode: row for row in certificate.limits}
    return rows.get(mode) or rows.get(mode.split()[0])
