"""Passivity limits of one or several channels: closed forms, python-control, and energy over a finite time."""

from __future__ import annotations

from typing import Any

import control
import mpmath
import numpy as np
import pytest
import scipy.signal

from graspfx.analysis import passivity
from graspfx.analysis.passivity.display import StateSpace, display
from graspfx.analysis.passivity.requirement import PositiveReal, worst_on_grid
from graspfx.errors import InputError

dlti: Any = scipy.signal.dlti  # makes objects of other classes, which its stubs do not say
lti: Any = scipy.signal.lti

T = 0.005
CASES = range(20)


def backward_wall(K: float, B: float, delay: int = 0) -> StateSpace:
    """(K + B (1 - 1/z)/T) z^-delay, on a register of the positions before."""
    taps = np.zeros(delay + 2)
    taps[delay:] = K + B / T, -B / T
    return StateSpace(np.eye(delay + 1, k=-1), np.eye(delay + 1)[:, :1], taps[None, 1:], taps[None, :1])


def random_display(seed: int) -> tuple[StateSpace, np.ndarray]:
    """Up to three channels and five states, poles within 0.9, and a stiffness at rest that is symmetric positive."""
    rng = np.random.default_rng(seed)
    n, s = int(rng.integers(1, 4)), int(rng.integers(1, 6))
    A = rng.normal(size=(s, s))
    A *= rng.uniform(0.3, 0.9) / np.abs(np.linalg.eigvals(A)).max()
    B, C = rng.normal(size=(s, n)), 20.0 * rng.normal(size=(n, s))
    root = rng.normal(size=(n, n))
    D = 30.0 * root @ root.T - C @ np.linalg.solve(np.eye(s) - A, B)
    b = rng.uniform(0.05, 0.5, size=n)
    skewed = rng.normal(size=(n, n)) * 0.05
    return StateSpace(A, B, C, D), np.diag(b) + skewed @ skewed.T


def by_definition(found: StateSpace, angles: np.ndarray) -> np.ndarray:
    """T/(2 (1 - cos th)) Herm{(1 - e^-jth) H(e^jth)}, H by python-control's frequency response."""
    sys = control.ss(found.A, found.B, found.C, found.D, T)
    H = control.frequency_response(sys, angles / T, squeeze=False).complex.transpose(2, 0, 1)
    X = (1 - np.exp(-1j * angles))[:, None, None] * H
    return (T / (2 * (1 - np.cos(angles))))[:, None, None] * (X + X.conj().transpose(0, 2, 1)) / 2


def test_the_papers_devices_hold_80_newtons_per_metre():
    assert passivity.wall_limit(0.2, 0.005) == pytest.approx(80.0, rel=1e-15)  # 2 b/T
    assert passivity.wall_limit(0.2, 0.005, delay=0.005) == pytest.approx(80.0 / 3, rel=1e-15)
    assert passivity.wall_limit(0.2, 0.005, wall_damping=-0.05) == pytest.approx(60.0, rel=1e-15)
    assert passivity.wall_limit(0.2, 0.005, wall_damping=0.3) == 0.0


@pytest.mark.parametrize("B", [-0.08, 0.0, 0.08])
def test_a_wall_without_delay_needs_its_limit_and_no_more(B):
    K = passivity.wall_limit(0.2, T, wall_damping=B)
    assert passivity.required_damping(backward_wall(K, B), T) == pytest.approx(0.2, rel=1e-12)
    assert passivity.required_damping(lambda z: K + B * (1 - 1 / z) / T, T) == pytest.approx(0.2, rel=1e-9)


@pytest.mark.parametrize("delay", [1, 2, 5])
def test_whole_samples_of_delay_are_exact_unless_the_wall_damps(delay):
    for B in (-0.08, 0.0, 0.08):
        K = passivity.wall_limit(0.2, T, wall_damping=B, delay=delay * T)
        assert passivity.guaranteed_wall_limit(0.2, T, wall_damping=B, delay=delay * T) == pytest.approx(K, rel=1e-6)
        needed = passivity.required_damping(backward_wall(K, B, delay), T)
        if B <= 0.0:  # both terms are worst for slow motion
            assert needed == pytest.approx(0.2, rel=1e-9)
        else:
            assert 0.05 < needed < 0.2 - 1e-3


def between_samples(K: float, B: float, whole: int, part: float, th: np.ndarray) -> np.ndarray:
    """b that a wall needs whose force changes a part of a sample after the reading, from its energy on two steps.

    While the old force f_{k-1-whole} acts the device moves by u (for part T), then by v under f_{k-whole}; the least
    friction takes b (u^2/part + v^2/(1 - part))/T. The smallest b for which [1/part, 1/(1 - part)] b/T + Herm W >= 0.
    """
    z = np.exp(1j * th)
    f = (K + B * (1 - 1 / z) / T) / (z - 1)  # force over u + v
    W = np.empty((len(th), 2, 2), complex)
    W[:, 0, :] = (f * z ** -(whole + 1))[:, None]
    W[:, 1, :] = (f * z**-whole)[:, None]
    scale = np.sqrt(T * np.array([part, 1 - part]))
    form = (W + W.conj().transpose(0, 2, 1)) / 2 * scale[:, None] * scale
    return -np.linalg.eigvalsh(form)[:, 0]


@pytest.mark.parametrize("whole", [0, 1, 3])
@pytest.mark.parametrize("part", [0.1, 0.25, 0.5, 0.8])
def test_a_delay_of_part_of_a_sample_costs_more_than_the_formula(whole, part):
    th = np.linspace(1e-4, np.pi, 4000)
    t = (whole + part) * T
    K = passivity.guaranteed_wall_limit(0.2, T, delay=t)
    assert between_samples(K, 0.0, whole, part, th).max() == pytest.approx(0.2, rel=1e-6)  # the grid starts at 1e-4
    assert between_samples(passivity.wall_limit(0.2, T, delay=t), 0.0, whole, part, th).max() > 0.2
    for B in (-0.07, 0.07):
        K = passivity.guaranteed_wall_limit(0.2, T, wall_damping=B, delay=t)
        assert between_samples(K, B, whole, part, th).max() <= 0.2


def test_the_cost_of_part_of_a_sample_is_largest_at_a_quarter():
    t = np.linspace(0.0, 2.0, 2001) * T
    ratio = [passivity.guaranteed_wall_limit(1.0, T, delay=x) / passivity.wall_limit(1.0, T, delay=x) for x in t]
    assert t[np.argmin(ratio)] == pytest.approx(T / 4)
    assert min(ratio) == pytest.approx(2 * np.sqrt(3) * (2 - np.sqrt(3)), rel=1e-12)  # 0.9282


def test_filtered_damping_needs_what_a_search_in_fifty_digits_finds():
    """K x + B x' with x' through a first-order filter 1/(tau s + 1), by backward differences."""
    K, B, tau = 30.0, 0.4, 0.008

    def H(z):
        s = (1 - 1 / z) / T
        return K + B * s / (1 + tau * s)

    with mpmath.workdps(50):

        def needed(th):
            z = mpmath.expj(th)
            return T / (2 * (1 - mpmath.cos(th))) * mpmath.re((1 - 1 / z) * H(z))

        values = [needed(mpmath.pi * k / 200) for k in range(1, 201)]
        k = values.index(max(values))
        assert k == 199  # at half the sampling rate
        expected = float(values[k])
    assert passivity.required_damping(H, T) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("radius", [0.99, 0.99999])
def test_a_sharp_resonance_is_found_between_the_points_of_any_grid(radius):
    """Height of a peak is about 1/(1 - radius); a plain grid of 4000 points misses all but a trace of the sharper."""
    pole = radius * np.exp(1.2345j)
    A = np.array([[pole.real, pole.imag], [-pole.imag, pole.real]])
    C = np.array([[0.3, 1.0]])
    K = 10.0 - (C @ np.linalg.solve(np.eye(2) - A, [[1.0], [0.0]])).item()
    found = StateSpace(A, np.array([[1.0], [0.0]]), C, np.array([[K]]))
    width = 1 - radius
    th = 1.2345 + np.linspace(-2, 2, 2001) * width
    expected = by_definition(found, th)[:, 0, 0].real.max()
    # between points 2e-3 widths apart a peak of one width rises by 1e-6 of its height
    assert passivity.required_damping((A, found.B, C, found.D), T) == pytest.approx(expected, rel=1e-6)
    assert expected > 1e-3 / width * 0.5 * T


@pytest.mark.parametrize("case", CASES)
def test_grid_pencil_and_energy_agree_on_several_channels(case):
    found, B = random_display(case)
    n = found.channels
    margin = passivity.damping_margin(found, B, T)
    scale = float(np.linalg.norm(B, 2)) + T * float(np.linalg.norm(found.D, 2))
    # frequencies, adaptively; and python-control's responses on a fixed grid, from above
    assert -worst_on_grid(found, B, T)[0] == pytest.approx(margin, abs=1e-9 * scale)
    fixed = np.linalg.eigvalsh(B - by_definition(found, np.linspace(1e-3, np.pi, 400)))[:, 0].min()
    assert margin - 1e-9 * scale <= fixed <= margin + 2e-3 * scale
    # the pencil's eigenvalues alone, on either side
    for shift, holds in ((1e-6, True), (-1e-6, False)):
        shifted = PositiveReal(found, B + (shift * scale - margin) * np.eye(n), T)
        assert (shifted.lack(np.array([np.pi]))[0] < 0.0 and not len(shifted.crossings(0.0, near=1e-9))) == holds
    # energy: never below, and the rest falls by four when the time doubles, to a tenth of what the doubling gained
    near, far = (passivity.worst_motion(found, B, T, N).margin for N in (60, 120))
    assert margin - 1e-9 * scale <= far <= near
    assert (4 * far - near) / 3 == pytest.approx(margin, abs=0.1 * (near - far) + 1e-9 * scale)


def test_the_worst_motion_draws_the_energy_that_it_claims():
    found, B = random_display(3)
    lacking = passivity.damping_margin(found, B, T) + 0.05
    worst = passivity.worst_motion(found, B - lacking * np.eye(found.channels), T, 80)
    assert worst.margin < 0.0
    x, state, energy = np.zeros(found.channels), np.zeros(found.states), 0.0
    for step in worst.steps:
        f = found.C @ state + found.D @ x
        energy += f @ step + step @ (B - lacking * np.eye(found.channels)) @ step / T
        state, x = found.A @ state + found.B @ x, x + step
    assert energy == pytest.approx(worst.energy, abs=1e-9 * abs(worst.energy))
    assert worst.energy == pytest.approx(worst.margin / T)


@pytest.mark.parametrize("radius", [0.9, 0.99, 0.9999])
@pytest.mark.parametrize("gain", [-20.0, 20.0])
def test_a_function_with_slow_poles_is_as_exact_as_its_matrices(radius, gain):
    """Time constants of up to 10000 samples: what slow motion asks for is taken between rounding and the pole."""
    coupling = np.array([[1.0, 0.4], [-0.4, 0.5]])  # at rest what is skew in it cancels
    A, B, C = radius * np.eye(2), np.eye(2), gain * (1 - radius) * coupling
    parts = (A, B, C, 50.0 * np.eye(2) - gain * (coupling - coupling.T) / 2)
    expected = passivity.required_damping(parts, T)
    # one channel, X(z) = -gain/(z - radius): T/2 H(1) - T Re X is extremal at rest or at half the rate
    ends = [T / 2 * (50.0 + gain) + T * gain / (z - radius) for z in (1.0, -1.0)]
    alone = (radius, 1.0, gain * (1 - radius), 50.0)
    assert passivity.required_damping(alone, T) == pytest.approx(max(ends), rel=1e-9)
    for display_, value in ((parts, expected), (alone, max(ends))):
        a, b, c, d = map(np.atleast_2d, display_)

        def H(z, a=a, b=b, c=c, d=d):
            return c @ np.linalg.solve(z * np.eye(len(a)) - a, b) + d

        assert passivity.required_damping(H, T) == pytest.approx(value, rel=1e-9)


def test_every_form_of_a_display_gives_one_answer():
    found, _ = random_display(0)
    parts = (found.A, found.B, found.C, found.D)
    expected = passivity.required_damping(parts, T)
    sys = control.ss(*parts, T)
    assert passivity.required_damping(sys, T) == expected
    assert passivity.required_damping(dlti(*parts, dt=T), T) == expected
    assert passivity.required_damping(lambda z: sys(z), T) == pytest.approx(expected, rel=1e-9)
    one = control.ss(0.5, 1.0, 2.0, 30.0, T)
    expected = passivity.required_damping(one, T)
    num, den = [30.0, -13.0], [1.0, -0.5]  # 2/(z - 0.5) + 30
    assert passivity.required_damping(dlti(num, den, dt=T), T) == pytest.approx(expected, rel=1e-12)
    assert passivity.required_damping(control.tf(num, den, T), T) == pytest.approx(expected, rel=1e-9)
    assert passivity.required_damping(80.0, T) == pytest.approx(0.2, rel=1e-15)
    assert passivity.required_damping(np.diag([80.0, 40.0]), T) == pytest.approx(0.2, rel=1e-15)


@pytest.mark.parametrize(
    "H",
    [
        lambda z: -5.0,
        lambda z: np.array([[50.0, 1.0], [-1.0, 50.0]]),
        np.array([[50.0, 1.0], [-1.0, 50.0]]),
        (1.01, 1.0, 1.0, 5.0),
        (1.0, 1.0, 1.0, 5.0),
        (0.5, 1.0, -4.0, 7.0),
    ],
    ids=["negative", "circling", "circling-matrix", "unstable", "integrating", "negative-at-rest"],
)
def test_no_damping_is_enough(H):
    """Motion as slow as one likes, where friction takes next to none, creates energy."""
    assert passivity.required_damping(H, T) == np.inf
    assert passivity.damping_margin(H, 1.0, T) == -np.inf


def test_a_negative_stiffness_shows_in_the_energy_and_not_in_the_frequencies():
    """No damping is needed at any frequency with -5 N/m: that is why H(1) is looked at by itself."""
    slow = passivity.worst_motion(-5.0, 0.2, T, 50)
    assert passivity.worst_motion(-5.0, 0.2, T, 5).energy > 0.0 > passivity.worst_motion(-5.0, 0.2, T, 100).energy
    assert slow.energy < passivity.worst_motion(-5.0, 0.2, T, 5).energy


@pytest.mark.parametrize(
    ("H", "name"),
    [
        (control.ss(-1.0, 1.0, 1.0, 0.0), "H"),
        (lti([1.0], [1.0, 1.0]), "H"),
        (control.ss(0.5, 1.0, 1.0, 0.0, 0.001), "H"),
        ((np.eye(2), np.eye(2), np.eye(2)), "H"),
        ((np.eye(2), np.ones((2, 1)), np.ones((2, 2)), 1.0), "H"),
        (np.ones((2, 3)), "H"),
        (np.nan, "H"),
        (lambda z: np.ones((2, 3)), "H"),
        ("stiff", "H"),
    ],
)
def test_what_is_no_display_is_refused(H, name):
    with pytest.raises(InputError) as caught:
        passivity.required_damping(H, T)
    assert caught.value.name == name


def test_numbers_that_make_no_sense_are_refused():
    for bad in ({"period": 0.0}, {"damping": -1.0}, {"delay": -1e-3}, {"wall_damping": np.nan}):
        arguments = {"damping": 0.2, "period": T} | bad
        for limit in (passivity.wall_limit, passivity.guaranteed_wall_limit):
            with pytest.raises(InputError) as caught:
                limit(**arguments)
            assert caught.value.name in bad
    with pytest.raises(InputError):
        passivity.required_damping(80.0, -T)
    with pytest.raises(InputError):
        passivity.damping_margin(80.0, [0.1, 0.2], T)
    with pytest.raises(InputError):
        passivity.damping_margin(np.eye(2), [[0.1, 0.2], [0.0, 0.1]], T)
    with pytest.raises(InputError):
        passivity.worst_motion(lambda z: 1.0, 0.2, T, 10)
    with pytest.raises(InputError):
        passivity.worst_motion(1.0, 0.2, T, 0)


def test_units_scale():
    """In grams, millimetres and milliseconds the same display requires the same damping in their unit."""
    found, B = random_display(7)
    scaled = StateSpace(found.A, found.B, 1e-3 * found.C, 1e-3 * found.D)  # [N/mm]
    assert passivity.damping_margin(scaled, 1e-3 * B, T) == pytest.approx(
        1e-3 * passivity.damping_margin(found, B, T), rel=1e-9
    )
    assert display(found, T).channels == found.channels
