"""Opened loops against the closed one, python-control and closed forms: eigenvalues, margins, signs, frequencies."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.stability.loop import loop_matrix, open_loop
from graspfx.errors import InputError, UnknownNameError

T = 0.001
SCENES = ("reference-1dof", "paper-waving", "sphere-three-fingers", "thin-plate", "soft-pads")
EMPTY = np.zeros((0, 0))


def wall(stiffness: float = 500.0, damping: float = 0.0, delay: int = 0) -> gx.stability.Linearisation:
    """Linearise a device on a wall: no object."""
    return gx.stability.Linearisation(
        period=T, mass=0.04, friction=0.8, G=np.zeros((0, 1)), inertia=EMPTY, viscosity=EMPTY, stiffness=stiffness,
        damping=damping, hand_stiffness=400.0, delay=delay,
    )  # fmt: skip


def ordered(values: np.ndarray) -> np.ndarray:
    return np.sort(np.abs(values))


@pytest.mark.parametrize("name", SCENES)
def test_the_opened_loop_closes_to_the_whole_one(name: str) -> None:
    loop, A = open_loop(name), loop_matrix(name)
    assert np.abs(loop.A + loop.B @ loop.C - A).max() <= 4e-16 * np.abs(A).max()


@pytest.mark.parametrize("name", SCENES)
def test_a_factor_of_the_gain_margin_is_the_edge_of_stability(name: str) -> None:
    linear = gx.load(name).linearise()
    loop, margin = open_loop(linear), gx.stability.loci(linear).gain_margin
    assert margin > 1.0
    if math.isinf(margin):
        return
    radii = [np.abs(np.linalg.eigvals(loop.A + each * loop.B @ loop.C)).max() for each in (0.99, 1.0, 1.01)]
    moving = [np.abs(np.linalg.eigvals(loop.A + margin * each * loop.B @ loop.C)) for each in (1.0 - 1e-6, 1.0 + 1e-4)]
    assert radii[1] <= 1.0 + 1e-9
    assert (moving[0] > 1.0 + 1e-9).sum() == 0 < (moving[1] > 1.0 + 1e-9).sum()


def test_gains_times_the_margin_are_the_edge_of_stability() -> None:
    linear = gx.load("paper-waving").linearise()
    margin = gx.stability.loci(linear).gain_margin
    for share, stable in ((1.0 - 1e-6, True), (1.0 + 1e-4, False)):
        scaled = linear.with_changes(stiffness=share * margin * linear.stiffness)
        assert (gx.stability.spectral_radius(scaled) < 1.0) is stable


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("damping", [0.0, 1.5])
def test_margins_of_a_wall_are_those_of_python_control_and_of_the_closed_form(damping: float, delay: int) -> None:
    linear = wall(100.0, damping, delay)
    ours = gx.stability.loci(linear)
    system = linear.to_control("open")
    omega = np.geomspace(0.002, 1.0, 20001)[:-1] * math.pi / T
    response = system(np.exp(1j * omega * T))
    gain, phase, *at = control.margin(np.abs(response), np.degrees(np.unwrap(np.angle(response))), omega)
    assert ours.gain_margin == pytest.approx(gain, rel=1e-4)
    assert 2.0 * math.pi * ours.gain_frequency == pytest.approx(at[0], rel=1e-4)
    assert ours.phase_margin == pytest.approx(abs(phase), rel=1e-4)
    assert 2.0 * math.pi * ours.phase_frequency == pytest.approx(at[1], rel=1e-4)
    if not damping:
        limit = gx.stability.wall_limit(0.04, 0.8, T, spring=400.0, delay=delay)
        assert ours.gain_margin == pytest.approx(limit / 100.0, rel=1e-6)


def test_the_response_is_that_of_python_control() -> None:
    linear = wall(500.0, 1.0, 1)
    ours = gx.stability.loci(linear, np.linspace(1.0, 500.0, 40))
    theirs = linear.to_control("open")(np.exp(2j * math.pi * ours.frequency * T))
    assert np.allclose(ours.response[:, 0], theirs, rtol=1e-9)
    assert np.allclose(ours.magnitude[:, 0], np.abs(theirs), rtol=1e-9)
    wrapped = np.exp(1j * np.radians(ours.phase[:, 0]))
    assert np.allclose(wrapped, theirs / np.abs(theirs), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", SCENES)
def test_a_closed_system_has_the_loops_eigenvalues(name: str) -> None:
    linear = gx.load(name).linearise()
    system = linear.to_control()
    assert system.dt == linear.period
    assert np.allclose(ordered(system.poles()), ordered(np.linalg.eigvals(loop_matrix(linear))), atol=1e-7)
    m, r = linear.coordinates
    assert (system.ninputs, system.noutputs) == (m, 2 * m + r)
    assert system.input_labels[0] == "hand[0]" and system.output_labels[m] == "q[0]"


@pytest.mark.parametrize("name", ["reference-1dof", "paper-waving"])
def test_feedback_closes_an_open_system(name: str) -> None:
    linear = gx.load(name).linearise()
    m, _ = linear.coordinates
    closed = control.feedback(linear.to_control("open"), np.eye(m))
    assert np.allclose(ordered(closed.poles()), ordered(np.linalg.eigvals(loop_matrix(linear))), atol=1e-9)


def test_signs_of_a_closed_system() -> None:
    """A steady force of 1 N into a wall of 500 N/m beside a hand of 400 N/m: in by 1/900 m, the wall gets 500/900 N."""
    gain = wall(500.0).to_control().dcgain()
    assert np.allclose(gain[:, 0], [1.0 / 900.0, 500.0 / 900.0], rtol=1e-9)


def test_a_step_of_the_operator_is_that_of_the_device() -> None:
    """Without coupling m x'' + b x' + k x = u: by the exponential of its own equations."""
    free = wall(0.0)
    time = np.arange(200) * T
    result = control.step_response(free.to_control(), T=time)
    exact = control.step_response(control.TransferFunction([1.0], [0.04, 0.8, 400.0]), T=time)
    assert np.allclose(result.outputs[0, 0], exact.outputs, atol=1e-6)


def test_a_loop_of_another_name_and_frequencies_that_are_none() -> None:
    with pytest.raises(UnknownNameError, match="unknown loop 'opne'; did you mean 'open'"):
        wall().to_control("opne")
    for frequency in ([1.0], [2.0, 1.0], [1.0, 600.0], [0.0, 1.0]):
        with pytest.raises(InputError, match=r"frequency: .*at least two increasing numbers .*up to 500 Hz"):
            gx.stability.loci(wall(), frequency)


@pytest.mark.parametrize("mass", [None, 0.04])
def test_a_z_width_is_the_limits_over_the_walls_damping(mass: float | None) -> None:
    region = gx.passivity.z_width(0.8, T, mass=mass, delay=1)
    assert (np.diff(region.wall_damping) > 0.0).all() and (np.diff(region.passive) <= 0.0).all()
    for k in (0, 40, 100):
        B = float(region.wall_damping[k])
        passive = gx.passivity.guaranteed_wall_limit(0.8, T, wall_damping=B, delay=T)
        assert region.passive[k] == passive
        if mass is None:
            assert region.stable is None
        else:
            assert region.stable is not None
            assert region.stable[k] == gx.stability.wall_limit(mass, 0.8, T, wall_damping=B, delay=1)
    assert region.passive[-1] == 0.0
    if region.stable is not None:
        assert region.stable[-1] == 0.0 and (region.stable >= region.passive * (1.0 - 1e-9)).all()


def test_a_z_width_without_delay_is_colgates() -> None:
    """Passive is K T/2 + B < b (Colgate and Schenkel 1997)."""
    region = gx.passivity.z_width(0.8, T, wall_damping=[0.0, 0.2, 0.8])
    assert np.allclose(region.passive, [1600.0, 1200.0, 0.0], rtol=1e-12)
    with pytest.raises(InputError, match="wall_damping"):
        gx.passivity.z_width(0.8, T, wall_damping=[0.2, 0.1])
