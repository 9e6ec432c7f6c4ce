"""Limits over the whole loop: parts that move by themselves, Newton's crossing, families side by side."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.loop import loop_matrix, without_drift
from graspfx.analysis.stability.modes import parts_of
from graspfx.certificate.certificate import Certificate, Limit, is_stable
from graspfx.certificate.first_loss import Family, Line, WholeLoop, bracketed, crossings, least_reaches, reach, reaches
from graspfx.certificate.linearise import linearise
from graspfx.certificate.report import Report
from tests.support.random_scenes import random_case


def sizes(linear: Linearisation) -> list[tuple[int, int]]:
    return sorted(part.linear.coordinates for part in parts_of(linear, [linear.stiffness]))


def eigenvalues(linear: Linearisation) -> np.ndarray:
    return np.linalg.eigvals(without_drift(linear, loop_matrix(linear)))


def alike_fingers(n: int, *, preload: bool = False, seed: int = 0) -> Linearisation:
    """n fingers in space with equal devices and hands on a ball, kep = 200 and kip = 400 N/m."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(n, 3))
    contacts = 0.03 * u / np.linalg.norm(u, axis=1)[:, None]
    grasp = gx.Grasp(contacts)
    split = grasp.split()
    law = gx.Coupling(gx.Impedance(200.0, 1.0), gx.Impedance(400.0, 1.0))
    force = -100.0 * contacts * rng.uniform(0.5, 1.0, n)[:, None]
    squeeze = gx.stability.preloaded(contacts, force / 400.0, force)
    return Linearisation(
        period=0.005,
        mass=0.1,
        friction=0.5,
        G=squeeze.G if preload else grasp.matrix,
        G_displacement=squeeze.G_displacement if preload else None,
        preload=squeeze.preload if preload else None,
        inertia=[0.25, 0.25, 0.25, 1e-4, 1.5e-4, 2e-4],
        viscosity=[0.5, 0.5, 0.5, 5e-4, 5e-4, 5e-4],
        stiffness=law.stiffness(split),
        damping=law.damping(split),
        hand_stiffness=200.0,
        hand_damping=4.0,
    )


def test_alike_fingers_leave_one_internal_motion() -> None:
    """Six of 3 n coordinates move the object; the others are one motion on a wall, 54 times over."""
    assert sizes(alike_fingers(20)) == [(1, 0), (6, 6)]


def test_a_squeezed_grasp_of_alike_fingers_has_nine_coordinates_with_its_object() -> None:
    """Shifts, turns of contacts, and of forces, which the fingertips' are a sum of."""
    assert sizes(alike_fingers(20, preload=True)) == [(1, 0), (9, 6)]


def test_twenty_fingers_on_a_bumpy_mesh_have_twelve() -> None:
    """Shifts, and turns of contacts, of fingertips and of forces; the rest of 60 is one motion, 48 times over."""
    linear = linearise(gx.load("twenty-fingers"), "provisional").linear
    assert sizes(linear) == [(1, 0), (12, 6)]


@pytest.mark.parametrize("preload", [False, True])
def test_the_parts_have_the_eigenvalues_of_the_whole(preload: bool) -> None:
    """Each of them is one of the whole loop's to 1e-9, and each of the whole's is one of theirs."""
    linear = alike_fingers(8, preload=preload)
    whole = eigenvalues(linear)
    divided = Family(WholeLoop(linear, [linear.stiffness]), lambda s: linear.stiffness).roots(np.ones(1))[0]
    assert len(divided) < len(whole)
    distances = np.abs(whole[:, None] - divided[None, :])
    assert distances.min(axis=0).max() < 1e-9
    assert distances.min(axis=1).max() < 1e-9


@pytest.mark.parametrize("seed", range(40))
def test_random_loops_in_parts_have_the_radii_of_the_whole(seed: int) -> None:
    """Unlike devices, delays, preloads, every integrator: 1e-9 at four factors of the gains."""
    linear = random_case(seed).linear
    K = linear.stiffness
    family = Family(WholeLoop(linear, [K]), Line(np.zeros_like(K), K))
    for factor in (0.3, 1.0, 2.0, 7.0):
        whole = eigenvalues(linear.with_changes(stiffness=factor * K))
        if linear.hand_stiffness.any():
            assert family.radius(factor) == pytest.approx(np.abs(whole).max(), rel=1e-9)


def test_unlike_devices_are_one_part() -> None:
    linear = alike_fingers(3)
    mass = 0.1 * np.arange(1.0, 10.0)
    assert sizes(linear.with_changes(mass=mass, friction=0.5)) == [(9, 6)]


def slow_reach(linear: Linearisation) -> float:
    """Find the first loss of stability by halving, from steps of 2 %, with the whole loop's eigenvalues."""
    K, factor = linear.stiffness, 1.0

    def stable(s: float) -> bool:
        return is_stable(float(np.abs(eigenvalues(linear.with_changes(stiffness=s * K))).max()))

    while stable(factor):
        factor *= 1.02
    low, high = factor / 1.02, factor
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


@pytest.mark.parametrize("preload", [False, True])
def test_newtons_crossing_is_the_one_of_halving(preload: bool) -> None:
    linear = alike_fingers(5, preload=preload)
    K = linear.stiffness
    assert reach(WholeLoop(linear, [K]), Line(np.zeros_like(K), K)).factor == pytest.approx(
        slow_reach(linear), rel=1e-9
    )


def test_families_side_by_side_have_the_reaches_of_each_alone() -> None:
    loops = [alike_fingers(n, preload=n % 2 == 0, seed=n) for n in (2, 3, 3, 4, 5)]
    families = [Family(WholeLoop(each, [each.stiffness]), Line(0.0 * each.stiffness, each.stiffness)) for each in loops]
    alone = [reaches([family])[0] for family in families]
    for one, together in zip(alone, reaches(families), strict=True):
        assert together.factor == pytest.approx(one.factor, rel=1e-12)
        assert together.frequency == pytest.approx(one.frequency, rel=1e-9, nan_ok=True)


def test_gains_that_are_no_line_have_the_same_reach_by_a_bracket() -> None:
    linear = alike_fingers(4)
    K = linear.stiffness
    line = reach(WholeLoop(linear, [K]), Line(np.zeros_like(K), K))
    assert crossings([(Family(linear, lambda s: s * K), line.factor, 1.0 + 0.1j)]) == [None]
    curve = reach(linear, lambda s: s * K)
    assert curve.factor == pytest.approx(line.factor, rel=1e-11)
    assert curve.frequency == pytest.approx(line.frequency, rel=1e-7)


@pytest.mark.parametrize("power", [1, 3, 9])
def test_a_bracket_finds_the_root_of_a_power(power: int) -> None:
    """(x - 1.3)^p, flat for large p: to 1e-11 of the root, or to where the function is nothing but rounding."""
    root = bracketed(lambda x: (x - 1.3) ** power, 1.0, 2.0)
    assert abs(root - 1.3) < 1e-11 or abs(root - 1.3) ** power < 1e-100


def test_a_quick_certificate_has_every_limit_in_a_tuple() -> None:
    [quick], [full] = (gx.certify("paper-spring", quick=quick) for quick in (True, False))
    assert {type(quick.limits), type(full.limits)} == {tuple}
    modes = [row.mode for row in quick.limits]
    assert modes == [row.mode for row in full.limits] == [row.mode for row in pickle.loads(pickle.dumps(quick)).limits]
    assert modes[-1].startswith("pushing with ")


def test_of_a_group_the_least_reach_is_what_it_is_alone() -> None:
    """Loops whose limits are a grid's step and more apart: those with larger ones are inf, in any order."""
    groups = []
    for factors in ((1.0, 2.0, 9.0), (9.0, 1.0, 2.0), (150.0, 0.02, 1.0), (1.0, 1.0)):
        linear = alike_fingers(3)
        K = linear.stiffness
        groups.append([Family(WholeLoop(linear, [K]), Line(np.zeros_like(K), each * K)) for each in factors])
    for group, answers in zip(groups, least_reaches(groups), strict=True):
        alone = reaches(group)
        least = min(alone, key=lambda each: each.factor)
        for one, answer in zip(alone, answers, strict=True):
            assert answer == one or (math.isinf(answer.factor) and one.factor > 1.1 * least.factor)
        assert sum(answer == least for answer in answers) >= 1


# Verdicts ----------------------------------------------------------------------------------------------------------


def certificate(radius: float, margin: float) -> Certificate:
    row = Limit("external", 100.0, 100.0 * margin, margin, 20.0, exact=False)
    return Certificate("ball", "squeezed", radius, (row,), (), None)


def test_a_radius_of_one_to_rounding_is_stable_as_its_margin_is() -> None:
    """Motions that neither grow nor decay have |z| = 1, computed as a little more; limits have the same band."""
    for excess in (0.0, 2.2e-16, 4e-12):
        report = Report("a scene", certificates=(certificate(1.0 + excess, 4.42),))
        assert report.verdict.startswith("stable: ball")
        assert "smallest margin: external" in report.verdict
    assert not certificate(1.0 + 1e-10, 4.42).stable


def test_a_loop_that_grows_at_gains_within_their_limits_says_so() -> None:
    verdict = Report("a scene", certificates=(certificate(1.001, 4.42),)).verdict
    assert verdict.startswith("NOT STABLE: ball, spectral radius 1.001000; no gain exceeds its limit; smallest")
    verdict = Report("a scene", certificates=(certificate(1.001, 0.9),)).verdict
    assert verdict.startswith("NOT STABLE: ball, spectral radius 1.001000; external 100 N/m: limit 90, margin 0.90")


@pytest.mark.parametrize("factor", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("name", ["paper-spring", "reference-1dof", "knob"])
def test_verdict_and_margin_agree_for_hands_a_thousand_times_off(name: str, factor: float) -> None:
    scene = gx.load(name)
    table = scene.to_dict()
    hands = table.get("hand") or []
    keys = [f"hand.{i}.{part}.stiffness" for i, hand in enumerate(hands) for part in ("arm", "grip")]
    keys = keys or [f"finger.{i}.hand.stiffness" for i in range(len(table["finger"]))]
    changed = scene.replace({key: factor * _value(table, key) for key in keys})
    for each in gx.certify(changed, quick=True):
        margins = [row.margin for row in each.limits if not row.mode.startswith("pushing")]
        assert each.stable is (min(margins) > 1.0), (each.spectral_radius, margins)


def _value(table: dict[str, Any], key: str) -> float:
    value: object = table
    for word in key.split("."):
        value = value[int(word) if word.isdigit() else word]  # type: ignore[index]
    assert isinstance(value, float)
    assert math.isfinite(value)
    return value
