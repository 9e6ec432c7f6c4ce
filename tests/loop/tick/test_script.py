"""One memory of a tick's script has one name, whatever views it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.build.build import build
from graspfx.errors import InputError
from graspfx.loop.tick.programs import Interpreted
from graspfx.loop.tick.script import Script, Tick
from graspfx.loop.tick.text import write


def test_a_memory_has_one_name_however_it_is_shown() -> None:
    """Code is compiled as if no two arrays shared memory."""
    script, block = Script(), np.zeros(10)
    assert script.memory("device", block) == script.memory("device", block[:]) == "device0"
    assert script.memory("device", np.zeros(10)) == "device1"
    with pytest.raises(InputError, match="shares nothing with device0"):
        script.memory("plant", block[2:5])


def test_a_kernel_may_be_called_as_what_the_script_calls_its_own() -> None:
    def run(S: Any, o: int) -> int:
        S[o] += 1.0
        return 0

    script, block = Script(), np.zeros(1)
    tick = Tick(script, np.zeros(8))
    tick.begin += [f"code = {script.kernel(run)}({script.memory('device', block)}, 0)"]
    tick.own = np.zeros(8)
    tick.end += ["code = 0"]
    script.memory("servo", tick.own)
    engine = Interpreted(tick)
    engine.begin(0)
    assert engine.run(1, 3, 0) == 3
    assert block[0] == 4.0


def test_a_plant_that_shows_copies_is_refused() -> None:
    """Its position would be recorded as it was at the beginning."""
    with build(gx.load("reference-1dof")) as servo:
        moved = servo.plants[0]
        real = moved.plant

        class Copying:
            position = property(lambda self: real.position.copy())
            velocity, place, advance = real.velocity, real.place, real.advance

        object.__setattr__(moved, "plant", Copying())
        with pytest.raises(InputError, match=r"Copying.*contiguous array for the plant's life"):
            write(servo.parts)
