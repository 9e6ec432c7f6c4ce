"""The critically damped follower against its closed form."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.errors import InputError
from graspfx.protocols import Follower


def test_a_step_is_the_closed_form_however_it_is_cut() -> None:
    """To r = u + (r0 - u)(1 + w t) e^-wt from rest, in one step, in many, and in uneven ones."""
    lag, u, r0 = 0.02, np.array([[0.1, -0.2]]), np.array([[0.03, 0.05]])
    cuts = np.random.default_rng(0).uniform(size=37)
    for steps in (np.ones(1), np.ones(500) / 500, cuts / cuts.sum()):
        follower, t = Follower(lag, r0), 0.0
        for h in 0.13 * steps:
            follower.follow(u, h)
            t += h
            x = t / lag
            assert follower.position == pytest.approx(u + (r0 - u) * (1.0 + x) * np.exp(-x), abs=1e-14)
            assert follower.velocity == pytest.approx(-(r0 - u) * x * np.exp(-x) / lag, abs=1e-12)


def test_it_solves_its_equation_from_any_state() -> None:
    rng, lag, h = np.random.default_rng(1), 0.05, 1e-4
    for _ in range(20):
        p, v, u = rng.normal(size=(3, 2))
        follower = Follower(lag, p)
        follower.velocity[:] = v
        follower.follow(u, h)
        acceleration = (u - p) / lag**2 - 2.0 / lag * v
        assert (follower.velocity - v) / h == pytest.approx(acceleration, rel=2e-2, abs=0.5)
        assert (follower.position - p) / h == pytest.approx(v + 0.5 * h * acceleration, rel=1e-3, abs=1e-3)


def test_it_neither_overshoots_nor_jumps() -> None:
    """Events of 125 Hz and a loop of 4 kHz: the velocity has no step above the follower's own acceleration."""
    follower, lag, h, u = Follower(0.01, [0.0]), 0.01, 1.0 / 4000.0, 0.0
    places, speeds = [], []
    for k in range(4000):
        if k % 32 == 0:
            u = min(0.1, u + 0.005)
        follower.follow([u], h)
        places.append(follower.position[0])
        speeds.append(follower.velocity[0])
    assert max(places) <= 0.1 + 1e-15
    assert places[-1] == pytest.approx(0.1, abs=1e-6)
    assert np.abs(np.diff(speeds)).max() <= 1.01 * h * (0.02 / lag**2 + 2.0 * max(speeds) / lag)


def test_it_is_two_lags_behind_a_steady_motion() -> None:
    follower, h = Follower(0.02, [0.0]), 1e-5
    for k in range(40000):
        follower.follow([0.3 * h * k], h)
    assert 0.3 * h * 39999 - follower.position[0] == pytest.approx(0.3 * (0.04 - h), rel=1e-3)
    assert follower.velocity[0] == pytest.approx(0.3, rel=1e-6)


def test_no_time_is_no_motion_and_very_long_ones_arrive() -> None:
    follower = Follower(0.01, [1.0])
    follower.follow([0.0], 0.0)
    assert (follower.position[0], follower.velocity[0]) == (1.0, 0.0)
    follower.follow([0.5], 1e6)
    assert (follower.position[0], follower.velocity[0]) == (0.5, 0.0)
    follower.place([2.0])
    assert (follower.position[0], follower.velocity[0]) == (2.0, 0.0)
    with pytest.raises(InputError, match="a finite time above zero"):
        Follower(0.0, [0.0])
