"""Limits of many points at once are those of each, and cost one block of memory."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.sampled_plant import BLOCK
from graspfx.errors import InputError

T, SPRING = 0.005, 33.0


@pytest.mark.parametrize("integrator", gx.stability.INTEGRATORS)
@pytest.mark.parametrize(("delay", "damping"), [(0, 0.0), (1, 0.0), (0, 0.1)])
def test_external_map(integrator: str, delay: int, damping: float) -> None:
    rng = np.random.default_rng(5)
    mass, friction = rng.uniform(0.02, 0.5, (4, 1)), rng.uniform(0.05, 1.0, (4, 1))
    b_v: Any = rng.uniform(0.1, 2.0, 5)
    spring: Any = np.array([0.0, 33.0, 33.0, 100.0, 0.0])
    options: dict[str, Any] = {"integrator": integrator, "delay": delay}
    found = gx.stability.external_limit_map(
        mass, friction, T, 0.1, b_v, spring=spring, coupling_damping=damping, **options
    )
    assert found.shape == (4, 5)
    for i, j in np.ndindex(4, 5):
        alone = gx.stability.external_limit(
            mass[i, 0], friction[i, 0], T, 0.1, b_v[j], spring=spring[j], coupling_damping=damping, **options
        )
        assert found[i, j] == pytest.approx(alone, rel=1e-12)
    k = rng.uniform(1.0, 300.0, (4, 5))
    stable = gx.stability.external_stable_map(
        k, mass, friction, T, 0.1, b_v, spring=spring, coupling_damping=damping, **options
    )
    for i, j in np.ndindex(4, 5):
        limits = gx.stability.external_limits(
            mass[i, 0], friction[i, 0], T, 0.1, b_v[j], spring=spring[j], coupling_damping=damping, **options
        )
        assert stable[i, j] == limits.is_stable(float(k[i, j]))


def test_gains_of_one_plant_are_judged_one_by_one() -> None:
    """Five gains for plain numbers were taken for the five coefficients of one polynomial, and none was stable."""
    plant: dict[str, Any] = {"mass": 0.1, "damping": 0.5, "period": 0.001, "object_mass": 0.1, "object_damping": 0.8}
    limit = gx.stability.external_limit(**plant)
    for n in (1, 3, 4, 5, 6):
        gains = np.linspace(0.51, 1.5, n) * limit
        found = gx.stability.external_stable_map(gains, **plant)
        assert found.tolist() == (gains < limit).tolist()
    grid = gx.stability.external_stable_map(np.array([[0.9], [1.1]]) * limit, **plant)
    assert grid.tolist() == [[True], [False]]


def test_wall_map() -> None:
    b = np.geomspace(1e-3, 10.0, 30)
    for delay in (0, 2):
        found = gx.stability.wall_limit_map(0.1, b[:, None], T, spring=[0.0, SPRING], delay=delay)
        for i, j in np.ndindex(30, 2):
            alone = gx.stability.wall_limit(0.1, float(b[i]), T, spring=(0.0, SPRING)[j], delay=delay)
            assert found[i, j] == pytest.approx(alone, rel=1e-12)


def test_single_numbers_make_a_map_of_one() -> None:
    assert gx.stability.wall_limit_map(0.1, 0.2, T).shape == ()
    assert float(gx.stability.external_limit_map(0.1, 0.2, T, 0.1, 0.8)) == gx.stability.external_limit(
        0.1, 0.2, T, 0.1, 0.8
    )


def test_blocks_hold_little_of_ten_million_points() -> None:
    """The first blocks of a 10000 x 1000 map: less memory than one array of its points (80 MB) by far."""
    blocks = gx.stability.external_limit_blocks(
        np.linspace(0.05, 0.2, 10000)[:, None], 0.2, T, 0.1, np.linspace(0.8, 1.5, 1000), spring=SPRING
    )
    tracemalloc.start()
    first = [next(blocks) for _ in range(3)]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert [start for start, _ in first] == [0, BLOCK, 2 * BLOCK]
    assert peak < 20e6
    i, j = divmod(BLOCK + 17, 1000)
    expected = gx.stability.external_limit(
        np.linspace(0.05, 0.2, 10000)[i], 0.2, T, 0.1, np.linspace(0.8, 1.5, 1000)[j], spring=SPRING
    )
    assert first[1][1][17] == pytest.approx(expected, rel=1e-12)


def test_arguments_that_cannot_be() -> None:
    with pytest.raises(InputError, match=r"^mass: given"):
        gx.stability.wall_limit_map([0.1, 0.0], 0.2, T)
    with pytest.raises(InputError, match=r"^fingers: given"):
        gx.stability.external_limit_map(0.1, 0.2, T, 0.1, 0.8, fingers=[2, 0.5])


def test_maps_over_the_damping_of_the_coupling_alone() -> None:
    """One array among numbers, as a plot of stiffness over damping (Z-width) needs it."""
    dampings, wall, free = np.linspace(0.0, 0.5, 6), gx.stability.wall_limit, gx.stability.external_limits
    walls = gx.stability.wall_limit_map(0.15, 0.2, 0.005, wall_damping=dampings)
    assert walls == pytest.approx([wall(0.15, 0.2, 0.005, wall_damping=B) for B in dampings], rel=1e-12)
    moved = gx.stability.external_limit_map(0.15, 0.2, 0.005, 0.1, 0.8, coupling_damping=dampings)
    assert moved == pytest.approx(
        [free(0.15, 0.2, 0.005, 0.1, 0.8, coupling_damping=B).limit for B in dampings],
        rel=1e-12,
    )


@pytest.mark.parametrize("integrator", [name for name in gx.stability.INTEGRATORS if name != "implicit"])
def test_roots_stand_on_the_circle_at_the_limit(integrator: str) -> None:
    """Against eigenvalues of the sampled matrices of device and object; the implicit integrator has no limit here."""
    mass, viscosity = np.array([0.1, 0.15, 0.3])[:, None], np.array([0.3, 0.4])
    limits = gx.stability.external_limit_map(
        mass, 0.2, T, 0.05, viscosity, fingers=1, spring=SPRING, integrator=integrator
    )
    for i, j in np.ndindex(limits.shape):
        linear = gx.stability.Linearisation(
            period=T, mass=mass[i, 0], friction=0.2, hand_stiffness=SPRING, G=np.ones((1, 1)), inertia=0.05 * np.eye(1),
            viscosity=viscosity[j] * np.eye(1), stiffness=limits[i, j] * np.eye(1), integrator=integrator,
        )  # fmt: skip
        assert gx.stability.spectral_radius(linear) == pytest.approx(1.0, abs=1e-9)
