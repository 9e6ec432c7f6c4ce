"""Preview of a run: the number of calls per tick, and the engine with the reason for it."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from graspfx.assembly.build import build
from graspfx.certificate.plan import PlanRow
from graspfx.compile.cache import folder_text
from graspfx.errors import GraspFXError, InputError, KernelError, SceneError, message
from graspfx.loop.engine import is_machine_code, kept_program, machine_codes
from graspfx.loop.servo import foreign, guests, looked_ahead

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo
    from graspfx.scene.model import Scene

INSTALL = "llvmlite is not installed: run `pip install llvmlite`"


def engine_plan(scene: Scene) -> list[PlanRow]:
    """Return the rows about calls and engine, which follow those of `plan`.

    The scene is assembled, but nothing moves, and the program of all scenes is not compiled.

    Raises:
        SceneError: If the scene cannot be assembled, so that no run can begin.
    """
    try:
        with build(scene, engine="interpreted") as servo:
            return [PlanRow("calls", True, _calls(servo)), _engine(scene, servo)]
    except SceneError:
        raise
    except GraspFXError as error:
        raise scene.error([((), message(error))]) from error


def _calls(servo: Servo) -> str:
    world, ahead = servo.arena.world, looked_ahead(servo)
    why_ahead = "it is not a kernel" if len(ahead) == 1 else "they are not kernels"
    beforehand = f"; the targets of {', '.join(ahead)} are computed in advance, because {why_ahead}" if ahead else ""
    if not world.pauses:
        return f"one call for many ticks{beforehand}" if ahead else "all parts are kernels: one call for many ticks"
    called, moved = foreign(servo), guests(servo)
    calls = "two calls for each tick" if world.ports else "one call for each tick"
    why = [f"{_listed(called)} not {'a kernel' if len(called) == 1 else 'kernels'}"] if called else []
    why += [f"{_listed(moved)} moved by other software between ticks"] if moved else []
    return f"{calls}, because {' and '.join(why)}{beforehand}"


def _listed(parts: Collection[str]) -> str:
    return f"{', '.join(parts)} {'is' if len(parts) == 1 else 'are'}"


def _engine(scene: Scene, servo: Servo) -> PlanRow:
    says = "" if scene.engine == "auto" else ", as the scene requires"
    if scene.engine == "interpreted":
        return PlanRow("engine", True, f"interpreted{says}")
    if why := _obstacle(servo):
        if scene.engine == "auto":
            return PlanRow("engine", True, f"interpreted: {why}")
        return PlanRow("engine", False, f"cannot be compiled, although the scene requires it: {why}")
    program = kept_program()
    if program is None:
        where = f"compiled before the first tick, once per version and machine (`graspfx warmup`), into {folder_text()}"
    else:
        where = f"{1e-3 * program.size:.0f} kB in {program.place}"
    return PlanRow("engine", True, f"compiled{says}, by the program of all scenes: {where}")


def _obstacle(servo: Servo) -> str:
    """Return the reason why the scene cannot run compiled; empty if it can."""
    if not is_machine_code():
        return INSTALL
    try:
        machine_codes(servo.arena)
    except KernelError:
        raise
    except InputError as error:
        return message(error)
    return ""
