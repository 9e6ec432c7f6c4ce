"""Python source of the program that is compiled to run `steps`, and that contains every kernel that a scene can use."""

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
    """Return the cache key of the program, which depends on the sources of the kernels."""
    modules = {name.rpartition(".")[0] for name in KERNELS if name}
    return request_key(("graspfx.loop.step", *sorted(modules)), "steps", ENTRY)


def source(*, make: bool = True) -> str:
    """Return the Python source of the program, which defines run(arena, rows, world, k, count, r).

    If `count` >= 0, `run` calls `steps`. If `count` is -1, `run` calls `sample` for the grasp at place `world`. If
    `count` < -1, `run` calls `external_forces` for that grasp, and writes the forces to `rows` from entry r on.

    Args:
        make: Whether to write and cache the program if it is not in the cache. If False, LookupError is raised instead.
        make: Whether to write the program if it is not cached; if False, a missing program raises LookupError.
    """
    from graspfx.compile.kernel import keep_lowerings
    from graspfx.compile.program import Program

    text = recall(key := program_key())
    if text is None:
        if not make:
            raise LookupError("the program of `steps` is not in the cache, and `make` is False")
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
