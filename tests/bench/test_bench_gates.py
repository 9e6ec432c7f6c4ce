"""Gates of speed: ratios to peers within one run, at half of what was measured, never a time by itself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from graspfx.bench.case import Case, Method
from graspfx.bench.measure import Effort, Row, check, interleaved
from graspfx.bench.registry import benchmark as benchmark_named

pytestmark = pytest.mark.alone

BRIEF = Effort(rounds=9, batch=200_000, most=300_000_000, least=2, singles=1)


FACE = "GraspFX Grasp.split, Coupling.force"
SPLIT = "5 fingers, contacts fixed"
MANY = "1000 sets of 5 fingers, one call"
NORMALS = "frictionless, 5 fingers, gains' ratio 3"
PIVOTING = "GraspFX pivoting, compiled"
WALL = "device on a wall, 60 by 60"

ROUNDING = {"limit of 20 fingers": 192 * 2.2e-16}  # of the eigenvalues of 192 states, of a method and of its peer


@contextmanager
def case_of(name: str, case_name: str) -> Iterator[Case]:
    """A case; what its benchmark has built is there until the end."""
    with closing(benchmark_named(name).cases(quick=True)) as cases:
        yield next(each for each in cases if each.name == case_name)


def method_of(case: Case, name: str) -> tuple[Method, Row]:
    """A method with its checked row."""
    [method] = [m for m in case.methods if m.name == name]
    return method, check(case, method)


@pytest.mark.parametrize(
    ("name", "case_name", "ours", "peer", "least"),
    [
        pytest.param("eq4", "5 fingers", "GraspFX PointCoupling, compiled", "numpy pinv", 90.0, id="direct-pinv"),
        pytest.param("eq4", "5 fingers", "GraspFX PointCoupling, compiled", "scipy posv", 25.0, id="direct-posv"),
        pytest.param("eq4", "5 fingers", FACE, "numpy pinv", 2.5, id="face-pinv"),
        pytest.param("eq4", SPLIT, "GraspFX Coupling.force, split known", "numpy, P known", 0.5, id="face-P-known"),
        pytest.param("eq4", MANY, FACE, "numpy pinv, stacked", 12.0, id="face-many-pinv"),
        pytest.param("eq4", MANY, FACE, "numpy, closed form, stacked", 1.25, id="face-many-closed-form"),
        pytest.param("projection", NORMALS, "GraspFX pivoting, compiled", "clarabel to 1e-08", 8.0, id="cone-clarabel"),
        pytest.param("maps", WALL, "GraspFX, numpy", "numpy eigenvalues, Brent", 100.0, id="map-eigenvalues"),
        pytest.param("maps", "limit of 20 fingers", "GraspFX", "numpy eigenvalues, Brent", 2.5, id="grasp-eigenvalues"),
        pytest.param("startup", "whole processes", "import graspfx", "import numpy", 0.77, id="import-numpy"),
    ],
)
def test_faster_than_its_peer_and_no_less_exact(
    name: str, case_name: str, ours: str, peer: str, least: float, benchmark: BenchmarkFixture
) -> None:
    if "compiled" in ours:
        pytest.importorskip("llvmlite")
    with case_of(name, case_name) as case:
        (own, own_row), (other, other_row) = method_of(case, ours), method_of(case, peer)
        assert (own_row.state, other_row.state) == ("timed", "timed")
        own_times, other_times = interleaved([own, other], BRIEF)
        benchmark.pedantic(own.call, rounds=3)
    ratio = min(other_times) / min(own_times)
    benchmark.extra_info.update(peer=peer, ratio=ratio, least=least)
    assert ratio >= least
    if own_row.error is not None:
        rounding = ROUNDING.get(case_name, 4e-15)
        assert other_row.error is not None and own_row.error <= max(other_row.error, rounding)


@pytest.mark.parametrize("case_name", ["5 fingers", "5 fingers, 1 km from the origin", "5 fingers on a line (rank 5)"])
def test_direct_kernel_is_exact(case_name: str) -> None:
    pytest.importorskip("llvmlite")
    with case_of("eq4", case_name) as case:
        _, row = method_of(case, "GraspFX direct kernel, compiled")
    assert row.error is not None and row.error <= 4e-15


@pytest.mark.parametrize(
    ("name", "most"),
    [("GraspFX gx.run", 4.0), ("GraspFX gx.run to disk", 12.0), ("GraspFX gx.run and its summary", 16.0)],
)
def test_a_long_run_costs_little_more_than_its_ticks(name: str, most: float) -> None:
    """The limits are about twice what was measured, with building the scene; a busy machine gets further chances."""
    pytest.importorskip("llvmlite")
    with case_of("runs", "space, 5 fingers, a long run") as case:
        methods = {method.name: method for method in case.methods}
        pair = [methods[each] for each in (name, "GraspFX, ticks alone")]
        for _ in range(5):
            own, alone = interleaved(pair, BRIEF)
            if min(own) <= most * min(alone):
                return
    pytest.fail(f"{min(own):.3g} s against {min(alone):.3g} s of ticks alone")


@pytest.mark.parametrize(
    ("case_name", "most"),
    [
        ("line, 2 fingers, kep < kip", 1.4),
        ("plane, 3 fingers, kep < kip", 1.6),
        ("space, 5 fingers, kep < kip", 1.6),
    ],
)
def test_a_tick_on_pybullet_is_little_more_than_pybullet(case_name: str, most: float) -> None:
    """Ratios to the bare calls: 0.8, 1.1 and 1.1 were measured. A busy machine gets further chances."""
    pytest.importorskip("llvmlite")
    pytest.importorskip("pybullet", reason="pybullet has no wheel for this Python or platform")
    with case_of("ticks", case_name) as case:
        methods = {method.name: method for method in case.methods}
        pair = [methods[name] for name in ("GraspFX on PyBullet", "PyBullet, bare calls")]
        for _ in range(5):
            own, bare = interleaved(pair, BRIEF)
            if min(own) <= most * min(bare):
                return
    pytest.fail(f"{min(own):.2f} us against {min(bare):.2f} us of bare calls")


@pytest.mark.parametrize(
    ("case_name", "most"),
    [
        ("friction, 5 fingers, integrators", 4.0),
        ("friction, 20 fingers, integrators", 4.0),
        ("no friction, 20 fingers, integrators", 5.0),
    ],
)
def test_an_implicit_tick_costs_as_much_as_a_few_exact_ones(case_name: str, most: float) -> None:
    """Twice the margin of what was measured: 1.8, 1.4 and 2.5 times; the square system took 20, 89 and 99 times."""
    pytest.importorskip("llvmlite")
    with case_of("ticks", case_name) as case:
        methods = {method.name: method for method in case.methods}
        pair = [methods[name] for name in ("GraspFX implicit", "GraspFX exact")]
        for _ in range(5):
            implicit, exact = interleaved(pair, BRIEF)
            if min(implicit) <= most * min(exact):
                return
    pytest.fail(f"{min(implicit):.2f} us against {min(exact):.2f} us")
