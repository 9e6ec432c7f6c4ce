"""Elementary functions of kernels: against mpmath, at their borders, and the same bits on other processors."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np
import pytest

from graspfx import elementary
from graspfx.compile.machine import compiled
from graspfx.compile.memory import zeros

CASES = {"sin": 1.0, "cos": 1.0, "exp": 1.0, "cube_root": 1.0, "atan2": 2.0, "asin": 2.0, "acos": 2.0}  # bounds [ulp]
MANY = 4000
OLD = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable",
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F",
}
BITS = """
import hashlib, sys
import graspfx as gx
for name in sys.argv[1:]:
    scene = gx.load(name)
    rows = gx.run(scene, duration=min(scene.duration, 300 * scene.period)).rows
    print(name, hashlib.sha256(rows.tobytes()).hexdigest())
"""


def arguments(name: str) -> Iterator[tuple[float, ...]]:
    """Give arguments over each function's range, many of them where it is hard: near multiples of pi/2, near 1."""
    rng = np.random.default_rng(3)
    sizes = rng.choice([-1.0, 1.0], MANY)
    if name in ("sin", "cos"):
        yield from ((x,) for x in sizes * 10.0 ** rng.uniform(-12.0, 8.0, MANY))
        with mpmath.workprec(120):
            yield from ((float(mpmath.pi * int(k) / 2),) for k in rng.integers(1, 6 * 10**7, MANY))
    elif name == "exp":
        yield from ((x,) for x in rng.uniform(-708.0, 709.7, MANY))
        yield from ((x,) for x in sizes * 10.0 ** rng.uniform(-18.0, 1.0, MANY))
    elif name == "cube_root":
        yield from ((x,) for x in sizes * 10.0 ** rng.uniform(-300.0, 300.0, MANY))
    elif name == "atan2":
        yield from zip(sizes * 10.0 ** rng.uniform(-5.0, 5.0, MANY), rng.uniform(-1.0, 1.0, MANY), strict=True)
    else:
        yield from ((x,) for x in rng.uniform(-1.0, 1.0, MANY))
        yield from ((x,) for x in sizes * (1.0 - 10.0 ** rng.uniform(-15.0, 0.0, MANY)))


def exact(name: str, *x: float) -> mpmath.mpf:
    if name == "cube_root":
        return mpmath.sign(x[0]) * mpmath.cbrt(abs(mpmath.mpf(x[0])))
    return getattr(mpmath, name)(*map(mpmath.mpf, x))


@pytest.mark.parametrize("name", CASES)
def test_functions_round_to_the_last_place(name: str) -> None:
    function = getattr(elementary, name)
    with mpmath.workprec(200):
        for x in arguments(name):
            found, right = function(*map(float, x)), exact(name, *map(float, x))
            assert abs(found - right) <= CASES[name] * math.ulp(float(right)), x


@pytest.mark.parametrize("name", ["atan2"])
def test_signs_and_axes_are_those_of_the_c_library(name: str) -> None:
    values = (0.0, -0.0, 1.0, -1.0, math.inf, -math.inf, 5e-324)
    for y in values:
        for x in values:
            found, right = elementary.atan2(y, x), math.atan2(y, x)
            assert found == right and math.copysign(1.0, found) == math.copysign(1.0, right), (y, x)
    assert math.isnan(elementary.atan2(math.nan, 1.0)) and math.isnan(elementary.atan2(1.0, math.nan))


def test_what_has_no_value_is_not_a_number() -> None:
    for x in (math.nan, math.inf, -math.inf, 1.1e8):
        assert math.isnan(elementary.sin(x)) and math.isnan(elementary.cos(x))
    for x in (math.nan, 1.0 + 1e-15, -2.0):
        assert math.isnan(elementary.asin(x)) and math.isnan(elementary.acos(x))
    assert elementary.exp(710.0) == math.inf == elementary.exp(math.inf)
    assert elementary.exp(-746.0) == 0.0 == elementary.exp(-math.inf) and math.isnan(elementary.exp(math.nan))
    assert elementary.exp(-745.0) == math.exp(-745.0) and elementary.exp(709.78) == pytest.approx(math.exp(709.78))
    assert elementary.cube_root(-math.inf) == -math.inf and math.isnan(elementary.cube_root(math.nan))
    assert [math.copysign(1.0, f(-0.0)) for f in (elementary.sin, elementary.asin, elementary.cube_root)] == [-1.0] * 3


def fill(x: Any, out: Any, n: int) -> None:
    """Apply all functions to numbers, one row each, and scale by powers of two."""
    for i in range(n):
        v = x[i]
        out[i] = elementary.sin(v)
        out[n + i] = elementary.cos(v)
        out[2 * n + i] = elementary.exp(0.01 * v)
        out[3 * n + i] = elementary.atan2(v, 3.0 - v)
        out[4 * n + i] = elementary.asin(0.001 * v)
        out[5 * n + i] = elementary.cube_root(v)
        out[6 * n + i] = math.ldexp(v, int(0.5 * v) - 500 * (i % 5))


def test_native_code_computes_the_same_bits() -> None:
    """Of exact scaling too, down to numbers that lose digits and to zero."""
    n = 3000
    x, native, python = zeros(n), zeros(7 * n), zeros(7 * n)
    x[:] = np.random.default_rng(5).uniform(-1000.0, 1000.0, n)
    fill(x, python, n)
    compiled(fill)(x, native, n)
    np.testing.assert_array_equal(native.view(np.int64), python.view(np.int64))
    assert (np.abs(python[6 * n :]) < 2.0**-1022).any()


def test_a_run_repeats_to_the_bit_on_another_processor() -> None:
    """Libraries that choose their code by processor are told that this one is old; the rows stay."""
    names = ["mug", "paper-waving", "paper-spring-arms", "sphere-three-fingers"]

    def bits(old: dict[str, str]) -> str:
        call = [sys.executable, "-c", BITS, *names]
        return subprocess.run(call, env={**os.environ, **old}, capture_output=True, text=True, check=True).stdout

    assert bits(OLD) == bits({}) != ""
