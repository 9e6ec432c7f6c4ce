"""The bodies of a scene: each object's own, or a world for those that meet obstacles or one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.errors import InputError
from graspfx.loop.servo import Mover
from graspfx.objects.surroundings import Meeting, Member
from graspfx.scene.making import surroundings
from graspfx.scene.making.bodies import make_shape
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


def make_movers(scene: Scene, states: Sequence[FloatArray], stack: ExitStack) -> Iterator[Mover]:
    """What moves the objects whose blocks are given; closed with the stack.

    Raises:
        InputError: dynamics that know no world, for objects that meet something.
    """
    world, folder = scene.world, scene.source.folder
    meeting = Meeting(world.friction, world.restitution, world.stiffness, surroundings.collide(scene))
    for group in surroundings.groups(scene):
        name = scene.object[group[0]].dynamics
        module = plugins.load("dynamics", name, folder)
        make_world = getattr(module, "create_world", None)
        wanted = scene.obstacle or world.collide  # else objects meet where their dynamics know how
        if not surroundings.in_world(scene, group) or (make_world is None and not wanted):
            for i in group:
                body = module.create(states[i])
                stack.callback(getattr(body, "close", _nothing))
                yield Mover(body, [i])
            continue
        if make_world is None:
            raise InputError("dynamics", name, "one with create_world, as objects meet something", "use bullet")
        members = [Member(states[i], make_shape(scene.object[i], folder)) for i in group]
        body = make_world(members, surroundings.obstacles(scene, folder), meeting)
        stack.callback(getattr(body, "close", _nothing))
        yield Mover(body, group)


def _nothing() -> None:
    return None
