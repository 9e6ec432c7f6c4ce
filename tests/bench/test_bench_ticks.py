"""Whole ticks beside other programs: all follow the springs that are not sampled, to first order in the period."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.bench.case import is_installed
from graspfx.bench.cases import ticks
from graspfx.bench.peers.paper import PaperProgram, Springs, coupling, grasp_matrix
from graspfx.bench.peers.springs import MuJoCoSprings
from graspfx.build.run import run
from graspfx.errors import MissingPackageError


def program_error(program: ticks.Ticking, truth: np.ndarray, g: Springs) -> float:
    for _ in range(round(ticks.SECONDS / g.T)):
        program.tick()
    return ticks.anchor_error((program.position, program.rotation()), truth, g)


@pytest.mark.parametrize("internal", [ticks.INTERNAL, ticks.EXTERNAL], ids=["kep < kip", "kep = kip"])
@pytest.mark.parametrize("d", [1, 2, 3], ids=["line", "plane", "space"])
def test_every_program_follows_the_motion(d: int, internal: float) -> None:
    """Hands pull by 6 mm and fingers, gains and body answer; a second later everyone is within 0.2 mm of it."""
    case = ticks.whole_ticks(d, internal)
    assert case.bound is not None
    found = {}
    programs = [engine.name for engine in (*ticks.ENGINES, *ticks.ON_BULLET) if engine.engine == "compiled"]
    for method in case.methods:
        if method.name in programs and "kep = kip" in case.name:
            continue  # to compile takes seconds
        try:
            found[method.name] = float(method.error() if callable(method.error) else method.error)
        except MissingPackageError:
            continue
    assert {"GraspFX, interpreted", "numpy, K known"} <= set(found)
    assert ("MuJoCo with springs" in [method.name for method in case.methods]) == ("kep = kip" in case.name)
    assert 0.0 < max(found.values()) < 2e-4
    on_bullet, bare = found.get("GraspFX on PyBullet"), found.get("PyBullet, bare calls")
    compiled, interpreted = found.get("GraspFX, compiled"), found["GraspFX, interpreted"]
    assert compiled in (None, interpreted)  # the same bits
    if on_bullet is not None:
        assert on_bullet == found["GraspFX on PyBullet, interpreted"]
    on_bullet = found.get("GraspFX on PyBullet, interpreted")
    if on_bullet is not None:
        assert bare == pytest.approx(on_bullet, abs=1e-12)  # the same calls with the same numbers
    one, all_at_once = found.get("MuJoCo with springs"), found.get("MuJoCo with springs, one call")
    assert one == all_at_once


@pytest.mark.parametrize("d", [1, 2, 3])
def test_all_tend_to_the_same_motion(d: int) -> None:
    """Half the period has half the error: all are of first order, about one and the same truth."""
    if not is_installed("mujoco"):
        pytest.skip("MuJoCo is not installed")
    internal = ticks.EXTERNAL  # MuJoCo's springs
    errors = []
    for T in (0.001, 0.0005):
        scene = ticks.make_scene(d, internal, "native", T)
        g = ticks.springs(scene, internal)
        truth = ticks.anchors_after(g)
        ours = ticks.recorded_error(run(scene, duration=ticks.SECONDS + T), truth, g)
        errors.append([ours, *(program_error(program, truth, g) for program in (PaperProgram(g), MuJoCoSprings(g)))])
    np.testing.assert_allclose(np.divide(errors[0], errors[1]), 2.0, rtol=0.15)


def test_the_truth_moves() -> None:
    """The motion is one of millimetres and degrees, not rest."""
    for d in (1, 2, 3):
        g = ticks.springs(ticks.make_scene(d, ticks.INTERNAL, "native"), ticks.INTERNAL)
        assert ticks.anchor_error((np.zeros(d), np.eye(d)), ticks.anchors_after(g), g) > 1e-3


@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_reader_s_coupling_is_the_public_one(d: int) -> None:
    """Grasp matrix and forces of equation (4), to rounding of a few newtons."""
    import graspfx as gx

    g = ticks.springs(ticks.make_scene(d, ticks.INTERNAL, "native"), ticks.INTERNAL)
    fingers = g.start + np.random.default_rng(d).normal(size=g.start.shape) * 0.005
    forces, wrench = coupling(g, fingers, np.zeros(d), np.eye(d))
    G = gx.grasp_matrix(g.anchors)
    np.testing.assert_allclose(grasp_matrix(g.anchors), G, atol=1e-17)
    law = gx.Coupling(external=gx.Impedance(g.external, 0.0), internal=gx.Impedance(g.internal, 0.0))
    e = (fingers - g.anchors).ravel()
    np.testing.assert_allclose(forces.ravel(), law.force(gx.Split(G), e, np.zeros_like(e)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(wrench, G @ forces.ravel(), atol=1e-15)
