"""The arena of a scene: one memory for all blocks, and a world whose places lead to what they say."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.assembly.build import build
from graspfx.compile.memory import Memory
from graspfx.errors import InputError
from graspfx.loop.arena import Arena
from graspfx.loop.engine import Compiled, Interpreted
from graspfx.loop.kernels import KERNELS, number_of
from graspfx.loop.servo_parts import Parts
from graspfx.loop.world import NONE
from tests.support import foreign_parts
from tests.support.small_scenes import LINE, line

SHELF = [name for name, origin in plugins.names("scenes").items() if "GraspFX" in origin]


@pytest.mark.parametrize("name", SHELF)
def test_blocks_of_a_scene_stand_in_one_memory_and_apart_from_one_another(name: str) -> None:
    with build(gx.load(name), engine="interpreted") as servo:
        arena = servo.arena
        ranges = sorted((arena.place(array), arena.place(array) + array.size) for array in arena.arrays)
        assert all(end <= first for (_, end), (first, _) in pairwise(ranges))
        assert ranges[0][0] > NONE and ranges[-1][1] <= arena.memory.used
        assert isinstance(arena.buffer, memoryview) and not arena.foreign


def test_places_of_fingers_are_where_the_parts_have_them() -> None:
    """A number written into a part by its own views is found by the world at its place, and the other way round."""
    pytest.importorskip("pybullet", reason="pybullet has no wheel for this Python or platform")
    with build(gx.load("two-objects"), engine="interpreted") as servo:
        arena, floats = servo.arena, servo.arena.memory.floats
        d = arena.d
        for part in servo.objects:
            for j, f in enumerate(part.fingers.tolist()):
                finger = arena.world.fingers[f]
                part.grasped.force[j] = np.arange(d) + 10.0 * f
                assert floats[finger.force : finger.force + d].tolist() == (np.arange(d) + 10.0 * f).tolist()
                floats[finger.position : finger.position + d] = 0.25 * f
                assert (part.grasped.finger_position[j] == 0.25 * f).all()
        for grasp, part in zip(arena.world.grasps, servo.objects, strict=True):
            assert grasp.state == arena.place(part.grasped.block)


@pytest.mark.parametrize("room", [1, 100, 3000])
def test_blocks_without_room_stand_apart_and_give_the_same_bits(room: int) -> None:
    scene = line(coupling__passivity="control")
    rows = []
    for size in (1 << 21, room):
        for engine in (Interpreted, Compiled):
            with build(scene, engine="interpreted") as servo:
                arena = Arena(servo.parts, Memory(size))
                kind: Any = engine(arena)
                written = np.zeros((40, servo.layout.width))
                kind.write_to(written)
                assert kind.run(0, 40, 0) == 40
                rows.append(written.tobytes())
    assert len(set(rows)) == 1


def test_two_parts_may_not_share_a_part_of_their_memory() -> None:
    """Code is compiled as if no two blocks shared memory."""
    with build(line(), engine="interpreted") as servo:
        first, second = (station.device for station in servo.stations)
        whole: Any = first
        other: Any = second
        vars(other)["state"] = whole.state[1:]
        with pytest.raises(InputError, match="does not share memory with the block of another part"):
            Arena(servo.parts)


def test_a_plant_that_shows_copies_is_refused() -> None:
    """Its position would be recorded as it was at the beginning."""
    with build(gx.load("reference-1dof"), engine="interpreted") as servo:
        moved = servo.plants[0]
        real = moved.plant

        class Copying:
            position = property(lambda self: real.position.copy())
            velocity, place, advance = real.velocity, real.place, real.advance

        object.__setattr__(moved, "plant", Copying())
        with pytest.raises(InputError, match=r"Copying.*always the same contiguous array"):
            Arena(servo.parts)


def test_each_number_of_a_kernel_is_that_of_the_kernel() -> None:
    """A name that is no kernel's would be found only by the scene that needs it."""
    from importlib import import_module

    for number, name in enumerate(KERNELS[1:], start=1):
        module, _, attribute = name.rpartition(".")
        assert number_of(getattr(import_module(module), attribute)) == number
    assert number_of(np.sum) is None


@pytest.mark.parametrize(("which", "ports", "plants"), [("none", 0, 0), ("device", 1, 1), ("plant", 1, 1)])
def test_what_is_plain_python_is_left_to_the_caller(tmp_path: Path, which: str, ports: int, plants: int) -> None:
    files = foreign_parts.write(tmp_path)
    changes: dict[str, Any] = {}
    if which != "none":
        changes["finger.0.device"] = foreign_parts.device(files, which, mass=0.15, damping=0.2)
    with build(gx.Scene(**LINE).replace(changes), engine="interpreted") as servo:
        arena = servo.arena
        assert (arena.world.ports, len(arena.ports), len(arena.plants)) == (ports, ports, plants)
        assert arena.world.pauses is bool(ports)
        assert [bool(device.plain) for device in arena.world.devices] == [bool(ports), False]
        assert len(arena.world.plants) == 2 - plants


def test_a_scene_without_recording_has_no_columns() -> None:
    with build(line(), engine="interpreted", record=False) as servo:
        assert servo.arena.world.recorded == 0
        assert isinstance(servo.parts, Parts)
