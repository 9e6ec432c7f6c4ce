"""Ahead-of-time compilation of the program that all scenes share, and of kernels of plug-ins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

from graspfx.assembly.build import build
from graspfx.errors import GraspFXError
from graspfx.grasp import point_sets
from graspfx.loop.engine import machine_codes, program
from graspfx.loop.realtime import beat
from graspfx.loop.realtime.lifecycle import HAS_NATIVE
from graspfx.scene.load import load

if TYPE_CHECKING:
    from graspfx.compile.native import Native

KERNELS = "kernels of all scenes"
COMPILED, CACHED, NOTHING, CANNOT = "compiled", "was there", "nothing", "cannot"


@dataclass(frozen=True)
class Warmed:
    """Result of ahead-of-time compilation.

    Attributes:
        scene: Name or path of the scene, or `KERNELS` for the program that all scenes share.
        state: "compiled" if the machine code was compiled and cached, "was there" if it was cached before, "nothing" if
            the scene has no kernels of plug-ins, or "cannot" if compilation is not possible.
        seconds: Computing time [s].
        size: Size of the machine code [bytes].
        why: Reason why compilation is not possible; otherwise empty.
    """

    scene: str
    state: str
    seconds: float = 0.0
    size: int = 0
    why: str = ""


def warm_kernels() -> Warmed:
    """Compile the program that all scenes share, the real-time loop and the kernels of `gx.Split`, if not cached."""
    began = perf_counter()
    natives = [program(), *([beat.program()] if HAS_NATIVE else [])]
    point_sets.warm()
    return _warmed(KERNELS, natives, began)


def warm(name: str, overrides: Mapping[str, Any], preset: str | None = None) -> Warmed:
    """Compile the kernels of a scene's plug-ins, without opening hardware."""
    began = perf_counter()
    try:
        with build(load(name, overrides, preset=preset), engine="interpreted") as servo:
            natives = [native for _, native in machine_codes(servo.arena)]
    except GraspFXError as error:
        return Warmed(name, CANNOT, perf_counter() - began, why=" ".join(str(error).split()))
    return _warmed(name, natives, began)


def _warmed(name: str, natives: list[Native], began: float) -> Warmed:
    seconds, size = perf_counter() - began, sum(native.size for native in natives)
    for native in natives:
        if native.note:
            return Warmed(name, CANNOT, seconds, size, native.note)
    state = CACHED if all(native.cached for native in natives) else COMPILED
    return Warmed(name, state if natives else NOTHING, seconds, size)
