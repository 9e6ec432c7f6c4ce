"""The motion that draws most energy from a display in N samples: passivity by its definition, as an eigenproblem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.arguments import count
from graspfx.analysis.passivity.display import StateSpace, display, symmetric
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

LONGEST = 5000  # samples times channels: a matrix of 200 MB


@dataclass(frozen=True, eq=False)
class WorstMotion:
    """The motion from rest that leaves the least energy in device and display.

    Attributes:
        margin: T E / sum |D_k|^2, [N s/m]: the damping that the device could spare on it, negative if it lacks some.
        steps: D_k, (N, n), with sum |D_k|^2 = 1 m^2.
        energy: E [J], what they take in on these steps, at least; negative: what they give.
    """

    margin: float
    steps: FloatArray
    energy: float


def worst_motion(H: object, damping: ArrayLike, period: float, samples: int) -> WorstMotion:
    """Minimise E = sum_k D_k'B D_k/T + f_k'D_k over D, f_k = sum_{j <= k} h_{k-j} x_j, x_k = sum_{i < k} D_i.

    D_k = x_{k+1} - x_k; of all motions between two samples the even one loses least to friction, D'B D/T. The smallest
    eigenvalue of that form falls to the damping margin as N grows, about as 1/N^2, and never passes it: a negative one
    comes with the motion that proves it.

    Args:
        H: (A, B, C, D), an object with them, or a stiffness; not a function of z.
        damping: of the device, one number, (n,) or (n, n) [N s/m].
        period: T [s].
        samples: N; the work grows as (N n)^3, and N n is at most 5000.

    Raises:
        InputError: a function of z, no samples, or more than N n allows.
    """
    system = display(H, period)
    if not isinstance(system, StateSpace):
        raise InputError("H", H, "matrices (A, B, C, D)", "a function of z has no impulse response to start from")
    samples = count("samples", samples, 1)
    if samples * system.channels > LONGEST:
        most = f"at most {LONGEST // system.channels} samples"
        raise InputError("samples", samples, most, "the margin has converged long before: it falls as 1/N^2")
    n, B = system.channels, symmetric("damping", damping, system.channels)
    h = [system.D]  # impulse response
    x = system.B
    for _ in range(samples - 1):
        h.append(system.C @ x)
        x = system.A @ x
    step = np.cumsum(h, axis=0)  # force on a unit step, (N, n, n)
    E = np.zeros((samples, n, samples, n))
    for k in range(samples):
        E[k, :, k] = B / period
        E[k, :, :k] = step[:k][::-1].transpose(1, 0, 2)
    form = E.reshape(samples * n, samples * n)
    from scipy.linalg import eigh

    values, vectors = eigh((form + form.T) / 2, subset_by_index=[0, 0])
    least = float(values[0])
    return WorstMotion(period * least, vectors[:, 0].reshape(samples, n), least)
