"""Compiled limits are those of the eigenvalues and of numpy, and ask for a compiler only where it pays."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.critical import LEAST
from graspfx.analysis.maps import map_compiled, map_kernel
from graspfx.compile.machine import compiled
from graspfx.errors import InputError, MissingPackageError, UnknownNameError

POINTS = 10_000
CASE: dict[str, Any] = {"mass": 0.1, "damping": 0.2, "period": 0.005, "object_mass": 0.1, "object_damping": 0.8}


def random_points(seed: int = 1) -> dict[str, Any]:
    """Devices and objects over decades, with some friction: without any, rounding decides whether zero is stable."""
    rng = np.random.default_rng(seed)
    spring = np.where(rng.random(POINTS) < 0.3, 0.0, 10 ** rng.uniform(0.0, 4.0, POINTS))
    return {
        "mass": 10 ** rng.uniform(-2.0, 0.0, POINTS),
        "damping": 10 ** rng.uniform(-3.0, 1.0, POINTS),
        "period": 10 ** rng.uniform(-3.5, -1.5, POINTS),
        "spring": spring,
        "object_mass": 10 ** rng.uniform(-2.0, 0.5, POINTS),
        "object_damping": 10 ** rng.uniform(-2.0, 1.5, POINTS),
    }


def assert_same(fast: np.ndarray, slow: np.ndarray, points: dict[str, np.ndarray]) -> None:
    """To 1e-9, or to 1e-13 m/T^2, below which gains count as zero: limits of 0.1 N/m stand beside m/T^2 of 1e6."""
    finite = np.isfinite(slow)
    assert (finite == np.isfinite(fast)).all()
    nothing = LEAST * points["mass"] / points["period"] ** 2
    apart = np.abs(fast[finite] - slow[finite])
    assert (apart <= np.maximum(1e-9 * slow, nothing)[finite]).all()
    assert (apart > 1e-9 * slow[finite]).sum() <= 1


@pytest.mark.parametrize("integrator", gx.stability.INTEGRATORS)
def test_external_limits_are_those_of_numpy(integrator: str) -> None:
    pytest.importorskip("llvmlite")
    points = random_points()
    slow, fast = (
        gx.stability.external_limit_map(**points, integrator=integrator, engine=engine)
        for engine in ("numpy", "compiled")
    )
    assert_same(fast, slow, points)
    if integrator == "explicit":
        again = [
            gx.stability.external_stable_map(slow * factor, **points, integrator=integrator) for factor in (2, 10, 50)
        ]
        assert (np.any(again, axis=0) & (slow > 0.0)).sum() > 10  # stable again beyond the first limit


def test_wall_limits_are_those_of_numpy_and_the_closed_form() -> None:
    pytest.importorskip("llvmlite")
    points = {name: random_points()[name] for name in ("mass", "damping", "period", "spring")}
    slow, fast = (gx.stability.wall_limit_map(**points, engine=engine) for engine in ("numpy", "compiled"))
    assert_same(fast, slow, points)
    m, b, T = 0.1, 2.0, 0.005
    p, E = b / m, np.exp(-b / m * T)
    b1, b0 = (T - (1.0 - E) / p) / b, ((1.0 - E) / p - T * E) / b
    found = gx.stability.wall_limit_map([m, m], b, T, engine="compiled")
    assert found == pytest.approx([min((1.0 - E) / b0, 2.0 * (1.0 + E) / (b1 - b0) if b1 > b0 else np.inf)] * 2)


def test_roots_stand_on_the_circle_at_the_limit() -> None:
    """The kernel as CPython runs it, against eigenvalues of the sampled matrices of device and object."""
    for i, integrator in enumerate(gx.stability.INTEGRATORS):
        if integrator == "implicit":
            continue  # has no limit here
        limit = [0.0]
        map_kernel.external_limits([0.15, 0.2, 0.005, 33.0, 0.05, 0.4], limit, 0, 1, i)
        linear = gx.stability.Linearisation(
            period=0.005, mass=0.15, friction=0.2, hand_stiffness=33.0, G=np.ones((1, 1)), inertia=0.05 * np.eye(1),
            viscosity=0.4 * np.eye(1), stiffness=limit[0] * np.eye(1), integrator=integrator,
        )  # fmt: skip
        assert gx.stability.spectral_radius(linear) == pytest.approx(1.0, abs=1e-9)


def test_cpython_and_machine_code_agree() -> None:
    """Interpreted on memoryviews, to rounding: machine code may multiply by other libraries' exp and cos."""
    pytest.importorskip("llvmlite")
    points = random_points(2)
    wall = np.stack([points[k] for k in ("mass", "damping", "period", "spring")], 1)[:300].reshape(-1)
    written, fast = [0.0] * 300, np.empty(300)
    map_kernel.wall_limits(wall.tolist(), written, 0, 300)
    compiled(map_kernel.wall_limits)(wall, fast, 0, 300)
    np.testing.assert_allclose(fast, written, rtol=1e-9)


def test_order_and_shape_of_a_broadcast_map() -> None:
    pytest.importorskip("llvmlite")
    case = CASE | {"mass": np.linspace(0.05, 0.2, 300)[:, None], "object_damping": np.linspace(0.2, 2.0, 250)}
    slow, fast = (gx.stability.external_limit_map(**case, engine=engine) for engine in ("numpy", "compiled"))
    assert fast.shape == (300, 250)
    np.testing.assert_allclose(fast, slow, rtol=1e-9)


def test_engines_that_cannot_be(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnknownNameError, match="engine"):
        gx.stability.external_limit_map(**CASE, engine="compield")
    with pytest.raises(InputError, match=r"^engine: given"):
        gx.stability.external_limit_map(**CASE, delay=1, engine="compiled")
    with pytest.raises(InputError, match=r"^engine: given"):
        gx.stability.wall_limit_map(0.1, 0.2, 0.005, wall_damping=0.1, engine="compiled")
    monkeypatch.setattr(map_compiled, "find_spec", lambda name: None)
    with pytest.raises(MissingPackageError, match="pip install llvmlite"):
        gx.stability.wall_limit_map(0.1, 0.2, 0.005, engine="compiled")
    assert not map_compiled.is_compiled("auto", 10**9, covered=True)


def test_auto_compiles_where_it_pays() -> None:
    pytest.importorskip("llvmlite")
    assert not map_compiled.is_compiled("auto", 40_000, covered=True)
    assert map_compiled.is_compiled("auto", map_compiled.PAYS, covered=True)
    assert not map_compiled.is_compiled("auto", map_compiled.PAYS, covered=False)
    assert "llvmlite" not in vars(sys.modules["graspfx.analysis.maps.map_compiled"])
