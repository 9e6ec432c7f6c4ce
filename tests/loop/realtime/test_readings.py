"""Readings that are checked: a fault is a sentence, and nothing of the reading is taken over."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from graspfx.loop.realtime.readings import GUARDS, Guards, Readings
from tests.support.optional import require

T = 0.001


made_of: list[str] = []


@pytest.fixture(autouse=True, params=["source", "machine code"])
def rules(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let each test be one of the rules' source, and one of their machine code."""
    if request.param == "machine code":
        require("llvmlite")
    made_of.append(request.param)
    yield
    made_of.pop()


def make(guards: Guards | None = GUARDS) -> Readings:
    readings = Readings((2, 3), T, guards)
    if made_of[-1] == "machine code":
        readings.compile()
    return readings


def reading(x: float = 0.01, v: float = 0.0, time: float = 0.0) -> tuple[np.ndarray, np.ndarray, float]:
    return np.full((2, 3), x), np.full((2, 3), v), time


def test_a_sound_reading_is_copied() -> None:
    readings, first = make(), reading(0.01, 0.2, 1.0)
    assert readings.take(first) == ""
    first[0][...] = 7.0
    assert (readings.position == 0.01).all()
    assert (readings.velocity == 0.2).all()
    assert readings.is_fresh
    assert (readings.time, readings.samples) == (1.0, 1)


def test_nothing_of_a_faulty_reading_is_taken_over() -> None:
    readings = make()
    assert readings.take(reading(0.01, 0.2, 1.0)) == ""
    bad = reading(0.011, 0.1, 1.001)
    bad[1][1, 2] = np.nan
    assert readings.take(bad).startswith("returned [[0.1, 0.1, 0.1], [0.1, 0.1, nan]] for velocities, which are not")
    assert (readings.position == 0.01).all()
    assert (readings.velocity == 0.2).all()
    assert readings.time == 1.0


def test_samples_that_are_held() -> None:
    """Three readings in a row may bring nothing new, whatever they say; the fourth is a fault."""
    readings = make()
    readings.take(reading(0.01, 0.2, 1.0))
    for _ in range(3):
        assert readings.take(reading(0.5, 9.0, 1.0)) == ""
        assert not readings.is_fresh
        assert (readings.position == 0.01).all()
        assert (readings.velocity == 0.2).all()
    assert "no new sample in 4 successive readings: all have the time 1 s" in readings.take(reading(0.01, 0.0, 1.0))
    fresh = make()
    fresh.take(reading(0.01, 0.0, 1.0))
    for k in range(20):  # every fourth is new
        assert fresh.take(reading(0.01, 0.0, 1.0 + (k + 1) // 4)) == ""
    assert (fresh.samples, fresh.repeats) == (6, 15)


def test_a_step_may_be_as_long_as_the_time_since_the_last_sample() -> None:
    """10 m/s over 1 ms are 10 mm; over a held reading and two periods that were left out they are 40."""
    assert make().take(reading(0.01, 0.0, 1.0)) == ""
    for step, periods, sound in ((0.0099, 1, True), (0.0101, 1, False), (0.0299, 3, True), (0.0301, 3, False)):
        readings = make()
        readings.take(reading(0.0, 0.0, 1.0))
        text = readings.take(reading(step, 0.0, 1.001), periods)
        assert (text == "") is sound, text
        assert sound or f"expected at most {0.01 * periods:.4g} m" in text
    readings = make()
    readings.take(reading(0.0, 0.0, 1.0))
    assert readings.take(reading(0.0, 0.0, 1.0)) == ""
    assert readings.take(reading(0.0399, 0.0, 1.004), 3) == ""


@pytest.mark.parametrize("time", [0.5, 1.0 - 1e-12])
def test_a_clock_that_runs_back(time: float) -> None:
    readings = make()
    readings.take(reading(0.01, 0.0, 1.0))
    assert "its clock ran backwards" in readings.take(reading(0.01, 0.0, time))


def test_a_simulation_is_held_to_shape_type_and_finiteness_only() -> None:
    """Its clock is the count of ticks, and it may leap: what it computes is the scene's own affair."""
    readings = make(None)
    assert readings.take(reading(0.01, 0.0, 1.0)) == ""
    assert readings.take(reading(5.0, 900.0, 1.0)) == ""
    assert (readings.position == 5.0).all()
    assert "of float32" in readings.take((np.zeros((2, 3), np.float32), np.zeros((2, 3)), 1.0))
    assert "(3,) of float64" in readings.take((np.zeros(3), np.zeros((2, 3)), 1.0))
    assert "not finite" in readings.take((np.full((2, 3), np.inf), np.zeros((2, 3)), 1.0))


def test_zeros_for_everything_are_a_reading_that_failed() -> None:
    """Zero is a position like others: a finger may be there, or come there by less than a millimetre."""
    readings = make()
    assert readings.take(reading(0.0, 0.0, 0.0)) == ""
    assert readings.take(reading(0.0009, 0.0, 0.001)) == ""
    assert readings.take(reading(0.0, 0.0, 0.002)) == ""
    assert readings.take(reading(0.005, 0.0, 0.003)) == ""
    assert "a failed reading" in readings.take(reading(0.0, 0.0, 0.004))
