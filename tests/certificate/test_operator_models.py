"""Operators who are not springs in the certificate: against runs, closed forms, and a state for each late sample."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.linearisation import Linearisation, OperatorMatrices
from graspfx.analysis.stability import loop as loop_module
from graspfx.analysis.stability.late_roots import LateLoop, farthest_root, roots_beyond
from graspfx.analysis.stability.loop import late_loop, loop_matrix, radius_of, without_drift
from graspfx.certificate.first_loss import Family, Line, WholeLoop, reach
from graspfx.certificate.linearise import linearise
from graspfx.certificate.mode_limits import mode_limits
from graspfx.errors import InputError

T = 0.002
LIMB = {"limb": {"mass": 0.15, "stiffness": 150.0, "damping": 2.0}, "stiffness": 400.0, "damping": 1.5}
STIFFENING = {"stiffening": {"stiffness": 120.0, "damping": 0.6, "lag": 0.03}}
REACTION = {"reaction": {"delay": 0.15, "stiffness": 25.0, "damping": 0.8, "force": 0.1}}


def pinch(**hand: Any) -> gx.Scene:
    """Two fingers on a line that squeeze a body from its two sides."""
    own = {"stiffness": 60.0, "damping": 1.0, "squeeze": 0.01, **hand}
    return gx.Scene(
        dimensions=1,
        period=T,
        duration=1.0,
        object=[{"mass": 0.1, "viscosity": 0.8}],
        coupling={"contact": "attached", "external": {"stiffness": 100.0}, "internal": {"stiffness": 200.0}},
        finger=[
            {
                "device": {"name": "simulated", "mass": 0.1, "damping": 0.2},
                "start": [x],
                "hand": {**own, "closing": [-np.sign(x)]},
            }
            for x in (-0.025, 0.025)
        ],
    )


def difference(own: dict[str, Any], kick: float, duration: float) -> Any:
    """Run a pinch twice, the first finger a little aside at first, and give by how much all coordinates differ."""
    scene, runs = pinch(**own), []
    for k in (0.0, kick):
        starts: dict[str, Any] = {f"finger.{i}.hand.rest": [x] for i, x in enumerate((-0.025, 0.025))}
        runs.append(gx.run(scene.replace(starts | {"finger.0.start": [-0.025 + k], "duration": duration})))
    x, q = (getattr(runs[1], name) - getattr(runs[0], name) for name in ("finger_position", "object_position"))
    return np.column_stack([x[:, :, 0], q[:, 0]])


def seen(A: Any) -> Any:
    """Pick out of a state: two fingers and the object."""
    C = np.zeros((3, len(A)))
    C[0, 0] = C[1, 1] = C[2, 4] = 1.0
    return C


@pytest.mark.parametrize("own", [LIMB, REACTION, LIMB | REACTION], ids=["limb", "late", "both"])
def test_runs_differ_as_the_matrix_has_it(own: dict[str, Any]) -> None:
    """All of it is linear: to rounding, sample by sample, from a finger and its limb that start 1 mm aside."""
    linear = linearise(pinch(**own)).linear
    A = loop_matrix(linear)
    state = np.zeros(len(A))
    assert linear.operator is not None
    state[0] = 1e-3
    if linear.operator.limbs:
        state[6] = 1e-3
    rows = []
    for _ in range(300):
        rows.append(seen(A) @ state)
        state = A @ state
    assert difference(own, 1e-3, 0.6)[:300] == pytest.approx(np.array(rows), abs=1e-13)


def test_small_motions_in_hands_that_grip_makes_stiffer_are_those_of_the_matrix() -> None:
    """From 1 s on, when the squeeze rests, the difference of two runs is a motion of the linear loop."""
    A = loop_matrix(linearise(pinch(**STIFFENING)).linear)
    x = difference(STIFFENING, 1e-6, 1.3)[500:]
    step, rows = seen(A), []
    for _ in range(len(x)):
        rows.append(step)
        step = step @ A
    observed = np.concatenate(rows)
    state = np.linalg.lstsq(observed, x.ravel(), rcond=1e-13)[0]
    assert len(A) == 8
    assert np.abs(observed @ state - x.ravel()).max() < 1e-4 * np.abs(x).max()


def matrices(**parts: Any) -> OperatorMatrices:
    """One coordinate without a limb, and with these parts."""
    own: dict[str, Any] = dict.fromkeys(("pull", "pull_damping", "counter", "grip", "friction"), np.zeros((1, 1)))
    own |= dict.fromkeys(("limb_mass", "limb_stiffness", "limb_damping"), np.zeros((0, 0)))
    own |= {"limb": np.zeros((1, 0)), "delay": np.array([1]), "grip_share": np.zeros(1)}
    return OperatorMatrices(**(own | parts))


def random_loop(seed: int) -> LateLoop:
    random = np.random.default_rng(seed)
    n, p = int(random.integers(3, 10)), int(random.integers(1, 4))
    A = random.normal(size=(n, n))
    A *= random.uniform(0.8, 1.0) / np.abs(np.linalg.eigvals(A)).max()
    B = random.normal(size=(n, p)) * 10.0 ** random.uniform(-3.0, 0.0)
    return LateLoop(A, B, 0.3 * random.normal(size=(p, n)), random.integers(1, 90, size=p))


@pytest.mark.parametrize("seed", range(12))
def test_roots_of_late_loops_are_eigenvalues_with_a_state_for_each_sample(seed: int) -> None:
    loop = random_loop(seed)
    n, p = loop.B.shape
    whole = np.zeros((n + int(loop.delay.max()) * p,) * 2)
    whole[:n, :n], whole[n : n + p, :n] = loop.A, loop.C
    for i, late in enumerate(loop.delay.tolist()):
        whole[:n, n + (late - 1) * p + i] -= loop.B[:, i]
    whole[range(n + p, len(whole)), range(n, len(whole) - p)] = 1.0
    z = np.linalg.eigvals(whole)
    assert abs(farthest_root(loop)) == pytest.approx(np.abs(z).max(), rel=1e-12)
    for radius in (0.97, 1.0, 1.02):
        assert roots_beyond(loop, radius) == (np.abs(z) > radius).sum()


def test_a_late_spring_on_a_mass_has_the_delay_margin_of_its_phase() -> None:
    """A device with a plain spring and a late one: margins of its continuous loop, for T -> 0 and many samples."""
    from scipy.optimize import brentq

    m, b, k, late = 0.2, 3.0, 400.0, 200.0
    # |late/(k - m w^2 + j b w)| = 1 at w, where the phase leaves so much delay: the first at which -k_l e^-jw d = -1
    w = max(float(brentq(lambda w: late - abs(k - m * w**2 + 1j * b * w), low, high)) for low, high in [(50.0, 80.0)])
    delay = (np.angle(-1.0 / (k - m * w**2 + 1j * b * w)) % (2.0 * np.pi)) / w
    one, period = np.ones((1, 1)), 1e-5

    def radius(samples: int) -> float:
        operator = matrices(pull=late * one, delay=np.array([samples]))
        linear = Linearisation(
            period=period, mass=m, friction=b, G=np.zeros((0, 1)), inertia=np.zeros((0, 0)), viscosity=np.zeros((0, 0)),
            stiffness=0.0, hand_stiffness=k, operator=operator,
        )  # fmt: skip
        return radius_of(linear)

    critical = round(delay / period - 0.5)  # the hold is half a sample of it
    assert critical > 1000
    assert radius(critical - 3) < 1.0 < radius(critical + 3)


def test_long_delays_are_counted_and_short_ones_have_states_with_one_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = linearise(pinch(**LIMB, **REACTION))
    assert loop_module.is_late(loop.linear)
    counted = radius_of(loop.linear)
    limits = {row.mode: row for row in mode_limits(pinch(), loop, halves=False, compare=False)}
    A = without_drift(loop.linear, loop_matrix(loop.linear))
    assert np.abs(np.linalg.eigvals(A)).max() == pytest.approx(counted, abs=1e-12)
    monkeypatch.setattr(loop_module, "MOST_LATE", 10_000)
    assert not loop_module.is_late(loop.linear)
    for row in mode_limits(pinch(), loop, halves=False, compare=False):
        assert row.limit == pytest.approx(limits[row.mode].limit, rel=1e-8)
        assert row.frequency == pytest.approx(limits[row.mode].frequency, rel=1e-6)


def test_motions_that_are_lost_together_are_counted_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three fingers around a sphere are alike: eigenvalues that cross the circle are several times the same."""
    scene = gx.load("sphere-three-fingers", {"hand.0.reaction": {"delay": 0.02, "stiffness": 60.0, "damping": 0.5}})
    loop = linearise(scene)
    assert loop_module.is_late(loop.linear)
    limits = {row.mode: row for row in mode_limits(scene, loop, halves=False, compare=False)}
    monkeypatch.setattr(loop_module, "MOST_LATE", 10_000)
    for row in mode_limits(scene, loop, halves=False, compare=False):
        assert row.limit == pytest.approx(limits[row.mode].limit, rel=1e-8)
        assert row.frequency == pytest.approx(limits[row.mode].frequency, rel=1e-6)


@pytest.mark.parametrize("own", [LIMB, STIFFENING, REACTION], ids=["limb", "grip", "late"])
def test_parts_that_move_by_themselves_have_the_radius_of_the_whole(own: dict[str, Any]) -> None:
    loop = linearise(pinch(**own))
    assert loop.gains is not None
    K = loop.linear.stiffness
    parts, whole = WholeLoop(loop.linear, loop.gains), WholeLoop(loop.linear)
    assert len(parts.parts) == 2
    for factor in (0.5, 2.0, 8.0):
        radii = [Family(each, lambda s: s * K).radius(factor) for each in (parts, whole)]
        assert radii[0] == pytest.approx(radii[1], abs=1e-10)


def test_a_limb_without_end_is_a_wall_and_one_without_mass_two_springs_in_series() -> None:
    plain = linearise(pinch()).linear
    heavy = linearise(pinch(limb={"mass": 1e6, "stiffness": 1e9, "damping": 1e6})).linear
    assert radius_of(heavy.with_changes(operator=None)) == radius_of(plain)
    line = Line(np.zeros((2, 2)), plain.stiffness)
    assert reach(heavy, line).factor == pytest.approx(reach(plain, line).factor, rel=1e-4)
    light = linearise(
        pinch(stiffness=120.0, damping=2.0, limb={"mass": 1e-5, "stiffness": 120.0, "damping": 2.0})
    ).linear
    assert reach(light, line).factor == pytest.approx(reach(plain, line).factor, rel=1e-3)


def test_the_rest_is_that_of_a_run() -> None:
    """Grip, limb and reaction change how deep hands that squeeze press."""
    scene = pinch(**LIMB, **STIFFENING, **REACTION)
    rec = gx.run(scene.replace({"duration": 4.0}))
    K = linearise(scene).linear.hand_stiffness
    grip = abs(float(rec.finger_force[-1, 0, 0]))
    assert K[0, 0] == pytest.approx(400.0 + 120.0 * grip, rel=1e-6)


def test_what_is_left_out_or_taken_for_granted_is_said() -> None:
    noisy = {"tremor": {"amplitude": 1e-4}, "noise": {"share": 0.02, "cutoff": 10.0, "lag": 0.1}}
    loop = linearise(pinch(**STIFFENING, **REACTION, **noisy))
    text = "\n".join(loop.assumed)
    assert "tremor and noise omitted" in text
    assert "have the stiffness of their grip forces" in text
    assert "delays of reactions are rounded to samples" in text
    quiet, plain = (radius_of(linearise(pinch(**each)).linear) for each in (noisy, {}))
    assert quiet == plain
    card = str(loop.linear)
    assert "operator" in card


def test_matrices_that_do_not_fit_are_refused() -> None:
    one = np.ones((1, 1))
    operator = matrices(pull=one)
    assert operator.reacts
    wrong: dict[str, Any] = {
        "limb_mass": one,
        "pull": np.ones((2, 2)),
        "delay": np.array([0]),
        "grip": np.full((1, 1), np.nan),
        "grip_share": np.ones(2),
    }
    for name, value in wrong.items():
        with pytest.raises(InputError, match=name):
            matrices(**{"pull": one, name: value})
    with pytest.raises(InputError, match="coordinates"):
        linearise(pinch()).linear.with_changes(operator=operator)
    with pytest.raises(InputError, match="closed form"):
        gx.stability.modes(linearise(pinch(**LIMB)).linear)
    assert late_loop(linearise(pinch(**REACTION)).linear).delay.tolist() == [75, 75]


def test_reactions_too_late_for_too_many_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_module, "MOST_WALKED", 299)  # two coordinates, 75 samples
    with pytest.raises(InputError, match="for a stability analysis"):
        late_loop(linearise(pinch(**REACTION)).linear)
