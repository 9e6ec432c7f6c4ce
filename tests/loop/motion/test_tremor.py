"""A tremor: its amplitude, its band, its derivative, and random numbers that are the same ones for one seed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import welch

from graspfx.errors import InputError
from graspfx.loop.motion.motion import Rest, Sum
from graspfx.loop.motion.tremor import Tremor, random_sines

RATE = 200.0  # samples a second


def course(tremor: Any, seconds: float) -> Any:
    return np.array([tremor.at(k / RATE)[0] for k in range(int(seconds * RATE))])


def test_its_power_lies_in_the_band_and_is_what_was_asked_for() -> None:
    x = course(Tremor(3e-4, 10.0, 4.0, 2, (7,)), 60.0)
    assert x.std(axis=0) == pytest.approx([3e-4, 3e-4], rel=0.02)
    f, power = welch(x, RATE, nperseg=2048, axis=0)
    inside = (f > 7.8) & (f < 12.2)
    assert (power[inside].sum(axis=0) > 0.99 * power.sum(axis=0)).all()
    parts = [power[(f >= low) & (f < low + 1.0)].sum(axis=0) for low in (8.0, 9.0, 10.0, 11.0)]
    assert np.min(parts) > 0.5 * np.mean(parts), "as much in every part of the band"
    assert abs(np.corrcoef(x.T)[0, 1]) < 0.1


def test_velocity_is_the_derivative_also_while_it_fades_in() -> None:
    tremor, h = Tremor(1e-3, 9.0, 2.0, 3, (1, 2), 0.1, 0.5), 1e-6
    assert not tremor.at(0.1)[0].any()
    for t in (0.15, 0.3, 0.59, 0.7, 3.0):
        slope = (tremor.at(t + h)[0] - tremor.at(t - h)[0]) / (2.0 * h)
        assert tremor.at(t)[1] == pytest.approx(slope, abs=1e-9)


def test_a_seed_is_a_course_and_a_band_without_width_one_sine() -> None:
    one, same, other = (course(Tremor(1e-3, 10.0, 4.0, 1, seed), 1.0) for seed in ((1, 0), (1, 0), (1, 1)))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)
    sine = course(Tremor(1e-3, 10.0, 0.0, 1), 1.0)
    assert sine[20:] == pytest.approx(sine[:-20], abs=1e-15)
    assert np.abs(sine).max() == pytest.approx(np.sqrt(2.0) * 1e-3, rel=0.02)
    assert Sum([Rest(), Tremor(1e-3, 10.0, 4.0, 2)]).dimensions == 2


def test_frequencies_fill_the_band() -> None:
    f, phase = random_sines([5], 8.0, 12.0, 16)
    assert (np.floor((f - 8.0) * 4.0) == np.arange(16)).all()
    assert ((phase >= 0.0) & (phase < 2.0 * np.pi)).all()


@pytest.mark.parametrize("wrong", [(-1.0, 10.0, 4.0, 1), (1.0, 0.0, 0.0, 1), (1.0, 10.0, 20.0, 1), (1.0, 10.0, 4.0, 4)])
def test_what_is_no_tremor_is_refused(wrong: Any) -> None:
    with pytest.raises(InputError):
        Tremor(*wrong)
