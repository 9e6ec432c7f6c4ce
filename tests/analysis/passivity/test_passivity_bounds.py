"""Walls through an encoder, against motions that draw the energy which the formulas speak of."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.analysis import passivity
from graspfx.errors import InputError

T, DELTA = 1e-3, 1e-4


def energy(x: np.ndarray, K: float, b: float, f_c: float, delay: int = 0) -> float:
    """Add up what device and wall take in on positions x (N,), also between samples, without the wall's store.

    The wall's force is K times the position rounded to steps, held over a sample, `delay` samples late.
    """
    seen = DELTA * np.floor(x / DELTA + 0.5)
    force = K * np.concatenate([np.zeros(delay), seen])[: len(x) - 1]
    D = np.diff(x)
    return float(force @ D + b / T * D @ D + f_c * np.abs(D).sum())


def across_an_edge(steps: int, cycles: int = 50) -> np.ndarray:
    """Back and forth, just over `steps` - 1 whole steps, so that each way crosses `steps` edges; out on high forces."""
    low = DELTA / 2 - 1e-9 * DELTA
    return np.tile([low, low + (steps - 1) * DELTA + 2e-9 * DELTA], cycles + 1)[: 2 * cycles + 1]


def test_the_limit_of_abbott_and_okamura():
    assert passivity.quantised_wall_limit(0.5, T, friction=0.04, resolution=DELTA) == pytest.approx(800.0)  # 2 f_c/D
    assert passivity.quantised_wall_limit(0.3, T, friction=0.04, resolution=DELTA) == pytest.approx(600.0)  # 2 b/T
    assert passivity.quantised_wall_limit(0.3, T, friction=0.0, resolution=0.0) == pytest.approx(600.0)


@pytest.mark.parametrize("steps", [1, 2, 6])
def test_the_motion_across_an_edge_draws_energy_above_the_limit_and_not_below(steps):
    b, f_c = 0.5, 0.04  # one step a sample is the friction's case, many the viscosity's
    K = passivity.quantised_wall_limit(b, T, friction=f_c, resolution=DELTA)
    x = across_an_edge(steps)
    assert energy(x, 0.999 * K, b, f_c) > 0.0
    if steps == 1:
        assert energy(x, 1.001 * K, b, f_c) < 0.0
    else:  # at this speed viscosity still pays for both
        assert energy(x, 1.001 * K, b, f_c) > 0.0


def test_no_random_motion_draws_energy_below_the_limit():
    rng = np.random.default_rng(5)
    b, f_c = 0.4, 0.04
    K = passivity.quantised_wall_limit(b, T, friction=f_c, resolution=DELTA)
    for scale in np.geomspace(0.05, 20, 60):
        x = np.concatenate([[0.0], rng.normal(scale=scale * DELTA, size=400).cumsum()])
        assert energy(x, K, b, f_c) + 0.125 * K * DELTA**2 >= 0.0  # what a start within half a step may have stored


@pytest.mark.parametrize("steps", [3, 8])
def test_coulomb_friction_pays_for_too_little_viscosity_up_to_a_speed(steps):
    """Across edges at (steps - 1) Delta/T: calm on one side of `calm_below`, not on the other."""
    v = (steps - 1) * DELTA / T
    K, b = 1000.0, 0.3  # 0.5 is needed
    for factor, sign in ((1.01, 1.0), (0.99, -1.0)):
        f_c = K * DELTA / 2 + factor * v * (K * T / 2 - b)
        found = passivity.quantised_wall(K, b, T, friction=f_c, resolution=DELTA)
        assert found.calm_below == pytest.approx(factor * v)
        assert not found.passive and found.calm_above == np.inf
        assert sign * energy(across_an_edge(steps), K, b, f_c) > 0.0


@pytest.mark.parametrize("steps", [3, 8])
def test_viscosity_pays_for_too_little_coulomb_friction_from_a_speed_on(steps):
    v = (steps - 1) * DELTA / T
    K, f_c = 1000.0, 0.03  # 0.05 is needed
    for factor, sign in ((0.99, 1.0), (1.01, -1.0)):
        b = K * T / 2 + (K * DELTA / 2 - f_c) / (factor * v)
        found = passivity.quantised_wall(K, b, T, friction=f_c, resolution=DELTA)
        assert found.calm_above == pytest.approx(factor * v)
        assert found.calm_below == 0.0
        assert sign * energy(across_an_edge(steps), K, b, f_c) > 0.0


def test_regimes_and_their_numbers():
    good = passivity.quantised_wall(1000.0, 0.6, T, friction=0.06, resolution=DELTA)
    assert good.passive and good.viscous == pytest.approx(0.6) and good.coulomb == pytest.approx(0.6)
    assert (good.calm_below, good.calm_above) == (np.inf, 0.0)
    neither = passivity.quantised_wall(1000.0, 0.4, T, friction=0.04, resolution=DELTA)
    assert (neither.passive, neither.calm_below, neither.calm_above) == (False, 0.0, np.inf)
    # one sample late: 3/2 K T
    assert not passivity.quantised_wall(1000.0, 1.49, T, friction=0.06, resolution=DELTA, delay=T).passive
    assert passivity.quantised_wall(1000.0, 1.51, T, friction=0.06, resolution=DELTA, delay=T).passive
    smooth = passivity.quantised_wall(1000.0, 0.6, T, friction=0.0, resolution=0.0)
    assert smooth.passive and smooth.coulomb == np.inf


def test_a_late_wall_is_calm_below_its_speed():
    rng = np.random.default_rng(2)
    K, b, f_c = 1000.0, 0.9, 0.2
    found = passivity.quantised_wall(K, b, T, friction=f_c, resolution=DELTA, delay=T)
    assert found.calm_below == pytest.approx((0.2 - 0.05) / (1.5 - 0.9))
    for _ in range(40):
        turns = rng.choice([-1.0, 1.0], size=300)
        x = np.concatenate([[0.0], (found.calm_below * T * turns).cumsum()])
        assert energy(x, K, b, f_c, delay=1) + 0.125 * K * DELTA**2 >= 0.0


@pytest.mark.parametrize("bad", [{"period": 0.0}, {"friction": -1.0}, {"resolution": np.inf}, {"damping": np.nan}])
def test_what_is_no_friction_is_refused(bad):
    good = {"damping": 0.5, "period": T, "friction": 0.1, "resolution": DELTA}
    for call in (passivity.quantised_wall_limit, lambda **given: passivity.quantised_wall(100.0, **given)):
        with pytest.raises(InputError) as caught:
            call(**(good | bad))
        assert caught.value.name in bad
    with pytest.raises(InputError):
        passivity.quantised_wall(0.0, **good)
    with pytest.raises(InputError):
        passivity.quantised_wall(1.0, **good, delay=-1.0)
