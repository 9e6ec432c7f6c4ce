"""Velocity estimates from sampled positions, by a difference quotient over an adaptive number of samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.kernel import kernel, source_function
from graspfx.compile.records import Floats, Many, Record, floats, size_for, start_of
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

WINDOW = 16
"""Default of the longest window of a velocity estimate [samples]."""

SLACK = 1e-6  # relative tolerance of the noise bound, because positions in whole counts reach the bound exactly


class VelocityEstimate(Record):
    """State of the velocity estimate of one component: parameters, and a ring buffer of the last positions."""

    period: float  # sampling period T [s]
    noise: float  # largest error of the sensor [m or rad]
    length: int  # longest window [samples]
    filled: int  # number of positions in the ring buffer
    head: int  # index of the newest position
    used: int  # window of the last estimate [samples], 0 for none
    positions: Floats = floats("length + 1")


def estimate_size(window: int) -> int:
    """Return the number of array entries for the state of one component with a longest window of `window` samples."""
    return size_for(VelocityEstimate, length=window)


@kernel
def estimate(state: VelocityEstimate, x: float) -> float:
    """Accept the next position x of a component, and return the component's velocity.

    v_k = (x_k - x_(k-n)) / (n T), where T is the sampling period and n is the longest window for which every line from
    x_k to x_(k-j), j = 2, ..., n, passes within the noise bound h of all positions between (see `VelocityEstimator`).
    This holds for a line of slope s (per sample) if, for each i < j, s is in the interval
    [(x_k - x_(k-i) - h) / i, (x_k - x_(k-i) + h) / i]. One pass over the positions therefore suffices.
    """
    length = state.length
    positions = state.positions
    if length == 1:  # the backward difference needs no search in the ring buffer
        before, first = positions[0], state.filled == 0
        positions[0] = x
        state.filled = 1
        if first:
            return 0.0
        state.used = 1
        return (x - before) / state.period
    head = state.head + 1
    if head > length:
        head = 0
    positions[head] = x
    state.head = head
    filled = state.filled
    if filled <= length:
        state.filled = filled + 1
    else:
        filled = length
    if filled == 0:
        state.used = 0
        return 0.0

    h = state.noise * (1.0 + SLACK)
    place = head
    low = high = slope = 0.0
    used = 0
    for i in range(1, filled + 1):
        place -= 1
        if place < 0:
            place = length
        step = x - positions[place]
        s = step / i
        if i > 1 and not (low <= s <= high):
            break
        slope = s
        used = i
        below, above = (step - h) / i, (step + h) / i
        if i == 1 or below > low:
            low = below
        if i == 1 or above < high:
            high = above
    state.used = used
    return slope / state.period


@kernel
def estimate_between(state: VelocityEstimate, times: Floats, x: float, time: float) -> float:
    """Accept the next position x of a component, sampled at `time` [s], and return the component's velocity.

    v_k = (x_k - x_(k-n)) / (t_k - t_(k-n)), where n is chosen as in `estimate`, with time intervals in place of numbers
    of samples: the slope s of a line to x_(k-j) must be, for each i < j, in the interval
    [(x_k - x_(k-i) - h) / (t_k - t_(k-i)), (x_k - x_(k-i) + h) / (t_k - t_(k-i))]. `times` is the ring buffer of the
    sampling times t, in the same order as the ring buffer of the positions.
    """
    length = state.length
    positions = state.positions
    head = state.head + 1
    if head > length:
        head = 0
    positions[head], times[head] = x, time
    state.head = head
    filled = state.filled
    if filled <= length:
        state.filled = filled + 1
    else:
        filled = length
    state.used = 0
    h = state.noise * (1.0 + SLACK)
    place = head
    low = high = slope = 0.0
    for i in range(1, filled + 1):
        place -= 1
        if place < 0:
            place = length
        step = x - positions[place]
        interval = time - times[place]
        s = step / interval
        if i > 1 and not (low <= s <= high):
            break
        slope = s
        state.used = i
        below, above = (step - h) / interval, (step + h) / interval
        if i == 1 or below > low:
            low = below
        if i == 1 or above < high:
            high = above
    return slope


@kernel
def estimate_after(state: VelocityEstimate, x: float, missed: int) -> float:
    """Accept the next position x of a component after `missed` lost samples, and return the component's velocity.

    The lost samples are linearly interpolated between the last position and x.
    """
    if missed > 0 and state.filled > 0:
        before = state.positions[0]
        if state.length > 1:
            before = state.positions[state.head]
        for k in range(1, missed + 1):
            estimate(state, before + (x - before) * (k / (missed + 1)))
    return estimate(state, x)


class VelocityEstimator:
    """Velocity estimator with first-order adaptive windowing (end-fit method), applied to each component separately.

        v_k = (x_k - x_(k-n)) / (n T)

    where T is the sampling period, and n <= window is the largest number of samples for which every line from the
    newest position to one of the n last positions passes within `noise` of all positions between the two (F.
    Janabi-Sharifi, V. Hayward and C.-S. J. Chen, Discrete-time adaptive windowing for velocity estimation, IEEE Trans.
    Control Systems Technology 8(6), 2000). The window n is short when the velocity changes, and long when the velocity
    is constant.

    If the sensor's error is at most h and the acceleration is at most A, then
    |v_k - v(t_k)| <= 2 h / (n T) + A n T / 2. The first term is noise. The second term is the delay of the difference
    quotient, n T / 2, times the acceleration. Windows longer than one sample reduce this bound if h / T > A T / 2, that
    is, for a short period or a coarse sensor. Otherwise a window of one sample has the smallest bound.

    For samples at irregular times, pass the times to `update`, which then uses the true intervals; a sample at an
    unchanged time leaves the velocity unchanged. If samples at regular times are lost, call `miss` once for each lost
    sample; the lost samples are then interpolated linearly.

    The first velocity is zero. After a non-finite position, the velocity is non-finite until two finite positions have
    been passed.

    Args:
        period: Sampling period T [s].
        shape: Shape of the position array.
        noise: Largest error h of the sensor, half its resolution [m or rad]. With 0 the velocity is the backward
            difference over one sample, whatever the window.
        window: Longest window [samples].
        memory: Array for the state, with `estimate_size(window)` entries per component; None to allocate an array.
    """

    def __init__(
        self,
        period: float,
        shape: tuple[int, ...],
        noise: float = 0.0,
        window: int = WINDOW,
        memory: FloatArray | None = None,
    ) -> None:
        if not (np.isfinite(period) and period > 0.0):
            raise InputError("period", period, "a finite time above zero [s]")
        if not (np.isfinite(noise) and noise >= 0.0):
            raise InputError("noise", noise, "a finite number, zero or above")
        if int(window) != window or window < 1:
            raise InputError("window", window, "a whole number of samples, 1 or more")
        self._length = int(window) if noise > 0.0 else 1
        self._velocity: FloatArray = np.zeros(shape)
        self._position: FloatArray = np.zeros(shape)
        self._count = self._velocity.size
        self._size = estimate_size(self._length)
        entries = self._count * self._size
        self._state: FloatArray = np.zeros(entries) if memory is None else memory[:entries]
        self._state[...] = 0.0
        states: Many[VelocityEstimate] = Many(VelocityEstimate, self._state, 0, self._count, self._size)
        states.array(VelocityEstimate.period)[:] = period
        states.array(VelocityEstimate.noise)[:] = noise
        states.array(VelocityEstimate.length)[:] = self._length
        self._times: FloatArray = np.zeros((self._count, self._length + 1))
        self._time = -np.inf  # last time that was passed with a sample [s]
        self._missed = np.zeros(1, dtype=np.int64)  # lost samples since the last position
        self._used = states.array(VelocityEstimate.used)
        self._memory = self._state.reshape(self._count, self._size)[:, start_of(VelocityEstimate, "filled") :]
        # reading floats from a memoryview takes half as long as from an array
        self._entries: Any = self._state.data
        self._x: Any = self._position.reshape(-1).data
        self._v: Any = self._velocity.reshape(-1).data

    @property
    def window(self) -> NDArray[np.intp]:
        """Window n of each component's last estimate [samples], in the position's shape; 0 without an estimate."""
        return self._used.astype(np.intp).reshape(self._velocity.shape)

    @property
    def memory(self) -> tuple[FloatArray, int, NDArray[np.int64]]:
        """State of all components, its number of entries per component, and the number of lost samples (1,)."""
        return self._state, self._size, self._missed

    def miss(self) -> None:
        """Record that the next sample was lost."""
        self._missed[0] += 1

    def reset(self, position: ArrayLike | None = None) -> None:
        """Discard all positions. If a position is given, it becomes the first position."""
        self._memory[...] = 0.0
        self._velocity[...] = 0.0
        self._time = -np.inf
        self._missed[0] = 0
        if position is not None:
            self.update(position)

    def update(self, position: ArrayLike, time: float | None = None) -> FloatArray:
        """Return the velocity after the next position, in an array that the next call overwrites.

        Args:
            position: Position, in the estimator's shape.
            time: Time of the sample [s]; if None, one period after the last sample. Either all calls or none must give
                a time.

        Raises:
            InputError: If the time is not finite, or is earlier than that of the last sample.
        """
        if time is not None:
            return self._update_at(position, time)
        self._position[...] = position
        S, x, v = self._entries, self._x, self._v
        missed = int(self._missed[0])
        if missed:
            self._missed[0] = 0
            after = source_function(estimate_after)
            for j in range(self._count):
                v[j] = after(S, j * self._size, x[j], missed)
            return self._velocity
        component = source_function(estimate)  # avoids a view for each component
        for j in range(self._count):
            v[j] = component(S, j * self._size, x[j])
        return self._velocity

    def _update_at(self, position: ArrayLike, time: float) -> FloatArray:
        if not self._time <= time < np.inf:
            raise InputError("time", time, f"a finite time, {self._time:.9g} s or later")
        if self._time == -np.inf:
            self._memory[...] = 0.0  # earlier positions without times cannot be used
        if time > self._time:
            self._time = time
            self._position[...] = position
            S, x, v = self._entries, self._x, self._v
            component = source_function(estimate_between)
            for j in range(self._count):
                v[j] = component(S, j * self._size, self._times[j].data, 0, x[j], time)
        return self._velocity
