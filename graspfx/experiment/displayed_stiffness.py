"""Displayed stiffness of a recording: force over displacement, for internal or external forces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from graspfx.errors import InputError

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

Share = Literal["internal", "external"]
SHARES: dict[str, Share] = {"coupling.internal.stiffness": "internal", "coupling.external.stiffness": "external"}


def displayed_stiffness(recording: Recording, share: Share) -> float:
    """Estimate the stiffness that a recording displays: k = sum f.e / sum e.e over rows with a touching finger [N/m].

    f is the internal or external part of the displayed forces of the fingers on the object. e is the same part of
    their displacements from the contacts. For a spring without damping, k is its stiffness to rounding.

    Args:
        recording: Recording with forces, positions and contacts.
        share: Part of the force, "internal" or "external".

    Raises:
        InputError: If the share is unknown, or the recording has no such displacement.
    """
    if share not in SHARES.values():
        raise InputError("share", share, "'internal' or 'external'")
    force = getattr(recording, f"{share}_force")
    displacement = getattr(recording, f"{share}_displacement")
    felt = recording.touching.any(axis=1)
    f, e = np.nan_to_num(force[felt]), np.nan_to_num(displacement[felt])
    size = float((e * e).sum())
    if not size > 0.0:
        raise InputError("recording", recording.header.scene, f"one with displacements of the {share} coupling")
    return float((f * e).sum()) / size
