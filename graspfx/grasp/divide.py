"""Division of contact forces into external and internal parts by any kind of split, including one for analysis only."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError, UnknownNameError
from graspfx.grasp.matrix import GraspMatrix
from graspfx.grasp.split import ContactSet, Kind, Split

FloatArray = NDArray[np.float64]
AnyKind = Literal["pseudoinverse", "mass", "weights", "stiffness", "virtual-linkage"]


def divide(
    grasp: ContactSet | ArrayLike,
    force: ArrayLike,
    kind: AnyKind = "pseudoinverse",
    *,
    weights: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    metric: ArrayLike | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Divide contact forces f into external and internal parts, f = P f + (I - P) f, G (I - P) = 0.

    | kind | P on forces | source | conservative as a coupling |
    |---|---|---|---|
    | pseudoinverse | G^+ G | Kawai and Yoshikawa, eq. 3 | yes |
    | mass, weights | M G'(G M G')^+ G, M a number per finger | Erhart and Hirche 2015 | yes |
    | stiffness | the same, M the springs of fingers and pads | | yes |
    | virtual-linkage | only forces exert the wrench | Williams and Khatib 1993 | not with moments |

    Args:
        grasp: `Grasp`; or for "pseudoinverse" a matrix (w, m), whose columns are all forces or all moments.
        force: Contact forces (m,) or (..., m); (..., n, d) for contacts with d forces each [N, N m].
        kind: Kind of the split, from the table.
        weights, stiffness: Weights and stiffness, as for `Split`.
        metric: Metric M, for "pseudoinverse": `grasp.metric(torsion_length=...)` if contacts have moments.

    Returns:
        External and internal forces, with the shape of `force`.

    Raises:
        InputError: If an argument is invalid for `Split`, or is not used by the kind.
        UnknownNameError: If the kind is unknown.
    """
    if kind not in get_args(AnyKind):
        raise UnknownNameError("kind of split", str(kind), get_args(AnyKind))
    f = np.asarray(force, dtype=float)
    flat = f
    if isinstance(grasp, GraspMatrix) and f.shape[-2:] == grasp.points.shape[-2:] and f.shape[-1] != grasp.components:
        flat = f.reshape(*f.shape[:-2], -1)
    if kind == "virtual-linkage":
        from graspfx.grasp.quality.virtual_linkage import VirtualLinkage

        if not isinstance(grasp, GraspMatrix):
            raise InputError("grasp", grasp, "a Grasp for kind='virtual-linkage'")
        if not (weights is stiffness is metric is None):
            raise InputError("weights", weights, "no weights, stiffness or metric for kind='virtual-linkage'")
        grasp.require_one("divide")
        parts = VirtualLinkage(grasp).divide(flat)
    else:
        named: Kind = kind
        parts = Split(grasp, kind=named, weights=weights, stiffness=stiffness, metric=metric).divide(flat)
    return parts[0].reshape(f.shape), parts[1].reshape(f.shape)
