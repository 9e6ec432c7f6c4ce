"""Intended motion, tremor and noise of the hands in a recording, computed from the recorded table of the scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import GraspFXError
from graspfx.loop.motion import motion as motions
from graspfx.loop.motion.tremor import Tremor
from graspfx.loop.operator import NOISE, Operator

FloatArray = NDArray[np.float64]

FASTEST = 10.0  # [Hz], upper bound of an operator's intended motion
HARMONICS = 3  # highest harmonic of a sine that contacts and rotations may generate
CLOSE = 0.05  # relative tolerance of a frequency


@dataclass(frozen=True)
class Drive:
    """Excitation of fingers by their hands.

    Attributes:
        parts: Intended motions, each with a factor that converts the offset of the motion to metres at the fingertips.
        frequencies: Frequencies of the sines in the intended motions [Hz].
        complete: False if the scene does not determine the motion of a hand, or if a person moves a device.
        tremors: Tremors of the hands.
        noises: Operator models of the hands whose muscle forces have noise.
    """

    parts: tuple[tuple[motions.Motion, float], ...]
    frequencies: tuple[float, ...]
    complete: bool
    tremors: tuple[Tremor, ...] = ()
    noises: tuple[Operator, ...] = ()

    def at(self, times: NDArray[Any]) -> FloatArray:
        """Compute the c components of all intended offsets at times (M,) [s].

        The result (M, 1 + c) [m] begins with a column of zeros.
        """
        columns = [scale * np.array([motion.at(t)[0] for t in times.tolist()]) for motion, scale in self.parts]
        return np.concatenate([np.zeros((len(times), 1)), *columns], axis=1)

    def tremor(self, times: NDArray[Any]) -> FloatArray:
        """Compute the c components of all offsets by tremor at times (M,) [s].

        The result (M, 1 + c) [m] begins with a column of zeros.
        """
        return np.concatenate([np.zeros((len(times), 1)), *(each.over(times) for each in self.tremors)], axis=1)

    def noise(self, times: NDArray[Any], depth: float) -> FloatArray:
        """Compute the offsets of c fingers by noise of muscle forces.

        Args:
            times: Times, (M,) [s].
            depth: Displacement of the fingers relative to the object that the muscle forces cause [m]. A relative
                change of the forces changes the displacement by the same fraction.

        Returns:
            A column of zeros, then one column of offsets per finger, (M, 1 + c) [m].
        """
        columns = [depth * operator.noise(times) for operator in self.noises]
        return np.concatenate([np.zeros((len(times), 1)), *columns], axis=1)

    def swings(self, frequency: float, resolution: float) -> bool:
        """Return whether an observed motion may be caused by the intended motion of the hands.

        The result is true if the frequency is that of a sine of the hands, or two or three times this frequency. If the
        motion of the hands is not completely known (`complete`), it is also true for all frequencies below 10 Hz.

        Args:
            frequency: Frequency of the observed motion [Hz].
            resolution: Resolution of the frequency [Hz].
        """
        if not self.complete and frequency < FASTEST:
            return True
        near = max(resolution, CLOSE * frequency)
        return any(abs(frequency - h * f) < near for f in self.frequencies for h in range(1, HARMONICS + 1))


def drive(
    table: Mapping[str, Any], fingers: Sequence[int], folder: str, start: FloatArray, centre: FloatArray
) -> Drive:
    """Compute the excitation of fingers that touch one object.

    Args:
        table: Table of the scene in the header of a recording.
        fingers: Indices of the k fingers.
        folder: Folder to which paths in the scene are relative.
        start: Initial positions of these fingers (k, d) [m].
        centre: Initial centre of the object (d,) [m], the default centre of a hand's rotation.
    """
    rows = table.get("finger") or []
    if any(i >= len(rows) for i in fingers):
        return Drive((), (), False)
    by_name = {hand.get("name"): hand for hand in table.get("hand") or []}
    hands: dict[int, Mapping[str, Any] | None] = {}  # tables by the first finger of each hand
    held: dict[int, list[int]] = {}
    for i in fingers:
        hand = rows[i].get("hand")
        named = isinstance(hand, str)
        first = next(k for k, row in enumerate(rows) if row.get("hand") == hand) if named else i
        hands[first] = by_name.get(hand) if named else hand
        held.setdefault(first, []).append(i)
    parts: list[tuple[motions.Motion, float]] = []
    sines: list[float] = []
    tremors: list[Tremor] = []
    noises: list[Operator] = []
    complete = all(_is_simulated(table, rows[i]) for i in fingers)
    for first, hand in hands.items():
        if hand is None:  # no hand holds the finger, and nothing moves it
            continue
        if "kind" in hand:  # hand of a plug-in, whose motion is arbitrary
            complete = False
            continue
        complete = complete and hand.get("guide") is None  # a guided hand has goals that change during a run
        try:
            parts += _parts(hand, folder, start, centre)
        except (GraspFXError, KeyError, OSError):  # the file of a path no longer exists
            complete = False
        tables = [*_listed(hand.get("motion")), *_listed(hand.get("turn"))]
        sines += [float(each["frequency"]) for each in tables if each.get("kind") == "sine"]
        if (own := hand.get("tremor")) is not None:
            band = (own["amplitude"], own.get("frequency", 10.0), own.get("width", 4.0))
            seed = (own.get("seed", 0), first)
            tremors.append(Tremor(*band, len(centre), seed, own.get("begin", 0.0), own.get("ramp", 0.5)))
        if (own := hand.get("noise")) is not None:
            seeds = [(own.get("seed", 0), i, NOISE) for i in held[first]]
            noises.append(Operator(len(seeds)))
            noises[-1].set_noise(own["share"], own["cutoff"], own["lag"], seeds)
    return Drive(tuple(parts), tuple(sines), complete, tuple(tremors), tuple(noises))


def _is_simulated(table: Mapping[str, Any], finger: Mapping[str, Any]) -> bool:
    """Return whether the hand of a finger is simulated: the finger has a hand, or its device is "simulated"."""
    device = finger.get("device")
    if isinstance(device, str):
        device = next((each for each in table.get("device") or [] if each.get("name") == device), None)
    return finger.get("hand") is not None or (isinstance(device, Mapping) and device.get("name") == "simulated")


def _parts(
    hand: Mapping[str, Any], folder: str, start: FloatArray, centre: FloatArray
) -> Iterator[tuple[motions.Motion, float]]:
    d = len(centre)
    for each in _listed(hand.get("motion")):
        if each["kind"] == "sine":
            a, f = each["amplitude"], each["frequency"]
            yield motions.Sine(a, f, [1.0], each.get("begin", 0.0), each.get("ramp", 0.0)), 1.0
        elif each["kind"] == "reach":
            yield motions.Reach(each["displacement"], each.get("begin", 0.0), each["duration"]), 1.0
        elif each["kind"] == "path" and each.get("file") is not None:
            yield motions.Path.read(FilePath(folder) / FilePath(each["file"]).expanduser()), 1.0
        elif each["kind"] == "path":
            yield motions.Path(each["times"], each["positions"]), 1.0
    for each in _listed(hand.get("turn")):
        about = np.zeros(d) + (each["centre"] if each.get("centre") is not None else centre)
        arm = float(np.linalg.norm(start - about, axis=1).max())
        begin = each.get("begin", 0.0)
        if each["kind"] == "reach":
            yield motions.Reach([each["angle"]], begin, each["duration"]), arm
        else:
            yield motions.Sine(each["amplitude"], each["frequency"], [1.0], begin, each.get("ramp", 0.0)), arm
    squeeze = hand.get("squeeze", 0.0)
    if isinstance(squeeze, int | float):
        steps = [[float(squeeze), 0.0, hand.get("squeeze_ramp", 0.5)]]
    else:
        steps = [[step["to"], step["begin"], step["duration"]] for step in _listed(squeeze)]
    yield motions.Levels(steps), 1.0


def _listed(value: Any) -> list[Mapping[str, Any]]:
    """Convert one table, a list of tables or None to a list of tables."""
    if value is None:
        return []
    return [value] if isinstance(value, Mapping) else list(value)
