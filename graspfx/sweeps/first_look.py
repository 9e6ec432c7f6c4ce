"""A first look at a sweep's scene: what its variants record, whether they are native, and that some of them is one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from graspfx.assembly.build import build
from graspfx.assembly.late_simulations import require_prompt_simulations
from graspfx.assembly.resolve import resolve
from graspfx.assembly.run import ticks_of, warn_of_axes
from graspfx.errors import InputError, SceneError
from graspfx.loop.columns import Layout
from graspfx.loop.foreign import foreign, guests, looked_ahead
from graspfx.sweeps.chunk import column_of
from graspfx.sweeps.variant_grid import VariantGrid

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

MOST = 64  # variants that are looked at until one is a scene


class Prospect(NamedTuple):
    """Sight of a sweep before it begins: of a variant that is a scene."""

    layout: Layout
    shapes: dict[str, tuple[int, ...]]
    native: bool
    ticks: int


def look_at(scene: Scene, variants: VariantGrid, duration: float | None, measure: Sequence[str]) -> Prospect:
    """Look at the first variant that is a scene, of some all over the sweep.

    Raises:
        SceneError: none of them is: that of the first, with its values.
        InputError: a scene with hardware, or a duration that is none.
        UnknownNameError: a quantity that it does not have.
        MissingPackageError: a package that it needs.
    """
    first: SceneError | None = None
    for number in spread(len(variants)):
        overrides = variants.overrides(number)
        try:
            variant = scene.replace(overrides)
            variant.require_reach()
        except SceneError as error:
            first = first or error
            continue
        return _prospect(variant, duration, measure)
    assert first is not None
    raise first


def _prospect(scene: Scene, duration: float | None, measure: Sequence[str]) -> Prospect:
    parts = resolve(scene)
    if parts.hardware:
        names = ", ".join(parts.hardware)
        raise InputError("scene", names, "simulated devices", "a sweep moves no hardware: nobody watches all its runs")
    require_prompt_simulations(parts)
    warn_of_axes(parts)
    ticks = ticks_of(scene.duration if duration is None else duration, scene.period)
    with build(scene) as servo:
        layout = servo.layout
        shapes = {name: column_of(layout, name).shape for name in measure}
        native = not any((*foreign(servo), *guests(servo), *looked_ahead(servo)))
    return Prospect(layout, shapes, native, ticks)


def spread(count: int) -> Iterator[int]:
    """Give some numbers below a count: the first, the last, then those in the middle of what is left."""
    seen: set[int] = set()
    shares = (0.0, 1.0, *((2 * k + 1) / 2**level for level in range(1, 8) for k in range(2 ** (level - 1))))
    for share in shares:
        number = round(share * (count - 1))
        if number not in seen and len(seen) < MOST:
            seen.add(number)
            yield number
