"""Compliant fingertips at rest: the normals along which they are linear springs, in series with the gains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.certificate.scaled_gains import ScaledGains, block_diagonal
from graspfx.coupling.grasped import GraspedObject

FloatArray = NDArray[np.float64]


def pads_of(g: GraspedObject, *, at_rest: bool) -> tuple[FloatArray, FloatArray] | None:
    """Give the normals (m, p) of compliant fingertips and their stiffness at rest (p,) [N/m]; none without force."""
    stiffness, n, d = g.pad_stiffness(), g.fingers, g.dimensions
    padded = np.flatnonzero(np.isfinite(stiffness))
    if not len(padded):
        return None
    normals = np.zeros((n, d, len(padded)))
    normals[padded, :, np.arange(len(padded))] = g.inward()[padded]
    return normals.reshape(n * d, -1), stiffness[padded] if at_rest else np.zeros(len(padded))


def joined_pads(gains: Sequence[ScaledGains], V: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Join the pads of several grasps, along the axes V; None without any."""
    if all(each.pads is None for each in gains):
        return None
    pads = [each.pads or (np.zeros((each.split.components, 0)), np.zeros(0)) for each in gains]
    return V.T @ block_diagonal([normals for normals, _ in pads]), np.concatenate([springs for _, springs in pads])
