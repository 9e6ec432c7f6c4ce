"""Tremor of a hand: sines in a narrow frequency band with random phases that are determined by a seed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import size_for
from graspfx.errors import InputError
from graspfx.loop.motion.motion import Part, _Parts
from graspfx.loop.motion.state import TREMOR, TremorPart
from graspfx.loop.motion.targets import step

FloatArray = NDArray[np.float64]

SINES = 16  # number of sines of a tremor on one axis


class Tremor(_Parts):
    """Tremor x_a(t) = A s((t - begin)/ramp) sqrt(2/N) sum_k sin(2 pi f_ak t + phi_ak) on axis a; zero before `begin`.

    s is the minimum-jerk step. The N = 16 frequencies f_ak are drawn at random, one from each of N equal parts of a
    frequency band, and the phases phi_ak are drawn from a uniform distribution. By the central limit theorem, x_a is
    nearly Gaussian. The spectrum is flat over the band, and the root mean square over a long time is A (M. Shinozuka,
    Simulation of multivariate and multidimensional random processes, J. Acoustical Society of America 49, 1971). x_a
    does not depend on the sampling period.

    Args:
        amplitude: Root mean square A on each axis [m].
        frequency: Centre of the frequency band [Hz].
        width: Width of the frequency band [Hz]; zero for a single sine.
        dimensions: Number of dimensions d.
        seed: Seed of the random numbers, a sequence of integers of zero or more.
        begin: Start time [s].
        ramp: Time during which the amplitude increases to A [s].
    """

    def __init__(
        self,
        amplitude: float,
        frequency: float,
        width: float,
        dimensions: int,
        seed: Sequence[int] = (0,),
        begin: float = 0.0,
        ramp: float = 0.0,
    ) -> None:
        values = (amplitude, frequency, width, begin, ramp)
        if not all(map(math.isfinite, values)) or min(amplitude, width, ramp) < 0.0 or frequency <= 0.0:
            raise InputError(
                "tremor",
                values,
                "finite amplitude, frequency, width, begin and ramp; a frequency above zero, and amplitude, width and "
                "ramp of zero or more",
            )
        if width >= 2.0 * frequency:
            raise InputError("width", width, f"less than twice the frequency, {2.0 * frequency:g} Hz")
        if not 1 <= dimensions <= 3:
            raise InputError("dimensions", dimensions, "1, 2 or 3")
        count = SINES if width > 0.0 else 1
        part = TremorPart(np.zeros(size_for(TremorPart, count=count, dimensions=dimensions)))
        part.kind, part.entries, part.count, part.dimensions = TREMOR, len(part.buffer), count, dimensions
        part.amplitude, part.begin, part.ramp = amplitude * math.sqrt(2.0 / count), begin, ramp
        low, high = frequency - 0.5 * width, frequency + 0.5 * width
        for a in range(dimensions):
            f, phi = random_sines([*seed, a], low, high, count)
            part.array(TremorPart.frequency).reshape(dimensions, count)[a] = 2.0 * math.pi * f
            part.array(TremorPart.phase).reshape(dimensions, count)[a] = phi
        super().__init__(dimensions, [Part(part.buffer)])

    def over(self, times: FloatArray) -> FloatArray:
        """Compute the offsets (M, d) [m] at times (M,) [s]; except for rounding, they equal the offsets of `at`."""
        part = TremorPart(self.parts[0].entries)
        frequency = part.array(TremorPart.frequency).reshape(part.dimensions, part.count)
        phase = part.array(TremorPart.phase).reshape(part.dimensions, part.count)
        fade = np.array([step(t - part.begin, part.ramp)[0] if t >= part.begin else 0.0 for t in times.tolist()])
        waves = [np.sin(np.outer(times, w) + phi).sum(axis=1) for w, phi in zip(frequency, phase, strict=True)]
        return np.asarray(part.amplitude * fade[:, None] * np.stack(waves, axis=1))


def random_sines(seed: Sequence[int], low: float, high: float, count: int) -> tuple[FloatArray, FloatArray]:
    """Draw one frequency [Hz] from each of `count` equal parts of a band, and as many phases [rad], (count,) each.

    Args:
        seed: Seed of the random numbers, a sequence of integers of zero or more.
        low, high: Ends of the band [Hz].
        count: Number of sines.
    """
    random = np.random.Generator(np.random.PCG64(np.random.SeedSequence(list(seed))))
    places = (np.arange(count) + random.random(count)) / count
    return low + (high - low) * places, 2.0 * math.pi * random.random(count)
