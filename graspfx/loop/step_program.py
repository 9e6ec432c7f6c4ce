"""Program of `steps` for all scenes, in Python: all kernels that it calls, and the kernels of parts by number."""

from __future__ import annotations

from functools import cache

from graspfx.compile.kernel_marks import parameter_kinds, written
from graspfx.compile.own_sources import recall, remember, request_key
from graspfx.coupling.sample import external_forces, sample
from graspfx.loop.kernels import BODIES, HANDS, KERNELS, PARTS, call, call_at, call_beside, kernel_of
from graspfx.loop.step import steps

ENTRY = """
def run(world, k, count, r):
    if count == -1:
        return sample(arena, world)
    if count < -1:
        return external_forces(arena, world, rows, r)
    return steps(arena, world, k, count, r, rows, 0)
"""


@cache
def program_key() -> str:
    """Return the cache key of the program, which depends on the sources from which it is made."""
    modules = {name.rpartition(".")[0] for name in KERNELS if name}
    return request_key(("graspfx.loop.step", *sorted(modules)), "steps", ENTRY)


def source(*, make: bool = True) -> str:
    """Write the program of `steps` as Python: run(arena, rows, world, k, count, r).

    With a count of -1 the program instead runs `sample` of the grasp at the place `world`. With a count below -1 it
    runs `external_forces` of that grasp, and writes the forces to the rows from entry r on.

    Args:
        make: Whether to write the program if it is not cached; if False, a missing program raises LookupError.
    """
    from graspfx.compile.kernel import keep_lowerings
    from graspfx.compile.program import Program

    text = recall(key := program_key())
    if text is None:
        if not make:
            raise LookupError("not written yet")
        program = Program()
        for name, kernels, parameters, arguments, others in (
            ("invoke", PARTS, "kernel, place", "arena, place", call),
            ("invoke_at", HANDS, "kernel, place, t", "arena, place, t", call_at),
            ("invoke_beside", BODIES, "kernel, place, beside, T", "arena, place, arena, beside, T", call_beside),
        ):
            lines, names = [f"def {name}({parameters}):"], {others.__name__: others}
            for each in kernels:
                number = KERNELS.index(each)
                kernel = names[f"kernel_{number}"] = kernel_of(number)
                lines += [f"    if kernel == {number}:"]
                if parameter_kinds(written(kernel))["return"] in (None, type(None)):
                    lines += [f"        kernel_{number}({arguments})", "        return 0"]
                else:
                    lines += [f"        return kernel_{number}({arguments})"]
            lines += [f"    return {others.__name__}(arena, {parameters})"]
            program.add_text("\n".join(lines), names, ["arena"])
        entry = {"steps": steps, "sample": sample, "external_forces": external_forces}
        program.add_text(ENTRY, entry, ["arena", "rows"])
        text = program.source()
        keep_lowerings()
        remember(key, program.files, program.numbers_of_modules, text)
    return text
