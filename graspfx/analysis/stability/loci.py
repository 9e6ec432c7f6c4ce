"""Characteristic loci of the open loop, with Bode and Nyquist diagrams and stability margins."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.analysis.checked_arguments import numbers
from graspfx.analysis.linearisation import Subject
from graspfx.analysis.stability.loop import OpenLoop, open_loop
from graspfx.card import Card, Carded
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

COUNT = 2000  # number of frequencies
LOWEST = 1e-3  # lowest frequency, relative to the Nyquist frequency
SILENT = 1e-9  # relative to the largest magnitude: a smaller locus is zero
REFINED = 60  # number of bisections of a crossing
NEAR = 1e-2  # larger relative errors of a crossing show that crossings were confused
GROWING = 1e-9  # excess of |z| over 1 that is not rounding of a constant motion


@dataclass(frozen=True, eq=False, repr=False)
class Loci(Carded):
    """Characteristic loci of a loop: the eigenvalues of its return ratio as functions of frequency.

    Attributes:
        frequency: Frequencies up to half the sampling rate, (F,) [Hz].
        response: Eigenvalues of the return ratio L(e^(jwT)), with the angular frequency w and the sampling period T,
            (F, k). Each column is one locus, which is continuous in frequency; loci that are zero are left out.
        gain_margin: Smallest factor above 1 at which a locus passes through -1 if all forces of the coupling are
            multiplied by it; inf if no factor does so. Unless the object's integrator is "implicit", stiffnesses and
            dampings together have the same margin.
        gain_frequency: Frequency at which this locus passes through -1 [Hz]; nan if `gain_margin` is inf.
        phase_margin: Smallest angle between -1 and a point at which a locus crosses the unit circle [degrees]; inf if
            no locus crosses the unit circle.
        phase_frequency: Frequency of this crossing [Hz]; nan if `phase_margin` is inf.
    """

    frequency: FloatArray
    response: ComplexArray
    gain_margin: float
    gain_frequency: float
    phase_margin: float
    phase_frequency: float

    @property
    def magnitude(self) -> FloatArray:
        """Magnitude of each locus, (F, k)."""
        return np.abs(self.response)

    @property
    def phase(self) -> FloatArray:
        """Phase of each locus [degrees], (F, k), continuous in frequency from a first value in (-270, 90]."""
        phase = np.unwrap(np.angle(self.response), axis=0)
        return np.asarray(np.degrees(phase - 2 * math.pi * np.ceil((phase[:1] - 0.5 * math.pi) / (2 * math.pi))))

    def bode(self, *, width: str = "screen") -> Any:
        """Plot magnitude and phase over frequency. A notebook shows the figure; `.save(path)` writes it."""
        from graspfx.show.certificate_figures import bode

        return bode(self, width=width)

    def nyquist(self, *, width: str = "screen") -> Any:
        """Plot the loci about -1. A notebook shows the figure; `.save(path)` writes it."""
        from graspfx.show.certificate_figures import nyquist

        return nyquist(self, width=width)

    def _card(self) -> Card:
        rows = [
            ("frequency", f"{self.frequency[0]:.3g} to {self.frequency[-1]:.4g} Hz, {len(self.frequency)} of them"),
            ("loci", str(self.response.shape[1])),
            ("gain margin", _margin(self.gain_margin, "", self.gain_frequency)),
            ("phase margin", _margin(self.phase_margin, " degrees", self.phase_frequency)),
        ]
        return Card("Characteristic loci of a loop", rows, ".bode(), .nyquist(), .magnitude, .phase [degrees]")


@one_blas_thread()
def loci(subject: Subject, frequency: ArrayLike | None = None) -> Loci:
    """Compute the characteristic loci of a loop opened at the coupling's forces.

    The return ratio is L(z) = -C (z I - A)^-1 B, with the matrices of `open_loop`. The closed loop is stable if the
    number of times that the loci encircle -1 counterclockwise is the number of eigenvalues of A outside the unit circle
    (MacFarlane and Postlethwaite 1977).

    Args:
        subject: `Linearisation`, scene, or name or path of a scene.
        frequency: Frequencies in ascending order, above zero and up to half the sampling rate [Hz]. If None, 2000
            frequencies over three decades up to half the sampling rate.

    Raises:
        InputError: If there are fewer than two frequencies, or the frequencies are not in ascending order or not in
            this range. Other errors are those of `Scene.linearise`.
    """
    loop = open_loop(subject)
    half = 0.5 / loop.period
    values = np.geomspace(LOWEST * half, half, COUNT) if frequency is None else numbers("frequency", frequency, "Hz")
    if (
        values.ndim != 1
        or len(values) < 2
        or (np.diff(values) <= 0.0).any()
        or not values[0] > 0.0
        or values[-1] > half
    ):
        raise InputError("frequency", frequency, f"at least two increasing numbers above zero and up to {half:g} Hz")
    response = _joined(np.array([_eigenvalues(loop, f) for f in values]))
    size = np.abs(response).max(axis=0)
    response = response[:, size > SILENT * size.max(initial=0.0)]
    return Loci(values, response, *_gain_margin(loop, values, response), *_phase_margin(loop, values, response))


def _eigenvalues(loop: OpenLoop, frequency: float) -> ComplexArray:
    z = np.exp(2j * math.pi * frequency * loop.period)
    ratio = -loop.C @ np.linalg.solve(z * np.eye(len(loop.A)) - loop.A, loop.B.astype(complex))
    return np.asarray(np.linalg.eigvals(ratio))


def _joined(values: ComplexArray) -> ComplexArray:
    """Reorder the eigenvalues in each row (F, k) so that columns are continuous, by matching nearest pairs first."""
    joined = values.copy()
    for k in range(1, len(values)):
        before, after = joined[k - 1], values[k]
        distance = np.abs(before[:, None] - after)
        order = np.empty(len(after), dtype=int)
        for _ in range(len(after)):
            i, j = np.unravel_index(np.argmin(distance), distance.shape)
            order[i] = j
            distance[i], distance[:, j] = np.inf, np.inf
        joined[k] = after[order]
    return joined


def _gain_margin(loop: OpenLoop, frequency: FloatArray, response: ComplexArray) -> tuple[float, float]:
    """Compute the gain margin and its frequency, from the points where loci cross or end on the negative real axis.

    If two loci are close, a crossing may be attributed to the wrong one. The smallest margin is therefore recomputed as
    the factor of the forces at which an eigenvalue of the closed loop crosses the unit circle.
    """
    best = math.inf, math.nan
    for locus in range(response.shape[1]):
        column = response[:, locus]
        crossing = (np.signbit(column.imag[:-1]) != np.signbit(column.imag[1:])) & (column.real[:-1] < 0.0)
        for k in np.flatnonzero(crossing).tolist():
            f, value = _refined(loop, frequency[k : k + 2], column[k : k + 2], lambda z: z.imag)
            best = _lesser(best, -1.0 / value.real if value.real < 0.0 else math.inf, f)
        if abs(column[-1].imag) < 1e-9 * abs(column[-1]) and column[-1].real < 0.0:
            best = _lesser(best, -1.0 / float(column[-1].real), float(frequency[-1]))
    return best if math.isinf(best[0]) else _edge(loop, *best)


def _edge(loop: OpenLoop, factor: float, frequency: float) -> tuple[float, float]:
    """Bisect, near an estimate, for the factor of the forces at which the number of unstable eigenvalues changes."""

    def growing(each: float) -> int:
        return int((np.abs(np.linalg.eigvals(loop.A + each * loop.B @ loop.C)) > 1.0 + GROWING).sum())

    low, high = max(1.0, (1.0 - NEAR) * factor), (1.0 + NEAR) * factor
    before = growing(low)
    if growing(high) == before:
        return factor, frequency
    for _ in range(REFINED):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if growing(middle) == before else (low, middle)
    values = np.linalg.eigvals(loop.A + high * loop.B @ loop.C)
    around = np.exp(2j * math.pi * frequency * loop.period)
    there = values[np.argmin(np.abs(values - around))]
    return high, abs(float(np.angle(there))) / (2.0 * math.pi * loop.period)


def _lesser(best: tuple[float, float], margin: float, frequency: float) -> tuple[float, float]:
    return (margin, frequency) if 1.0 < margin < best[0] else best


def _phase_margin(loop: OpenLoop, frequency: FloatArray, response: ComplexArray) -> tuple[float, float]:
    """Compute the phase margin [degrees] and its frequency [Hz] (`Loci`)."""
    best = math.inf, math.nan
    for locus in range(response.shape[1]):
        column = response[:, locus]
        inside = np.abs(column) < 1.0
        for k in np.flatnonzero(inside[:-1] != inside[1:]).tolist():
            f, value = _refined(loop, frequency[k : k + 2], column[k : k + 2], lambda z: abs(z) - 1.0)
            angle = abs(math.degrees(math.remainder(np.angle(value) - math.pi, 2 * math.pi)))
            best = (angle, f) if angle < best[0] else best
    return best


def _refined(loop: OpenLoop, ends: FloatArray, values: ComplexArray, of: Any) -> tuple[float, complex]:
    """Bisect the interval of frequencies `ends` for a sign change of the function `of` on a locus.

    The locus is the eigenvalue nearest to the values at both ends of the interval.
    """
    (low, high), (at_low, at_high) = map(float, ends), map(complex, values)
    for _ in range(REFINED):
        middle = 0.5 * (low + high)
        each = _eigenvalues(loop, middle)
        value = complex(each[np.argmin(np.abs(each - at_low) + np.abs(each - at_high))])
        if (of(value) < 0.0) == (of(at_low) < 0.0):
            low, at_low = middle, value
        else:
            high, at_high = middle, value
    return 0.5 * (low + high), 0.5 * (at_low + at_high)


def _margin(value: float, unit: str, frequency: float) -> str:
    return "none" if math.isinf(value) else f"{value:.4g}{unit} at {frequency:.4g} Hz"
