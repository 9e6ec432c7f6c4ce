"""Functions of Python that run a tick's lines: to be interpreted, specialised, or compiled with generic kernels."""

from __future__ import annotations

from graspfx.compile.records import start_of
from graspfx.loop.tick.memory import ServoState
from graspfx.loop.tick.script import NAME, Tick


def whole_text(tick: Tick, *, pausing: bool = False) -> str:
    """Write the definition of run(k, count, r).

    Args:
        tick: the tick.
        pausing: whether it gives the ticks done, and the one in which the first fault happened is the last of them.
    """
    faulted, latched = (f"{tick.own_name}[{start_of(ServoState, name)}]" for name in ("faulted", "tick"))
    lines = [*tick.begin, *tick.end]
    lines += [f"if {faulted} != 0.0 and {latched} == k:", "    return i + 1"] if pausing else []
    body = [f"        {line}" for line in [*lines, "k += 1", "r += 1"]]
    return "\n".join(["def run(k, count, r):", "    for i in range(count):", *body, "    return count"])


def part_text(name: str, parameters: str, lines: list[str]) -> str:
    """Write the definition of a part of one tick."""
    return "\n".join([f"def {name}({parameters}):", *(f"    {line}" for line in lines)])


def texts(tick: Tick) -> dict[str, str]:
    """Write the functions of a tick, by name: one for any number of ticks, or two where code comes between."""
    if not tick.ports:
        return {"run": whole_text(tick, pausing=True)}
    return {"begin": part_text("begin", "k", tick.begin), "end": part_text("end", "k, r", tick.end)}


def joined_texts(tick: Tick) -> dict[str, str]:
    """Write the same functions as programs of their own, which take the arrays that they name.

    The lines of a tick are a function apart: what stands in a loop is written several times, until the kinds of its
    variables are settled.
    """
    arrays = ", ".join(arrays_of(tick))
    if tick.ports:
        return {name: text.replace("(", f"({arrays}, ", 1) for name, text in texts(tick).items()}
    faulted, latched = (f"{tick.own_name}[{start_of(ServoState, name)}]" for name in ("faulted", "tick"))
    run = f"""
def run({arrays}, k, count, r):
    for i in range(count):
        tick({arrays}, k, r)
        if {faulted} != 0.0 and {latched} == k:
            return i + 1
        k += 1
        r += 1
    return count
"""
    return {"run": part_text("tick", f"{arrays}, k, r", [*tick.begin, *tick.end]) + run}


def arrays_of(tick: Tick) -> list[str]:
    """List the arrays that a tick's lines name."""
    names = {name for line in [*tick.begin, *tick.end] for name in NAME.findall(line)} | {tick.own_name}
    return [name for name in [*tick.script.arrays, "rows"] if name in names]


def sources(tick: Tick, *, make: bool = True) -> dict[str, str]:
    """Specialise the same texts as programs; LookupError if they are not yet and are not to be made."""
    from graspfx.compile.program import program_source

    script = tick.script
    arrays = [*script.arrays, "rows"]
    return {
        name: program_source(text, script.kernels, arrays, script.frozen, make=make)
        for name, text in texts(tick).items()
    }
