"""Limits of grasps of many fingers beside eigenvalues and python-control, and whole certificates."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

import graspfx as gx
from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.modes import modes
from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.bench.peers.grasp_limit_peers import by_control, by_eigenvalues
from graspfx.certificate.first_loss import Line, WholeLoop, reach
from graspfx.scene.model import Scene

LIMITS = """
A limit is the factor by which all gains of a grasp at rest can grow together: n alike fingers in space, spread at
random on a ball, without damping of the coupling. The oracle is each mode's closed form, which none of the methods use.
The peers take the eigenvalues of the whole loop for factors 16 % apart, up to the first that is not stable, and Brent's
method between the last two, on one BLAS thread as well. Whole certificates are calls of `gx.certify` on a scene that is
loaded, every limit included. The error is that of their limit of the external gain against the eigenvalues of the whole
loop.
"""

WRONG = 1e-8
QUICK = "GraspFX certify(quick=True)"


def grasp_cases(quick: bool) -> Iterator[Case]:
    for n in (5, 20):
        linear = alike_fingers(n)
        exact = closed_form(linear)
        methods = [_method("GraspFX", partial(ours, linear), exact)]
        methods += [_method("numpy eigenvalues, Brent", partial(by_eigenvalues, linear), exact)]
        if is_installed("control"):
            methods += [_method("python-control poles, Brent", partial(by_control, linear), exact)]
        else:
            methods += [missing("python-control poles, Brent", "control")]
        yield Case("maps", f"limit of {n} fingers", "relative", methods, WRONG, reference="GraspFX")
    for name in ("mug",) if quick else ("mug", "sphere-three-fingers", "twenty-fingers"):
        yield Case("maps", f"whole certificate, {name}", "relative", list(_whole(gx.load(name))), WRONG)


def ours(linear: Linearisation) -> float:
    """Find the factor as a certificate does."""
    K = linear.stiffness
    return reach(WholeLoop(linear, [K]), Line(np.zeros_like(K), K)).factor


def _method(name: str, limit: Callable[[], float], exact: float) -> Method:
    single = one_blas_thread()(limit)
    return Method(name, single, lambda: abs(single() / exact - 1.0))


def _whole(scene: Scene) -> Iterator[Method]:
    yield Method(QUICK, partial(gx.certify, scene, quick=True), lambda: _error(scene, quick=True))
    yield Method("GraspFX certify()", partial(gx.certify, scene), lambda: _error(scene, quick=False))


def _error(scene: Scene, *, quick: bool) -> float:
    """Compare the limit of the external gain with the spectral radius of the whole loop there, which is 1."""
    from graspfx.analysis.stability.loop import loop_matrix, without_drift
    from graspfx.certificate.linearise import linearise

    loop = linearise(scene, "provisional" if quick else "squeezed")
    row = next(row for row in gx.certify(scene, quick=quick)[0].limits if row.mode == "external")
    linear = loop.linear.with_changes(stiffness=loop.stiffness(row.margin, row.margin, 1.0))
    return abs(float(np.abs(np.linalg.eigvals(without_drift(linear, loop_matrix(linear)))).max()) - 1.0)


def alike_fingers(n: int, seed: int = 1) -> Linearisation:
    """Give n fingers with equal devices and hands on a ball, kep = 100/n and kip = 200/n N/m, sampled every 5 ms."""
    u = np.random.default_rng(seed).normal(size=(n, 3))
    grasp = gx.Grasp(0.03 * u / np.linalg.norm(u, axis=1)[:, None])
    inertia = np.array([0.25, 0.25, 0.25, 9e-5, 9e-5, 9e-5])  # [kg, kg m^2]
    return Linearisation(
        period=0.005,
        mass=0.1,
        friction=0.5,
        G=grasp.matrix,
        inertia=inertia,
        viscosity=2.0 * inertia,  # in proportion, so that every mode has a closed form
        stiffness=gx.Coupling(gx.Impedance(100.0 / n), gx.Impedance(200.0 / n)).stiffness(grasp.split()),
        hand_stiffness=200.0,
        hand_damping=4.0,
    )


def closed_form(linear: Linearisation) -> float:
    """Find the least factor over all modes of which each has a polynomial of its own."""
    return min(mode.limits.limit / float(mode.stiffness) for mode in modes(linear) if mode.limits is not None)
