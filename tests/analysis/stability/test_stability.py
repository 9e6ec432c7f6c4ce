"""Limits of walls and objects: known numbers, closed forms, 40 digits, and the eigenvalues of loops written out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.stability import external_limits, wall_limits
from graspfx.errors import InputError, UnknownNameError
from tests.support.sampled_loops import exact_limit, external_loop, radius, wall_loop

T, SPRING, M_V = 0.005, 33.0, 0.1
FRICTION = {0.05: 0.19906, 0.10: 0.1995, 0.15: 0.1997, 0.20: 0.1998}  # so that the wall's limit is 80 N/m
KNOWN = {  # k_ep [N/m] at b_v = 0.8 and 1.5 N s/m, with the digits in which they are known
    "explicit": [(0.05, 38.8, 57.2), (0.10, 44.5, 81.1), (0.15, 51.8, 97.0), (0.20, 57.0, 107.1)],
    "exact": [(0.05, 55.6, 85.0), (0.10, 74.9, 136.2), (0.15, 91.8, 170.9), (0.20, 103.7, 194.2)],
}


@pytest.mark.parametrize("mass", FRICTION)
def test_the_papers_static_object_is_lost_at_80(mass: float) -> None:
    """kip_max = 80 N/m (the paper's Fig. 15) fixes b = 0.2 N s/m almost whatever the mass: b is given to 5 digits."""
    assert gx.stability.wall_limit(mass, FRICTION[mass], T, spring=SPRING) == pytest.approx(80.0, abs=0.02)


@pytest.mark.parametrize("integrator", KNOWN)
def test_kep_over_the_objects_viscosity(integrator: str) -> None:
    for mass, *known in KNOWN[integrator]:
        for b_v, number in zip((0.8, 1.5), known, strict=True):
            found = gx.stability.external_limit(mass, FRICTION[mass], T, M_V, b_v, spring=SPRING, integrator=integrator)
            assert found == pytest.approx(number, abs=0.0501), (mass, b_v)


def test_kep_with_semi_implicit_steps() -> None:
    """108 -> 180 and 235 -> 442 N/m, known to whole numbers (108.55 was cut, not rounded); above 80 for more mass."""
    for mass, low, high in ((0.05, 108.0, 180.0), (0.10, 235.0, 442.0)):
        for b_v, number in ((0.8, low), (1.5, high)):
            found = gx.stability.external_limit(
                mass, FRICTION[mass], T, M_V, b_v, spring=SPRING, integrator="semi-implicit"
            )
            assert found == pytest.approx(number, abs=0.6)
    for mass in (0.15, 0.20):
        for b_v in (0.8, 1.5):
            limits = external_limits(mass, FRICTION[mass], T, M_V, b_v, spring=SPRING, integrator="semi-implicit")
            assert limits.limit > 80.0


@pytest.mark.parametrize(("mass", "number"), [(0.05, 31.0), (0.10, 35.0), (0.20, 42.0)])
def test_the_cubes_rotation_is_the_weakest_mode(mass: float, number: float) -> None:
    """50 mm, 0.1 kg: M = I/(2 r^2) = 0.033 kg, rotational viscosity b_v a^2/6; none makes every gain unstable."""
    inertia, arm = M_V * 0.05**2 / 6, 0.025
    M, B = inertia / (2 * arm**2), 0.8 * 0.05**2 / 6 / (2 * arm**2)
    options: dict[str, Any] = {"fingers": 1, "spring": SPRING, "integrator": "explicit"}
    assert gx.stability.external_limit(mass, FRICTION[mass], T, M, B, **options) == pytest.approx(number, abs=0.5)
    assert gx.stability.external_limit(mass, FRICTION[mass], T, M, 0.0, **options) == 0.0


def test_pushing_can_be_lost_where_the_grasp_is_not() -> None:
    """One finger of two sees 2 kep kip/(kep + kip) = 52.3 N/m and the whole object, whose limit is 51.9 (eq. 26)."""
    options: dict[str, Any] = {"spring": SPRING, "integrator": "explicit"}
    kep = gx.stability.external_limit(0.05, FRICTION[0.05], T, M_V, 0.8, **options)
    alone = gx.stability.external_limit(0.05, FRICTION[0.05], T, M_V, 0.8, fingers=1, **options)
    assert 2 * kep * 80.0 / (kep + 80.0) == pytest.approx(52.3, abs=0.05)
    assert alone == pytest.approx(51.9, abs=0.05)


def test_stable_gains_are_several_intervals() -> None:
    """1 kg, b = 0.5993, one sample of delay, semi-implicit: [0, 1425] and [4569, 7840] N/m."""
    system = (1.0, 0.5993, T, M_V, 0.8)
    options: dict[str, Any] = {"spring": SPRING, "integrator": "semi-implicit", "delay": 1}
    found = gx.stability.stable_intervals(*system, **options)
    assert np.array(found) == pytest.approx(np.array([[0.0, 1425.0], [4569.5, 7840.2]]), abs=0.5)
    assert gx.stability.external_limit(*system, **options) == found[0][1]
    assert gx.stability.stable_intervals(*system, upper=5000.0, **options)[-1] == (found[1][0], 5000.0)
    assert len(gx.stability.stable_intervals(*system, upper=2000.0, **options)) == 1
    limits = external_limits(*system, **options)
    for low, high in found:
        for end, inward in ((low, 1.0), (high, -1.0)):
            if end > 0.0:
                for step, sign in ((1e-6, -1.0), (-1e-6, 1.0)):
                    k = end * (1.0 + inward * step)
                    exact = radius(external_loop(1.0, 0.5993, T, 0.05, 0.4, k, spring=SPRING,
                                                 integrator="semi-implicit", delay=1))  # fmt: skip
                    assert (exact - 1.0) * sign > 0.0
                    assert limits.spectral_radius(k) == pytest.approx(exact, abs=1e-10)


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("friction", [0.001, 0.03, 1.0])
def test_wall_to_forty_digits(friction: float, delay: int) -> None:
    """Roots of the characteristic polynomial in 40 digits, bisected: 1e-12."""
    expected = exact_limit(1.0, friction, 1.0, delay, 0.0)
    assert gx.stability.wall_limit(1.0, friction, 1.0, delay=delay) == pytest.approx(expected, rel=1e-12)


def test_little_friction_is_the_passive_wall() -> None:
    """K = 2 b/T without delay and b/(3 T/2) with one sample of it, as b T/m goes to zero (Colgate and Schenkel)."""
    for b in (1e-3, 1e-5):
        assert gx.stability.wall_limit(1.0, b, 1.0) == pytest.approx(2.0 * b, rel=b)
        assert gx.stability.wall_limit(1.0, b, 1.0, delay=1) == pytest.approx(b / 1.5, rel=b)


def test_little_wall_damping_adds_to_the_friction() -> None:
    """K = 2 (b + B)/T for small b and B, B on the backward difference, to first order in (b + B) T/m."""
    for b, B in ((1e-4, 2e-4), (3e-4, -1e-4)):
        assert gx.stability.wall_limit(1.0, b, 1.0, wall_damping=B) == pytest.approx(2.0 * (b + B), rel=3e-3)


@pytest.mark.parametrize("seed", range(30))
def test_ends_of_intervals_are_where_eigenvalues_cross(seed: int) -> None:
    """Random devices, springs, dampings, delays and integrators: stable just inside, not just outside, each end."""
    rng = np.random.default_rng(seed)
    m, b, spring = rng.uniform(0.02, 1.0), 10 ** rng.uniform(-2, 0.5), rng.choice([0.0, 33.0, 400.0])
    damping, delay = rng.choice([0.0, rng.uniform(0.0, 1.0)]), int(rng.integers(0, 4))
    kind = gx.stability.INTEGRATORS[seed % 5]
    object_delay = 0 if kind == "implicit" else int(rng.integers(0, 3))
    M, B = rng.uniform(0.01, 0.5), rng.uniform(0.05, 3.0)
    limits = external_limits(
        m, b, T, M, B, fingers=1, spring=spring, integrator=kind, delay=delay, object_delay=object_delay,
        coupling_damping=damping,
    )  # fmt: skip
    options: dict[str, Any] = {
        "spring": spring,
        "integrator": kind,
        "delay": delay,
        "object_delay": object_delay,
        "damping": damping,
    }

    def size(k: float) -> float:
        """The drift of device and object together, at z = 1 without a spring, is not counted."""
        values = np.linalg.eigvals(external_loop(m, b, T, M, B, k, **options))
        if spring == 0.0:
            values = np.delete(values, np.argmin(np.abs(values - 1.0)))
        return float(np.abs(values).max())

    for low, high in limits.intervals:
        inside = [0.5 * (low + high) if high < math.inf else 2.0 * low + 10.0]
        inside += [low * (1.0 + 1e-5)] if low else []
        inside += [high * (1.0 - 1e-5)] if high < math.inf else []
        outside = [low * (1.0 - 1e-5)] if low else []
        outside += [high * (1.0 + 1e-5)] if high < math.inf else []
        assert all(size(k) < 1.0 for k in inside)
        assert all(size(k) > 1.0 for k in outside)
        for k in inside:
            assert limits.spectral_radius(k) == pytest.approx(size(k), abs=1e-9)
    for k in np.geomspace(1e-1, 1e5, 25):  # nothing between the intervals is stable
        near = any(abs(k - end) < 1e-3 * k for interval in limits.intervals for end in interval)
        assert near or limits.is_stable(k) == (size(k) < 1.0)


@pytest.mark.parametrize("seed", range(10))
def test_walls_with_damping_and_delay(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    m, b, spring = rng.uniform(0.02, 1.0), 10 ** rng.uniform(-2, 0.5), rng.choice([0.0, 33.0])
    B, delay = rng.uniform(-0.5 * b, 1.0), int(rng.integers(0, 4))
    limits = wall_limits(m, b, T, spring=spring, wall_damping=B, delay=delay)
    for k in np.geomspace(1e-1, 1e5, 40):
        exact = radius(wall_loop(m, b, T, k, spring=spring, B=B, delay=delay))
        assert abs(exact - 1.0) < 1e-9 or limits.is_stable(k) == (exact < 1.0)
        assert limits.spectral_radius(k) == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("spring", [0.0, 33.0])
def test_lag_and_semi_implicit_is_explicit(spring: float) -> None:
    """A force on the object that is one sample old makes semi-implicit steps explicit ones: to 1e-12."""
    for delay in (0, 1, 2):
        explicit, lagging = (
            gx.stability.stable_intervals(
                0.15, 0.2, T, M_V, 1.1, spring=spring, delay=delay, integrator=kind, object_delay=lag
            )
            for kind, lag in (("explicit", 0), ("semi-implicit", 1))
        )
        assert np.array(lagging) == pytest.approx(np.array(explicit), rel=1e-12)


def test_pybullets_integrator_is_its_own() -> None:
    """Exact viscosity lowers the semi-implicit limit a little: 106.6 against 108.5 N/m."""
    found = {
        kind: gx.stability.external_limit(0.05, 0.19906, T, M_V, 0.8, spring=SPRING, integrator=kind)
        for kind in ("bullet", "semi-implicit")
    }
    assert found["semi-implicit"] - found["bullet"] == pytest.approx(2.0, abs=0.1)


def test_how_stability_is_lost() -> None:
    """A light friction is lost by an oscillation at sqrt(K/m), a heavy one by samples of alternating sign."""
    slow = wall_limits(1.0, 1e-4, 1.0).loss
    assert slow is not None and slow.how == "pair"
    assert slow.frequency == pytest.approx(math.sqrt(slow.gain) / (2 * math.pi), rel=1e-3)
    fast = wall_limits(1.0, 10.0, 1.0).loss
    assert fast is not None and fast.how == "-1"
    assert fast.frequency == 0.5


def test_margins() -> None:
    limits = external_limits(1.0, 0.5993, T, M_V, 0.8, spring=SPRING, integrator="semi-implicit", delay=1)
    assert limits.margin(500.0) == (0.0, limits.limit / 500.0)
    assert limits.margin(2000.0) == (1.0, 1.0)
    low, high = limits.intervals[1]
    assert limits.margin(6000.0) == (low / 6000.0, high / 6000.0)
    assert [loss.gain for loss in limits.losses] == [limits.limit, low, high]


def test_no_limit_is_infinite() -> None:
    """Under the implicit integrator a light object couples stably to a heavier device at every stiffness."""
    limits = external_limits(0.2, 0.2, T, M_V, 0.8, spring=SPRING, integrator="implicit")
    assert limits.limit == math.inf
    assert limits.loss is None and math.isnan(limits.frequency)
    assert radius(external_loop(0.2, 0.2, T, 0.05, 0.4, 1e7, spring=SPRING, integrator="implicit")) < 1.0
    assert limits.margin(100.0) == (0.0, math.inf)


def test_explicit_steps_that_diverge_by_themselves_have_no_stable_gain() -> None:
    """b T/m = 2.5 > 2."""
    assert gx.stability.external_limit(0.1, 0.2, T, 0.02, 10.0, fingers=1, spring=SPRING, integrator="explicit") == 0.0


@pytest.mark.parametrize(
    ("change", "name"),
    [({"mass": 0.0}, "mass"), ({"damping": -1.0}, "damping"), ({"period": math.nan}, "period"),
     ({"delay": 0.5}, "delay"), ({"delay": -1}, "delay"), ({"delay": 21}, "delay"), ({"fingers": 0}, "fingers"),
     ({"object_mass": [1.0, 2.0]}, "object_mass"), ({"spring": "stiff"}, "spring"), ({"upper": 0.0}, "upper"),
     ({"integrator": "implicit", "object_delay": 1}, "object_delay")],
)  # fmt: skip
def test_arguments_that_cannot_be(change: dict[str, Any], name: str) -> None:
    given = {"mass": 0.1, "damping": 0.2, "period": T, "object_mass": M_V, "object_damping": 0.8} | change
    with pytest.raises(InputError, match=f"^{name}: given"):
        gx.stability.stable_intervals(**given)


@pytest.mark.parametrize(("integrator", "lag"), [("explicit", 1.0), ("exact", 0.5)])
def test_first_order_formula(integrator: str, lag: float) -> None:
    """kep = (b M^2 + B m^2)/((m + M)(t_d M + t_o m)), to 2 % for loops slower than w T = 0.5 without a spring."""
    t_d, t_o = 0.5 * T, lag * T
    for m in (0.05, 0.15, 0.5):
        for b, B in ((0.05, 0.1), (0.2, 0.4), (0.1, 0.6)):
            M = 0.05
            limits = external_limits(m, b, T, M, B, fingers=1, integrator=integrator)
            assert 2 * math.pi * limits.frequency * T < 0.5
            formula = (b * M**2 + B * m**2) / ((m + M) * (t_d * M + t_o * m))
            assert limits.limit == pytest.approx(formula, rel=0.02)


@pytest.mark.parametrize("delay", [8, 20])
def test_many_samples_of_delay(delay: int) -> None:
    """The ends of all intervals to 1e-6, the spectral radius to 1e-7: what 24 coefficients keep of it."""
    limits = external_limits(1.0, 20.0, T, 0.5, 8.0, fingers=1, spring=SPRING, delay=delay)
    assert limits.intervals
    for low, high in limits.intervals:
        for end, inward in ((low, 1.0), (high, -1.0)):
            for step, sign in ((1e-6, -1.0), (-1e-6, 1.0)):
                k = end * (1.0 + inward * step)
                exact = radius(external_loop(1.0, 20.0, T, 0.5, 8.0, k, spring=SPRING, delay=delay))
                assert end == 0.0 or (exact - 1.0) * sign > 0.0
                assert limits.spectral_radius(k) == pytest.approx(exact, abs=1e-7)


def test_integrators_have_names() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'semi-implicit'"):
        gx.stability.external_limit(0.1, 0.2, T, M_V, 0.8, integrator="semi-implict")
