"""Kernels of a scene's parts by their numbers, and the program of `steps` for all scenes.

A number below `len(KERNELS)` is one of the package's, which the program calls; any other is that of a kernel of
others: the address of its machine code, or, interpreted, the number under which its function was announced.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

from graspfx.compile.kernel import source_function
from graspfx.compile.marks import bound_late, parameter_kinds, written

Kernel = Callable[..., Any]

PARTS = (  # of devices and plants: block
    "graspfx.devices.simulated.point_sample.read",
    "graspfx.devices.simulated.point_sample.write",
    "graspfx.devices.simulated.point_sample.stop",
    "graspfx.devices.simulated.points.advance",
    "graspfx.devices.simulated.operated_sample.advance",
    "graspfx.devices.two_link.arm_sample.read",
    "graspfx.devices.two_link.arm_sample.write",
    "graspfx.devices.two_link.arm_sample.stop",
    "graspfx.devices.two_link.arm_dynamics.advance",
)
HANDS = (  # block, time
    "graspfx.loop.motion.targets.target",
    "graspfx.loop.motion.targets.guided_target",
    "graspfx.loop.motion.targets.joined_target",
    "graspfx.loop.motion.targets.joined_guided_target",
)
BODIES = (  # block, block beside it, period
    "graspfx.objects.body.advance",
    "graspfx.objects.body.expect",
    "graspfx.objects.floor.floor.advance",
    "graspfx.objects.floor.floor.expect",
    "graspfx.objects.guest.hand_over",
    "graspfx.objects.guest.take_over",
)
KERNELS = ("", *PARTS, *HANDS, *BODIES)  # number 0 is none

_ANNOUNCED: dict[int, Kernel] = {}  # kernels of others, for interpreted ticks


def number_of(kernel: Kernel) -> int | None:
    """Give the number of a kernel of the package; None for one of others."""
    return _numbers().get(f"{kernel.__module__}.{kernel.__qualname__}")


@cache
def _numbers() -> dict[str, int]:
    return {name: k for k, name in enumerate(KERNELS) if k}


@cache
def _kernel(number: int) -> Kernel:
    """Import a kernel of the package, as the function on numbers and entries."""
    return source_function(_written(number))


def _written(number: int) -> Kernel:
    module, _, name = KERNELS[number].rpartition(".")
    kernel: Kernel = getattr(import_module(module), name)
    return kernel


def kernel_of(number: int) -> Kernel:
    """Give the kernel of the package that has a number."""
    return _written(number)


def announce(kernel: Kernel) -> int:
    """Give the number under which interpreted ticks find a kernel of others."""
    number = len(KERNELS) + id(kernel)
    _ANNOUNCED[number] = kernel
    return number


def _function(number: int) -> Kernel:
    return _kernel(number) if number < len(KERNELS) else _ANNOUNCED[number]


@bound_late
def invoke(buffer: Any, kernel: int, place: int) -> int:
    """Call kernel(S, o) of a device or a plant, by number."""
    result: int = _function(kernel)(buffer, place)
    return result


@bound_late
def invoke_at(buffer: Any, kernel: int, place: int, t: float) -> int:
    """Call kernel(S, o, t) of a hand."""
    _function(kernel)(buffer, place, t)
    return 0


@bound_late
def invoke_beside(buffer: Any, kernel: int, place: int, beside: int, T: float) -> int:
    """Call kernel(S, o, F, f, T) of a body."""
    return _function(kernel)(buffer, place, buffer, beside, T) or 0


@bound_late
def call(buffer: Any, address: int, place: int) -> int:
    """Call machine code by its address; interpreted ticks have none."""
    raise NotImplementedError


@bound_late
def call_at(buffer: Any, address: int, place: int, t: float) -> int:
    """Call the machine code of a hand's kernel by its address."""
    raise NotImplementedError


@bound_late
def call_beside(buffer: Any, address: int, place: int, beside: int, t: float) -> int:
    """Call the machine code of a body's kernel by its address."""
    raise NotImplementedError


# The program ----------------------------------------------------------------------------------------------------------

UNROLL = 400  # statements of a loop that is written out: over axes, of which there are three at most
ENTRY = """
def run(world, k, count, r):
    if count < 0:
        return sample(arena, world)
    return steps(arena, world, k, count, r, rows, 0)
"""


def source(*, make: bool = True) -> str:
    """Write the program of `steps` as Python: run(arena, rows, world, k, count, r).

    With a count below zero it is `sample` of the grasp at a place instead.

    Args:
        make: whether to write what is not in the cache; else a LookupError.
    """
    from graspfx.compile.freshness import recall, remember, request_key
    from graspfx.compile.kernel import keep_lowerings
    from graspfx.compile.specialise.specialise import Program
    from graspfx.compile.specialise.values import Dynamic, Memory
    from graspfx.coupling.sample import sample
    from graspfx.loop.step import steps

    modules = {name.rpartition(".")[0] for name in KERNELS if name}
    key = request_key(("graspfx.loop.step", *sorted(modules)), "steps", ENTRY)
    text = recall(key)
    if text is None:
        if not make:
            raise LookupError("not written yet")
        program = Program({}, UNROLL)
        buffers = {"arena": Memory("arena", 0), "rows": Memory("rows", 0)}

        def add(definition: str, names: dict[str, Any]) -> None:
            [tree] = ast.parse(definition).body
            assert isinstance(tree, ast.FunctionDef)
            arguments = [Dynamic(ast.Name(a.arg, ast.Load())) for a in tree.args.args]
            program.add_text(definition, {**names, **buffers}, arguments)

        for name, kernels, parameters, arguments, others in (
            ("invoke", PARTS, "kernel, place", "arena, place", call),
            ("invoke_at", HANDS, "kernel, place, t", "arena, place, t", call_at),
            ("invoke_beside", BODIES, "kernel, place, beside, T", "arena, place, arena, beside, T", call_beside),
        ):
            lines, names = [f"def {name}({parameters}):"], {others.__name__: others}
            for each in kernels:
                number = KERNELS.index(each)
                kernel = names[f"kernel_{number}"] = _written(number)
                lines += [f"    if kernel == {number}:"]
                if parameter_kinds(written(kernel))["return"] in (None, type(None)):
                    lines += [f"        kernel_{number}({arguments})", "        return 0"]
                else:
                    lines += [f"        return kernel_{number}({arguments})"]
            add("\n".join([*lines, f"    return {others.__name__}(arena, {parameters})"]), names)
        add(ENTRY, {"steps": steps, "sample": sample})
        text = program.source()
        keep_lowerings()
        remember(key, program, text)
    return text
