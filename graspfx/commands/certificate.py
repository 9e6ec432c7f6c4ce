"""The certificate of a scene's stability as it stands on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from graspfx.errors import GraspFXError
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


def certify(scene: Scene) -> None:
    """Print the certificate, or why there is none."""
    from graspfx.certificate.certificate import lines
    from graspfx.certificate.certify import certificates

    try:
        with waiting(f"finding the limits of {scene.source.name}"):
            certificates_ = certificates(scene)
    except GraspFXError as error:
        print(f"stability is not judged: {' '.join(str(error).split())}")
        return
    for certificate in certificates_:
        print(*lines(certificate), sep="\n")
