"""Devices whose forces begin, and whose positions are read, at any time within a sample: exact steps in two parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.fractional_delay import samples_and_part
from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.held_devices import held_devices

FloatArray = NDArray[np.float64]


class LateDevices:
    """Devices i that feel a force (n_i + phi_i) T after its tick, and are read (a_i + psi_i) T before it.

        s_(k+1) = E(T) s_k + Gamma(T - phi T) F_(k-n) + [Gamma(T) - Gamma(T - phi T)] F_(k-n-1)
        x(t_(k+1) - psi T): the same up to (1 - psi) T

    with E(t) and Gamma(t) exact for devices and hands under a force held for t: the hold is in them already, and is no
    part of the delay.

    Args:
        linear: with a lateness or an age.

    Attributes:
        forces: samples of forces that are remembered.
        readings: rows of readings in the state; none without an age.
    """

    def __init__(self, linear: Linearisation) -> None:
        T = linear.period
        self._linear, self._steps = linear, dict[float, tuple[FloatArray, FloatArray]]()
        forces = [samples_and_part(late, T) for late in linear.lateness.tolist()]
        self._whole = [n + int(d) for (n, _), d in zip(forces, linear.delay, strict=True)]
        self._phi = np.array([part for _, part in forces])
        ages = [samples_and_part(age, T) for age in linear.age.tolist()]
        self._back = [a for a, _ in ages]
        self._psi = np.array([part for _, part in ages])
        self.forces = max(n + (part > 0.0) for n, part in zip(self._whole, self._phi.tolist(), strict=True))
        self.readings = late_readings(linear)

    def pick(self, at: Mapping[str, FloatArray], fresh: str, name: str) -> FloatArray:
        """Give the rows that the coupling takes: each device's by its age."""
        if not self.readings:
            return at[fresh]
        return np.stack([at[f"{name}{a}"][i] for i, a in enumerate(self._back)])

    def advanced(
        self,
        drift: FloatArray,
        hold: FloatArray,
        motion: FloatArray,
        late: Sequence[FloatArray],
        at: Mapping[str, FloatArray],
    ) -> tuple[FloatArray, list[FloatArray]]:
        """Give the rows of (x, x') after a sample, and of the readings then.

        Args:
            drift, hold: E(T) and Gamma(T).
            motion: rows of (x, x') now.
            late: rows of the forces to display, the newest first.
            at: rows of the state.
        """
        new = np.stack([late[n][i] for i, n in enumerate(self._whole)])
        old = np.stack(
            [late[n + (part > 0.0)][i] for i, (n, part) in enumerate(zip(self._whole, self._phi.tolist(), strict=True))]
        )
        fresh = self._fresh(1.0, hold)
        state = drift @ motion - fresh @ new - (hold - fresh) @ old
        if not self.readings:
            return state, []
        m = len(self._phi)
        newest = state.copy()
        for part in np.unique(self._psi[self._psi > 0.0]).tolist():
            E, Gamma = self._step(1.0 - part)
            fresh = self._fresh(1.0 - part, Gamma)
            between = E @ motion - fresh @ new - (Gamma - fresh) @ old
            rows = np.flatnonzero(np.tile(self._psi == part, 2))
            newest[rows] = between[rows]
        rows_ = [newest[:m], *(at[f"y{i}"] for i in range(self.readings - 1))]
        if self._linear.rate == "state":
            rows_ += [newest[m:], *(at[f"dy{i}"] for i in range(self.readings - 1))]
        return state, rows_

    def begun(self, late: Sequence[FloatArray]) -> FloatArray:
        """Give the rows of the forces that begin in a sample."""
        return np.stack([late[n][i] for i, n in enumerate(self._whole)])

    @property
    def age_forced(self) -> FloatArray:
        """How a force on each device that is held over the whole sample enters the newest readings, (2 m, m)."""
        entry = self._step(1.0)[1].copy()
        for part in np.unique(self._psi[self._psi > 0.0]).tolist():
            rows = np.flatnonzero(np.tile(self._psi == part, 2))
            entry[rows] = self._step(1.0 - part)[1][rows]
        return entry

    def _fresh(self, until: float, hold: FloatArray) -> FloatArray:
        """Give Gamma of each device's new force, which begins at phi, up to a part of the sample."""
        entry = hold.copy()
        for part in np.unique(self._phi[self._phi > 0.0]).tolist():
            columns = np.flatnonzero(self._phi == part)
            entry[:, columns] = self._step(until - part)[1][:, columns] if until > part else 0.0
        return entry

    def _step(self, part: float) -> tuple[FloatArray, FloatArray]:
        """Give E and Gamma over a part of the sample."""
        if part not in self._steps:
            self._steps[part] = held_devices(self._linear, part * self._linear.period)
        return self._steps[part]


def late_readings(linear: Linearisation) -> int:
    """Count the rows of readings that a loop's state holds: none where positions have no age."""
    if not linear.age.any():
        return 0
    return 1 + max(samples_and_part(age, linear.period)[0] for age in linear.age.tolist())
