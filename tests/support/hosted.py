"""A host and the loop of its devices in one program, on one clock: delays, losses and jitter as a test wants them."""

from __future__ import annotations

import heapq
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.feedback.host_link import HostLink, Operator

FloatArray = NDArray[np.float64]
NAMES = (f"test-{os.getpid()}-{k}" for k in count())
HALF = 0.02  # of the fingers' distance at first [m]


def hosted_scene(
    host: dict[str, Any] | None = None,
    *,
    fingers: int = 2,
    dimensions: int = 3,
    hand: dict[str, Any] | Callable[[int], dict[str, Any]] | None = None,
    mass: float = 0.1,
    damping: float = 0.5,
    **scene: Any,
) -> gx.Scene:
    """A scene of simulated devices on a circle, whose object a host has; its chain is on from the first tick."""
    angles = 2.0 * np.pi * np.arange(fingers) / fingers
    places = np.stack([-HALF * np.cos(angles), HALF * np.sin(angles), 0.0 * angles], axis=1)[:, :dimensions]
    holds = {"stiffness": 200.0, "damping": 1.0} if hand is None else hand
    hold = holds if callable(holds) else lambda i: holds
    return gx.Scene(**{
        "dimensions": dimensions, "period": 0.001, "duration": 1.0, "engine": "compiled",
        "host": {"name": next(NAMES), **(host or {})},
        "safety": {"soft_start": 0.0, "force": 1e3},
        "finger": [
            {
                "device": {"name": "simulated", "mass": mass, "damping": damping},
                "start": p.tolist(), **({"hand": {"rest": p.tolist(), **hold(i)}} if holds else {}),
            }
            for i, p in enumerate(places)
        ],
        **scene,
    })  # fmt: skip


def name_of(scene: gx.Scene) -> str:
    """Name under which a scene's loop is found."""
    assert scene.host is not None
    return str(scene.host.name)


class Line:
    """Samples on their way from a host to the loop, each late by its own time, and some lost.

    Args:
        link: of the host.
    """

    def __init__(self, link: HostLink) -> None:
        self.link, self._way, self._order = link, list[Any](), count()

    def send(self, due: int, write: Callable[[], None]) -> None:
        """Let something be written before a tick."""
        heapq.heappush(self._way, (due, next(self._order), write))

    def deliver(self, tick: int) -> None:
        """Write what has come by a tick."""
        while self._way and self._way[0][0] <= tick:
            heapq.heappop(self._way)[2]()


@contextmanager
def hosted(scene: gx.Scene) -> Iterator[tuple[Any, HostLink]]:
    """Open a scene and connect to it."""
    with gx.open(scene) as session:
        session.step()
        with HostLink(name_of(scene), timeout=0.0) as link:
            yield session, link


def raw(
    link: HostLink, number: int, external: FloatArray, internal: FloatArray, origin: FloatArray, time: float
) -> None:
    """Write a sample as any program does that knows the layout of the record."""
    words = np.asarray(link._words)
    first, size = int(words[6]), int(words[7])
    slot = words[first + size * (number % 8) :][:size]
    slot[:3] = number, time, 0.0
    slot[3:-1] = np.concatenate([external.ravel(), internal.ravel(), origin.ravel()])
    slot[-1] = sum(slot[:-1].tolist())
    words[12] = number


def spring(read: Operator, rest: FloatArray, push: float, squeeze: float) -> tuple[FloatArray, FloatArray]:
    """Forces of a linear environment on the operator: external and internal, by springs to where the fingers began."""
    moved = read.position - rest
    external, internal = gx.divide(gx.Grasp(rest), moved.ravel())
    return -push * external.reshape(rest.shape), -squeeze * internal.reshape(rest.shape)
