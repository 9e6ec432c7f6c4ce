"""Eq. (4) for thousands of sets of contacts in one call."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.bench.case import Case, Method
from graspfx.bench.cases.contact_sets import RADIUS, REACH, TOLERANCE
from graspfx.bench.cases.eq4_methods import EXTERNAL, INTERNAL, WRONG, load_machine_code, relative_error
from graspfx.bench.oracles.exact import split_force
from graspfx.bench.peers.eq4_many_peers import MANY_PEERS

FloatArray = NDArray[np.float64]

FINGERS = 5
EXACT = 16  # sets whose forces are known to 50 digits


def many_case(quick: bool) -> Case:
    """Compare whole calls: points and displacements of all sets in, their forces out."""
    N = 1000 if quick else 10_000
    rng = np.random.default_rng(14)
    points, e = RADIUS * rng.normal(size=(N, FINGERS, 3)), REACH * rng.normal(size=(N, FINGERS, 3))
    law = gx.Coupling(gx.Impedance(EXTERNAL), gx.Impedance(INTERNAL))
    exact = np.array([split_force(points[k], e[k], EXTERNAL, INTERNAL, TOLERANCE) for k in range(EXACT)])
    load_machine_code()

    def method(name: str, force: Callable[[], FloatArray], note: str = "") -> Method:
        return Method(name, force, lambda: relative_error(force()[:EXACT].reshape(exact.shape), exact), note, N)

    def matrices() -> FloatArray:
        P = gx.Grasp(points).split().external
        x = e.reshape(N, -1, 1)
        return np.asarray((INTERNAL * x + (EXTERNAL - INTERNAL) * (P @ x))[..., 0])

    methods = [
        method("GraspFX Grasp.split, Coupling.force", lambda: law.force(gx.Grasp(points).split(), e)),
        method("GraspFX Grasp.split, .external", matrices, "P of every set, then products of numpy"),
    ]
    for name, project in MANY_PEERS.items():
        methods.append(method(name, lambda project=project: INTERNAL * e + project(points, (EXTERNAL - INTERNAL) * e)))  # type: ignore[misc]
    return Case("eq4", f"{N} sets of {FINGERS} fingers, one call", "relative", methods, WRONG)
