"""Eq. (4) where the contacts do not move: the split known, displacements anew at every call."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.bench.cases.contact_sets import ContactSet
from graspfx.bench.cases.eq4_methods import EXTERNAL, INTERNAL, WRONG, force_method, load_machine_code
from graspfx.bench.oracles.exact import split_force
from graspfx.bench.peers.eq4_peers import grasp_matrix

FloatArray = NDArray[np.float64]

LAW = gx.Coupling(gx.Impedance(EXTERNAL), gx.Impedance(INTERNAL))
GRASPS = 8  # displacements of the first of a set's grasps


def fixed_case(contacts: ContactSet) -> Case:
    """Compare methods on the first grasp of a set, whose contacts stay, for several displacements."""
    points, displacements = contacts.points[0], list(contacts.displacements[:GRASPS])
    exact = np.array([split_force(points, e, EXTERNAL, INTERNAL, contacts.tolerance) for e in displacements])
    flat = [e.ravel() for e in displacements]
    load_machine_code()
    methods = [
        force_method("GraspFX Coupling.force, split known", partial(LAW.force, gx.Grasp(points).split()), flat, exact),
        _in_place(points, displacements, exact),
        *(force_method(name, force, flat, exact, note) for name, force, note in _peers(points)),
    ]
    return Case("eq4", f"{len(points)} fingers, contacts fixed", "relative", methods, WRONG)


def _in_place(points: FloatArray, displacements: list[FloatArray], exact: FloatArray) -> Method:
    """Call PointCoupling, which finds the split anew at every call: it need not know that contacts are fixed."""
    name = "GraspFX PointCoupling, compiled"
    if not is_installed("llvmlite"):
        return missing(name, "llvmlite")
    own = gx.PointCoupling(LAW.external, LAW.internal, len(points), engine="compiled")
    own.points[:] = points

    def force(e: FloatArray) -> FloatArray:
        own.displacement[:] = e
        own.compute()
        return own.force

    return force_method(name, force, displacements, exact, "displacements copied, forces in place")


def _peers(points: FloatArray) -> Iterator[tuple[str, Callable[[FloatArray], FloatArray], str]]:
    m = points.size
    G = grasp_matrix(points)
    P = np.linalg.pinv(G) @ G
    K, f = EXTERNAL * P + INTERNAL * (np.eye(m) - P), np.empty(m)
    s, V = np.linalg.svd(G, full_matrices=False)[1:]
    V = V[s > max(G.shape) * np.finfo(float).eps * s[0]]
    right = (EXTERNAL - INTERNAL) * V.T.copy()
    yield "numpy, P known", lambda e: (EXTERNAL - INTERNAL) * (P @ e) + INTERNAL * e, ""
    yield "numpy, K known", lambda e: K.dot(e, f), "one product, in place"
    yield "numpy, modes known", lambda e: right @ (V @ e) + INTERNAL * e, ""
