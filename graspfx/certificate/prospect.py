"""How the ticks of a scene will run: in how many calls, by which program, and what the key `engine` makes of that."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING

from graspfx.build.build import build
from graspfx.certificate.plan import PlanRow
from graspfx.compile.cache import folder_text
from graspfx.errors import GraspFXError, SceneError, message
from graspfx.loop.foreign import foreign, guests, looked_ahead
from graspfx.loop.tick.engine import LOADING, SPECIALISING
from graspfx.loop.tick.engine_text import sources, texts
from graspfx.loop.tick.programs import Compiled

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo
    from graspfx.loop.tick.script import Tick
    from graspfx.scene.model import Scene

WORD = re.compile(r"[A-Za-z_]\w*")
KERNEL = re.compile(r"^def (\w+)_\d+\(", re.MULTILINE)
INSTALL = "llvmlite is not installed: run `pip install llvmlite`"


@dataclass(frozen=True)
class Prospect:
    """The facts about a scene's ticks that are known before it runs.

    Attributes:
        foreign: parts that are no kernels.
        guests: bodies that other software moves.
        ahead: hands that are none, which cost no call.
        calls: of the program, for each tick; 0 where one call does many of them.
        calls_of_text: the kernels that the text of its tick calls.
        kernels: that are left in its program; None where that has not been specialised yet, which a look is not worth.
        size: of its machine code in the cache [bytes]; None if it is not there.
        llvm: whether there is LLVM to compile it.
    """

    foreign: tuple[str, ...]
    guests: tuple[str, ...]
    foreseen: tuple[str, ...]
    calls: int
    calls_of_text: frozenset[str]
    kernels: frozenset[str] | None
    size: int | None
    llvm: bool


def prospect(scene: Scene) -> Prospect:
    """Build the scene; nothing moves, and no program is specialised.

    Raises:
        GraspFXError: it cannot be built, or a part of it is not what it says.
    """
    with build(scene, engine="interpreted") as servo:
        tick = servo.script
        llvm = find_spec("llvmlite") is not None
        return Prospect(
            foreign=tuple(foreign(servo)),
            guests=tuple(guests(servo)),
            foreseen=tuple(looked_ahead(servo)),
            calls=2 if tick.ports else int(bool(tick.guests or tick.bodies or tick.plants)),
            calls_of_text=_calls_of_text(tick),
            kernels=_kernels_before(servo),
            size=_size(servo) if llvm else None,
            llvm=llvm,
        )


def kernels(servo: Servo) -> frozenset[str]:
    """List the names of the kernels in a servo's program."""
    return _names(sources(servo.script))


def _calls_of_text(tick: Tick) -> frozenset[str]:
    words = {word for text in texts(tick).values() for word in WORD.findall(text)}
    return frozenset(kernel.__name__ for name, kernel in tick.script.kernels.items() if name in words)


def _kernels_before(servo: Servo) -> frozenset[str] | None:
    """List them if the program has been specialised before."""
    try:
        return _names(sources(servo.script, make=False))
    except LookupError:
        return None


def _names(programs: Mapping[str, str]) -> frozenset[str]:
    return frozenset(name for source in programs.values() for name in KERNEL.findall(source))


def engine_plan(scene: Scene) -> list[PlanRow]:
    """Tell the calls of a run, its program, and which engine runs it: rows to stand below those of `plan`.

    Raises:
        SceneError: the scene cannot be built, and no run of it begins: that is a fault of it like any other.
    """
    try:
        facts = prospect(scene)
    except SceneError:
        raise
    except GraspFXError as error:
        raise scene.error([((), message(error))]) from error
    return [PlanRow("calls", True, _calls(facts)), _program(facts), *_engine(scene, facts)]


def _size(servo: Servo) -> int | None:
    try:
        return sum(program.size for program in Compiled(servo.script, make=False).programs.values())
    except LookupError:
        return None


def _calls(facts: Prospect) -> str:
    beforehand = f"; {_listed(facts.foreseen)} no kernel: asked beforehand for many ticks" if facts.foreseen else ""
    if not facts.calls:
        return f"all parts are kernels: one call for many ticks{beforehand}"
    calls = "two calls for each tick" if facts.calls == 2 else "one call for each tick"
    why = [f"{_listed(facts.foreign)} no kernel{'' if len(facts.foreign) == 1 else 's'}"] if facts.foreign else []
    why += [f"{_listed(facts.guests)} moved by other software between ticks"] if facts.guests else []
    return f"{calls}, as {' and '.join(why)}{beforehand}"


def _listed(parts: Collection[str]) -> str:
    return f"{', '.join(parts)} {'is' if len(parts) == 1 else 'are'}"


def _program(facts: Prospect) -> PlanRow:
    if facts.kernels is None:
        text = f"a tick that calls {len(facts.calls_of_text)} kernels, to be specialised for this scene"
    else:
        text = f"{len(facts.kernels)} kernels, specialised for this scene"
    if facts.size is not None:
        return PlanRow("program", True, f"{text}; compiled, {1e-3 * facts.size:.0f} kB in {folder_text()}")
    if not facts.llvm:
        return PlanRow("program", False, f"{text}; {INSTALL} to have it compiled")
    return PlanRow("program", True, f"{text}; not in {folder_text()} yet, where `graspfx warmup` puts it compiled")


def _engine(scene: Scene, facts: Prospect) -> Iterator[PlanRow]:
    if scene.engine == "interpreted":
        yield PlanRow("engine", True, "interpreted, as the scene says")
    elif not facts.llvm:
        yield PlanRow("engine", scene.engine == "auto", f"interpreted: {INSTALL}")
    elif scene.engine == "compiled":
        first = "" if facts.size is not None else ", before the first tick"
        yield PlanRow("engine", True, f"compiled{first}, as the scene says")
    elif scene.engine == "generic":
        yield PlanRow("engine", True, "kernels compiled for all scenes, as the scene says")
    else:
        yield PlanRow("engine", True, f"auto: {_choice(round(scene.duration / scene.period), facts)}")


def _choice(ticks: int, facts: Prospect) -> str:
    """Say what `auto` makes of a number of ticks."""
    if ticks >= LOADING and facts.size is not None:
        return f"the specialised program, for {ticks} ticks ({LOADING} or more)"
    text = f"kernels compiled for all scenes, for {ticks} ticks"
    if ticks < SPECIALISING:
        return f"{text}; from {SPECIALISING} on a program is specialised meanwhile"
    return f"{text}, until a program is specialised"
