"""Runs of a scene by an engine of one's choice, and whether two of them are the same bits."""

from __future__ import annotations

from typing import Any

import numpy as np

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.errors import SceneError
from graspfx.recording.header import Header
from graspfx.recording.record import Recording
from graspfx.recording.recorder import Recorder
from tests.support.varied_scenes import varied_table

TICKS = 60


def recorded(scene: gx.Scene, engine: str, calls: int = 1, ticks: int = TICKS) -> Recording:
    """A run in so many calls."""
    with build(scene, engine=engine) as servo, Recorder(servo.layout, Header(scene.period), block=ticks) as recorder:
        for count in np.diff(np.linspace(0, ticks, calls + 1).astype(int)).tolist():
            servo.run(count, recorder)
        return recorder.finish(engine=servo.engine.name)


def same(one: Recording, other: Recording) -> bool:
    return one.rows.tobytes() == other.rows.tobytes() and one.faults == other.faults


def dressed(seed: int) -> gx.Scene:
    """A varied scene, with some of what scenes may have besides, as far as it goes together."""
    rng = np.random.default_rng([27, seed])
    table = varied_table(seed)
    try:
        scene = gx.Scene(**table)
    except SceneError:  # obstacles that an engine has not in these dimensions
        try:
            scene = gx.Scene(**{**table, "object": [{**thing, "dynamics": "native"} for thing in table["object"]]})
        except SceneError:  # a finger towards the hole of a ring
            return dressed(seed + 10_000)
    extras: list[dict[str, Any]] = [
        {"coupling.passivity": str(rng.choice(["observe", "control"]))},
        {"object.*.integrator": str(rng.choice(["implicit", "explicit", "semi-implicit"]))},
        {"finger.0.device.force_limit": float(rng.uniform(0.05, 1.0))},
        {"finger.*.pad": {"stiffness": 3000.0}},
        {"finger.0.model": "soft", "finger.0.patch": 0.005},
        {"safety.force": float(rng.uniform(0.5, 3.0)), "safety.rate": 50.0},
        {
            "coupling.external.stiffness": rng.uniform(20.0, 80.0, len(scene.finger)).tolist(),
            "coupling.form": "symmetric",
        },
        {"coupling.damping_depth": 1e-3},
        {"finger.0.device.resolution": 1e-5, "finger.0.device.velocity_window": 3},
        {
            "finger.*.hand.tremor": {"amplitude": 1e-4},
            "finger.*.hand.noise": {"share": 0.05, "cutoff": 10.0, "lag": 0.03},
        },
        {"gravity": rng.normal(size=scene.dimensions).tolist()},
    ]
    for extra in extras:
        if rng.random() < 0.3:
            try:
                scene = scene.replace(extra)
            except SceneError:
                continue
    return scene
