"""Varied scenes through check, certify and run: errors are GraspFX's, and no run contradicts its scene's verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.certificate.certificate import Certificate
from graspfx.errors import GraspFXError, SceneError
from tests.support.families import family
from tests.support.varied_scenes import RAMP, varied_table

ANSWERED = family("verdicts: check, certify and run", "an error of GraspFX, or a verdict and a recording")
TOLD = family("verdicts: those that a run can tell", "the run itself")

ALL, BLOCK = 5000, 250  # scenes
CALM = 1e-7  # [m]: what is still at the end of a run
LOUD = 40.0  # of log amplitude: rounding that has grown past every other motion
SLIDE = 2  # of `status`
SURE = 1e-4  # of a spectral radius about 1: nearer, a run of some seconds tells nothing


def contradiction(scene: gx.Scene, one: Certificate, run: gx.Recording) -> str | None:
    """Say how a run contradicts a verdict; nothing where it agrees, None where it cannot tell.

    It cannot tell where fingers that a stable grasp has let go or slide in its second half, and of a loop so near to
    its limit, or so short a run, that nothing grows or fades in time.
    """
    index = [thing.name for thing in scene.object].index(one.object)
    fingers = np.flatnonzero(np.array(scene.finger_objects) == index)
    touching = run.touching[:, fingers]
    if run.faults or (not one.grasps and scene.gravity is not None):
        return None
    half = len(touching) // 2
    if not one.grasps:  # a finger may tap the object as it overshoots
        return "a finger touches" if touching[half:].all(axis=0).any() else ""
    held = bool(touching[half:].all()) and (run.status is None or not (run.status[half:, fingers] == SLIDE).any())
    if one.stable and one.spectral_radius < 1.0 - SURE and held:
        grown = [each for each in run.summary()["growth"] if each["object"] == one.object]
        return f"it grows: {grown[0]}" if grown and not grown[0]["mode"].startswith("pushing") else ""
    ticks = len(touching) - round(RAMP / scene.period)
    if one.spectral_radius > 1.0 + SURE and math.log(one.spectral_radius) * ticks > LOUD:
        motion = float(np.ptp(run.finger_position[-len(touching) // 10 :, fingers], axis=0).max())
        return f"it is calm at its end, within {motion:.1e} m" if held and motion < CALM else ""
    return None


def blocks() -> Iterator[Any]:
    """Give seeds: a few always, 5000 in all with -m stress, in blocks that processes share (`-n 2`)."""
    yield pytest.param(range(4), id="short")
    for first in range(0, ALL, BLOCK):
        yield pytest.param(range(first, first + BLOCK), id=f"from {first}", marks=pytest.mark.stress)


@pytest.mark.parametrize("seeds", list(blocks()))
def test_varied_scenes_have_verdicts_that_runs_do_not_contradict(seeds: range) -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("pybullet")
    wrong, foreign = list[str](), list[str]()
    for seed in seeds:
        try:
            outcome = judged(seed)
        except Exception as error:  # noqa: BLE001 - it is counted, and the other scenes are tried
            foreign.append(f"scene {seed}: {type(error).__name__}: {error}")
            continue
        if outcome:
            wrong.append(f"scene {seed}: {outcome}")
    counts = f"foreign exceptions: {len(foreign)}, verdicts that runs contradict: {len(wrong)}, of {len(seeds)} scenes"
    assert not foreign and not wrong, "\n".join([counts, *foreign, *wrong])


def judged(seed: int) -> str:
    """Check, certify and run a scene; say what is wrong, or nothing."""
    try:
        scene = gx.Scene(**varied_table(seed))
    except SceneError:
        ANSWERED.tried()
        return ""
    report = gx.check(scene)
    ANSWERED.tried()
    try:
        run = gx.run(scene)
    except GraspFXError as error:
        return "" if not report.ok else f"{report.verdict}, but its run is refused: {error}"
    if report.faults:
        return f"{report.verdict}, but it runs"
    if not report.certificates:
        return ""
    certificates = {one.object: one for one in gx.certify(scene)}
    for one in report.certificates:
        if certificates[one.object].verdict != one.verdict:
            return f"check: {one.verdict}; certify: {certificates[one.object].verdict}"
        said = contradiction(scene, one, run)
        if said is not None:
            TOLD.tried()
        if said:
            return f"{one.verdict}, but {said}"
    return ""
