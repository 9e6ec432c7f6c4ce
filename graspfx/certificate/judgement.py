"""The judgement of a scene with other values: its certificates' figures, and how it holds and squeezes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from graspfx import plugins
from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.certificate.certificate import STANDING, Limit, is_stable
from graspfx.certificate.certificates import spectral_radius
from graspfx.certificate.hand_load import HandCourse, grip_of, hand_course
from graspfx.certificate.linearise import Linearised, linearise
from graspfx.certificate.mode_limits import mode_limits, pushing_limits, standing_limits
from graspfx.certificate.rest.place import NotGraspingError
from graspfx.errors import InputError, NoRestError
from graspfx.scene.model import Scene

TINY = 1e-15  # [J]: a squeeze that is rounding
MOVING = ("motion", "duration", "start", "position")  # parts of keys by which a hand's course changes


@dataclass(frozen=True)
class ObjectLimit:
    """A limit of one object's grasp."""

    object: str
    limit: Limit

    @property
    def text(self) -> str:
        """Mode, gain, limit, margin and frequency in words."""
        return f"{self.limit.mode} {self.limit.text}"


@dataclass(frozen=True)
class Judgement:
    """A scene with some values, judged.

    Attributes:
        values: by dotted key, that were replaced.
        stable: whether each object's loop is known to be, as `Certificate.stable`; False where there is no rest.
        spectral_radius: of the loop that is nearest to instability; inf where there is no rest, or no finger touches an
            object.
        limits: of the modes of all objects, and of what they stand on.
        pushing: of fingers that push alone; none unless asked for.
        grip: squeeze over the least one that holds the load (`hand_load.grip_of`), the least of all objects.
        depth: of the deepest fingertip at rest [m]; nan without a rest.
        squeeze: internal force of the finger that squeezes most, at rest [N]; nan without a rest.
        force: of the finger that presses most, at rest [N]; nan without a rest.
        displayed: stiffness of the squeeze at rest, pads in series: |f_i|^2/(f_i.e), e from contact to fingertip [N/m];
            nan without a rest.
        at: "squeezed"; "start" where a finger does not touch at rest, "" where no rest was found, "apart" where no
            finger touches an object.
        assumed: what the certificates take for granted.
        scene: with the values.
    """

    values: Mapping[str, float]
    stable: bool
    spectral_radius: float
    limits: tuple[ObjectLimit, ...]
    pushing: tuple[ObjectLimit, ...] = ()
    grip: float = math.nan
    depth: float = math.nan
    squeeze: float = math.nan
    force: float = math.nan
    displayed: float = math.nan
    at: str = "squeezed"
    assumed: tuple[str, ...] = field(default=(), repr=False)
    scene: Scene | None = field(default=None, repr=False, compare=False)

    @property
    def worst(self) -> ObjectLimit | None:
        """The row of least margin, the most special of equal ones; None without gains."""
        return min(self.limits, key=lambda row: (round(row.limit.margin, 9), -len(row.limit.mode)), default=None)

    @property
    def margin(self) -> float:
        """The least limit over gain; of a loop that is not stable although no gain is beyond its limit, 1/radius."""
        least = min((row.limit.margin for row in self.limits), default=math.inf)
        return least if self.stable else min(least, 1.0 / self.spectral_radius)

    def margin_of(self, mode: str) -> float:
        """Give the least margin of one mode over the objects; inf where no object has the mode."""
        rows = (*self.limits, *self.pushing)
        return min((row.limit.margin for row in rows if row.limit.mode == mode), default=math.inf)


class Judge:
    """Judgements of a scene with other values, each at a rest of its own.

    Args:
        scene: whose values are replaced.
        grips: whether grip and forces are of interest, too.
    """

    def __init__(self, scene: Scene, *, grips: bool = False) -> None:
        self.scene, self.count = scene, 0
        self._touched = sorted(set(scene.finger_objects))
        if not self._touched:
            raise InputError("scene", scene.source.name, "a scene whose fingers touch an object")
        self._grips = grips
        self._courses: dict[int, HandCourse] = {}

    @contextmanager
    def session(self) -> Iterator[None]:
        """Judge many within: installed packages and shelves are looked up once, one BLAS thread solves."""
        with plugins.unchanged(), one_blas_thread():
            yield

    def loops(self, values: Mapping[str, Any]) -> tuple[Scene, list[Linearised]]:
        """Give the scene with these values, and the loop of each object that fingers touch."""
        scene = self.scene.replace(values) if values else self.scene
        return scene, [linearise(scene, "squeezed", scene.object[i].name) for i in self._touched]

    def judge(self, values: Mapping[str, Any], *, pushing: bool = False) -> Judgement:
        """Judge the scene with these values in full, but for fingers that push alone unless asked for.

        Raises:
            SceneError: a key or a value that the scene does not take.
            InputError: a device that does not tell its mass or damping.
        """
        self.count += 1
        try:
            scene, loops = self.loops(values)
        except NotGraspingError as error:
            why, scene = (str(error),), self.scene.replace(values)
            return Judgement(dict(values), False, math.inf, (), grip=0.0, at="apart", assumed=why, scene=scene)
        except NoRestError as error:
            return Judgement(dict(values), False, math.inf, (), at="", assumed=(" ".join(str(error).split()),))
        rows, pushes, radius = [], [], 0.0
        for loop in loops:
            name = loop.objects[0]
            radius = max(radius, spectral_radius(loop.linear))
            limits = [*mode_limits(scene, loop, compare=False), *standing_limits(loop)]
            rows += [ObjectLimit(name, row) for row in limits]
            if pushing:
                pushes += [ObjectLimit(name, row) for row in pushing_limits(scene, loop)]
        standing = [row.limit for row in rows if row.limit.mode.startswith(STANDING)]
        stable = is_stable(radius) and all(row.margin >= 1.0 for row in standing)
        at = "start" if any("start" in loop.at for loop in loops) else "squeezed"
        assumed = tuple(dict.fromkeys(text for loop in loops for text in loop.assumed))
        numbers = self._numbers(scene, loops, values) if self._grips else {}
        return Judgement(
            dict(values), stable, radius, tuple(rows), tuple(pushes), at=at, assumed=assumed, scene=scene, **numbers
        )

    def _numbers(self, scene: Scene, loops: list[Linearised], values: Mapping[str, Any]) -> dict[str, float]:
        """Compute grip, depth and forces of the loops at rest."""
        each = []
        for index, loop in zip(self._touched, loops, strict=True):
            f, away = loop.forces, loop.tips - loop.contacts
            if np.isnan(f).any():  # no rest: nothing presses
                return {}
            internal = np.asarray(loop.splits[0].divide(f.ravel())[1]).reshape(f.shape)
            along = float((internal * away).sum())
            each.append((
                grip_of(scene, index, loop, self._course(scene, index, values)),
                float(np.linalg.norm(away, axis=1).max()),
                float(np.linalg.norm(internal, axis=1).max()),
                float(np.linalg.norm(f, axis=1).max()),
                float((internal**2).sum()) / along if along > TINY else math.nan,
            ))  # fmt: skip
        grip, depth, squeeze, force, displayed = zip(*each, strict=True)
        return {
            "grip": min(grip), "depth": max(depth), "squeeze": max(squeeze), "force": max(force),
            "displayed": min(displayed),
        }  # fmt: skip

    def _course(self, scene: Scene, index: int, values: Mapping[str, Any]) -> HandCourse:
        """Give the course of an object's hands, which is followed anew only where a key changes it."""
        if any(part in key for key in values for part in MOVING):
            return hand_course(scene, index)
        if index not in self._courses:
            self._courses[index] = hand_course(self.scene, index)
        return self._courses[index]
