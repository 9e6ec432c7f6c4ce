"""Calibration of a scene's hardware, device by device, with results as text and as TOML for a scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.calibration.calibration_bench import (
    Bench,
    FingerFigures,
    Prompt,
    axis_checks,
    finger_figures,
    on_bench,
    zero_check,
)
from graspfx.assembly.resolve import Parts, resolve
from graspfx.assembly.wiring import Wire
from graspfx.errors import InputError
from graspfx.loop.device import is_hardware
from graspfx.loop.realtime.pacing import WallClock
from graspfx.numeric import number

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

SHARE = 0.02  # fraction of a device's largest force that pushes use
UNTOLD = 3.0  # assumed largest force of a device that reports none [N]
MOST_SHARE = 0.2  # largest allowed share of a device's force
PULSES = 200


@dataclass(frozen=True, eq=False)
class DeviceMeasures:
    """Measured properties of one device.

    Attributes:
        fingers: Names of the device's fingers.
        key: Key of the device's table in the scene, `finger.0.device` or `device.0`.
        each: Properties of each finger, by name.
        round_trip: Median time of a reading and a writing [s].
        jitter: 1st and 99th percentiles of the time from a deadline to the end of its writing [s].
        axes: Result of the axis check of each finger, by axis.
        zero: Reading at the scene's origin by finger, (d,) [m].
    """

    fingers: tuple[str, ...]
    key: str
    each: Mapping[str, FingerFigures]
    round_trip: float
    jitter: tuple[float, float]
    axes: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    zero: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def delay(self) -> float:
        """Time from the end of a writing to the beginning of the reading that shows its effect, mean of fingers [s]."""
        return float(np.mean([each.delay.value for each in self.each.values()]))

    @property
    def lateness(self) -> float:
        """Time from a sample to its force, including the age of the sample [s]."""
        return max(self.delay + self.round_trip, 0.0)

    @property
    def measures(self) -> dict[str, Any]:
        """Table `measures` of the device in a scene."""
        each = list(self.each.values())
        table: dict[str, Any] = {
            "mass": float(np.mean([figures.mass.value for figures in each])),
            "friction": float(np.mean([figures.friction.value for figures in each])),
            "lateness": self.lateness,
            "jitter": [max(self.delay + end, 0.0) for end in self.jitter],
            "round_trip": self.round_trip,
        }
        resolution = max(figures.resolution for figures in each)
        return table | ({"resolution": resolution} if resolution > 0.0 else {})

    def lines(self) -> Iterator[str]:
        """Yield the results as lines of text."""
        yield f"{', '.join(self.fingers)} ({self.key})"
        for name, figures in self.each.items():
            delay, mass, friction = figures.delay, figures.mass, figures.friction
            yield f"  {name}: {figures.pulses} pulses of {figures.force:.3g} N"
            late, error = 1e3 * (delay.value + self.round_trip), 1e3 * delay.error
            yield f"    lateness    {late:8.3f} ms    +- {error:.3f}   from a sample to its force"
            yield f"    mass        {1e3 * mass.value:8.2f} g     +- {1e3 * mass.error:.2f}"
            yield f"    friction    {friction.value:8.4f} N s/m +- {friction.error:.4f}"
            if figures.resolution > 0.0:
                yield f"    resolution  {1e6 * figures.resolution:8.2f} um"
            axes = self.axes.get(name, {})
            yield from (f"    axis {axis}      {text}" for axis, text in axes.items())
            if not axes:
                yield "    axes        not checked: that needs a person"
            zero = self.zero.get(name)
            where = "not checked: that needs a person" if zero is None else f"read at {np.round(1e3 * zero, 2)} mm"
            yield f"    origin      {where}"
        low, high = (1e3 * (self.delay + end) for end in self.jitter)
        own = f"lateness includes {1e3 * self.round_trip:.3f} ms for reading and writing"
        yield f"  {own}; it is {low:.3f} to {high:.3f} ms in 98 % of the ticks"


@dataclass(frozen=True, eq=False)
class Calibration:
    """Measured properties of a scene's hardware.

    Attributes:
        scene: Name of the scene.
        devices: Properties of each device.
    """

    scene: str
    devices: tuple[DeviceMeasures, ...]

    @property
    def overrides(self) -> dict[str, Any]:
        """Measures by dotted key, for `gx.load(scene, overrides)`."""
        return {f"{each.key}.measures": each.measures for each in self.devices}

    def lines(self) -> Iterator[str]:
        """Yield all results as lines of text."""
        for each in self.devices:
            yield from each.lines()

    def toml(self) -> str:
        """Format the measures as TOML: overrides by dotted key, each a device's table `measures`."""
        text = [f"# Measures of the hardware of {self.scene}, by `graspfx calibrate`. Put each table into its device,"]
        text += ["#     device = { ..., measures = { ... } }"]
        text += ['# or load a scene with the whole file: gx.load(scene, tomllib.loads(Path("...").read_text()))']
        for key, table in self.overrides.items():
            values = ", ".join(f"{name} = {_figure(value)}" for name, value in table.items())
            text += [f'"{key}" = {{ {values} }}']
        return "\n".join(text) + "\n"


def _figure(value: float | Sequence[float]) -> str:
    if isinstance(value, float):
        return f"{value:.6g}" if "." in f"{value:.6g}" or "e" in f"{value:.6g}" else f"{value:.1f}"
    return f"[{', '.join(_figure(each) for each in value)}]"


def require_hardware(parts: Parts) -> None:
    """Require that a device of a scene is hardware.

    Raises:
        InputError: If all devices are simulated.
    """
    if not parts.hardware:
        remedy = "a simulated device has the properties of its settings"
        raise InputError("scene", parts.scene.source.name, "one with hardware", remedy)


def calibrate(
    scene: Scene | str | PathLike[str],
    *,
    pulses: int = PULSES,
    share: float = SHARE,
    prompt: Prompt | None = None,
) -> Calibration:
    """Measure a scene's hardware: lateness, mass, friction and resolution; with a person's help also origin and axes.

    Each device is opened separately, and comes to rest at zero force. Small pulses then push its fingers back and forth
    one by one, while nobody holds them. The scene's limits apply. However a calibration ends, forces are set to
    zero before the devices are closed.

    Args:
        scene: Name, path, or a Scene.
        pulses: Number of pulses per device, divided among its fingers.
        share: Fraction of a device's largest force for the pulses, at most one fifth.
        prompt: Function that shows instructions to a person; without it, axes and origin are not checked.

    Raises:
        InputError: If the scene has no hardware, or the share is out of range.
        DeviceError: If a device does not open, is not at rest, does not move, or has a fault.
        KeyboardInterrupt: If a signal ended the calibration.
    """
    from graspfx.scene.load import to_scene

    scene_ = to_scene(scene)
    if not 0.0 < number("share", share, "a number above zero") <= MOST_SHARE:
        raise InputError("share", share, f"a fraction of the largest force, above 0 and at most {MOST_SHARE:g}")
    if not number("pulses", pulses, "a whole number, 1 or more") >= 1:
        raise InputError("pulses", pulses, "a whole number, 1 or more")
    parts = resolve(scene_)
    require_hardware(parts)
    hardware = [wire for wire in parts.own_wires() if is_hardware(wire.device)]
    figures = tuple(_device(parts, wire, pulses, share, prompt) for wire in hardware)
    return Calibration(scene_.source.name, figures)


def _device(parts: Parts, wire: Wire, pulses: int, share: float, prompt: Prompt | None) -> DeviceMeasures:
    names = parts.scene.finger_names
    channels = {names[f]: channel for channel, f in enumerate(wire.fingers.tolist()) if f >= 0}
    axes, zero = dict[str, dict[str, str]](), dict[str, FloatArray]()
    if prompt is not None:
        prompt(f"move {', '.join(channels)} to the middle of the workspace and release: force pulses follow")
    with on_bench(parts, wire, WallClock()) as bench:
        each = {
            name: finger_figures(bench, channel, _force(bench, channel, share), max(1, pulses // len(channels)))
            for name, channel in channels.items()
        }
        trip, jitter = bench.round_trip, bench.lateness
        if prompt is not None:
            for name, channel in channels.items():
                axes[name] = axis_checks(bench, channel, name, wire.fitting.frame, prompt)
                place = zero_check(bench, channel, name, wire.fitting.frame, prompt)
                if place is not None:
                    zero[name] = place
    key = ".".join(map(str, wire.at))
    return DeviceMeasures(tuple(channels), key, each, trip, jitter, axes, zero)


def _force(bench: Bench, channel: int, share: float) -> float:
    limit = float(bench.limits[channel])
    return share * (limit if np.isfinite(limit) else UNTOLD)
