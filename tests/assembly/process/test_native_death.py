"""Death of a servo without Python in its loop: whoever records takes the force away, as from any other."""

from __future__ import annotations

import os
import signal
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.devices.force_dimension.emulator import ForceDimensionWire
from graspfx.testing.wire import compiler
from tests.support.optional import require
from tests.support.servo_wires import servo_of, settled

require("llvmlite")
pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux") or compiler() is None, reason="a loop of Linux, and a library to link"
)

PERIOD = 0.005
OUTSIDE, INSIDE = np.array([0.035, 0.0, 0.0]), np.array([0.026, 0.0, 0.0])  # of a ball of 30 mm [m]


class Stroke:
    """A `stop` that presses the finger into the ball, waits for a force, and kills the servo with it."""

    def __init__(self, wire: ForceDimensionWire) -> None:
        self._wire, self._servo, self.force = wire, 0, 0.0

    def __call__(self) -> bool:
        if not self._servo:
            self._servo = servo_of(os.getpid())
            self._wire.place(INSIDE)
        elif not self.force and (force := float(np.linalg.norm(self._wire.torque))) > 0.05:
            self.force = force
            os.kill(self._servo, signal.SIGKILL)
        return False


def test_a_servo_without_python_that_is_killed_leaves_no_force(tmp_path: Path) -> None:
    """Its device takes no watchdog, so that the force stays on until somebody takes it away."""
    with ForceDimensionWire() as wire:
        for function in ("dhdSetWatchdog", "dhdEnableExpertMode"):
            wire.answer(function, -1)
        wire.place(OUTSIDE)
        device: dict[str, Any] = {"name": "force-dimension", **wire.settings}
        ball = {
            "mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 2e-4, "shape": {"kind": "sphere", "radius": 0.03},
            "free": [False] * 6,
        }  # fmt: skip
        coupling = {"external": {"stiffness": 100.0, "damping": 0.5}, "internal": {"stiffness": 200.0}}
        scene = gx.Scene(
            dimensions=3, period=PERIOD, duration=10.0, object=ball, coupling={**coupling, "absent": "follow"},
            finger=[{"start": OUTSIDE.tolist(), "device": device}],
        )  # fmt: skip
        stroke = Stroke(wire)
        rec = settled(partial(gx.run, scene, real_time=True, stop=stroke, out=tmp_path / "rec"))
        assert rec.header.scheduling["loop"] == "native"
        assert stroke.force > 0.05
        assert not wire.torque.any()
        assert wire.devices[0].owner == 0
        assert rec.outcome.cause == "the servo's process was ended by SIGKILL"
        assert [fault.tick for fault in rec.faults] == [len(rec)]
        assert "(Delta) was removed in" in rec.faults[0].message
        assert np.linalg.norm(rec.displayed_force[-1]) > 0.05
