"""Compliant fingertips in the certificate: linear compliances along the normals; limits against runs; rests by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import graspfx as gx
from graspfx.analysis.grasp_stiffness import springs_in_series
from graspfx.certificate.certify import certificates
from graspfx.certificate.limit_sweep import limits_of_scene
from graspfx.certificate.linearise import linearise

KEP, KIP, HAND, SQUEEZE = 300.0, 800.0, 400.0, 0.006
PADS = np.array([2e4, 7e4])
HALF = 0.02


def pinch(**changes: Any) -> gx.Scene:
    """Two fingers squeeze a box in the plane, free between them, hands SQUEEZE deep in its sides; pads of two kinds."""
    scene = gx.Scene(
        dimensions=2,
        period=0.002,
        duration=1.2,
        object={
            "mass": 0.1,
            "viscosity": 0.5,
            "rotational_viscosity": 2e-4,
            "shape": {"kind": "box", "size": [2 * HALF, 0.05]},
            "integrator": "semi-implicit",
        },
        coupling={"external": {"stiffness": KEP}, "internal": {"stiffness": KIP}, "friction": "stick"},
        finger=[
            {
                "start": [side * HALF, 0.0],
                "pad": {"kind": "hertz", "stiffness": k},
                "device": {"name": "simulated", "mass": 0.1, "damping": 0.5},
                "hand": {"stiffness": HAND, "damping": 2.0, "squeeze": SQUEEZE},
            }
            for side, k in zip((-1.0, 1.0), PADS.tolist(), strict=True)
        ],
    )
    return scene.replace({key.replace("__", "."): value for key, value in changes.items()})


def pressed(kip: float = KIP) -> float:
    """The force that solves s = f/k_h + f/kip + mean of (f/k)^(2/3) [N]."""

    def left(f: float) -> float:
        return f / HAND + f / kip + float(((f / PADS) ** (2 / 3)).mean()) - SQUEEZE

    return float(brentq(left, 0.0, 10.0, xtol=1e-15))


def test_the_rest_is_the_scalar_equation_of_springs_in_series() -> None:
    """Fingers at rest: each f/k_h short of its hand, the box moved by half of what the depths differ by; to 1e-9 m."""
    rest = linearise(pinch())
    assert rest.at == ("squeezed",)
    f = pressed()
    depth = (f / PADS) ** (2 / 3) + f / KIP
    inside = np.abs(rest.contacts[:, 0]) - HALF
    shift = 0.5 * (depth[1] - depth[0])
    np.testing.assert_allclose(rest.contacts[:, 0], [shift - HALF, shift + HALF], rtol=0.0, atol=1e-9)
    assert inside.sum() == pytest.approx(0.0, abs=1e-12)


def test_at_rest_a_pad_is_a_linear_compliance_along_the_normal() -> None:
    """(K^-1 + C)^-1, C = 2/3 k^(-2/3) f^(-1/3) along x, by numpy: 1e-7; with the run's own quotients: 2e-5 of KIP."""
    soft = linearise(pinch())
    rigid = linearise(pinch(finger__0__pad=None, finger__1__pad=None))
    C = np.zeros(4)
    C[[0, 2]] = 2.0 / 3.0 * PADS ** (-2 / 3) * pressed() ** (-1 / 3)
    law = gx.Coupling(external=gx.Impedance(KEP), internal=gx.Impedance(KIP))
    K = law.stiffness(gx.Grasp(soft.contacts).split())
    expected = np.linalg.inv(np.linalg.inv(K) + np.diag(C))
    np.testing.assert_allclose(soft.linear.stiffness, expected, rtol=0.0, atol=1e-7 * KIP)
    assert np.abs(rigid.linear.stiffness - expected).max() > 0.2 * KIP
    # what difference quotients of whole samples add to it is the preload's: none along the line through both fingers
    assert soft.linear.preload is None or np.abs(soft.linear.preload[0]).max() < HAND
    start = linearise(pinch(), "start")
    assert np.abs(start.linear.stiffness[[0, 2]]).max() < 1e-9
    assert any("unloaded pads have no stiffness along their normals" in each for each in start.assumed)


def test_springs_in_series_of_any_stiffness() -> None:
    """Against inverses; with a singular K as its limit; with none along a direction nothing is left there."""
    rng = np.random.default_rng(2)
    A = rng.normal(size=(6, 6))
    K, N, s = A @ A.T, np.linalg.qr(rng.normal(size=(6, 2)))[0], np.array([3.0, 0.7])
    expected = np.linalg.inv(np.linalg.inv(K) + N @ np.diag(1 / s) @ N.T)
    np.testing.assert_allclose(springs_in_series(K, N, s), expected, rtol=0.0, atol=1e-12 * np.abs(K).max())
    singular = K - np.linalg.eigh(K)[0][0] * np.outer(*[np.linalg.eigh(K)[1][:, 0]] * 2)
    near = springs_in_series(singular + 1e-9 * np.eye(6), N, s)
    np.testing.assert_allclose(springs_in_series(singular, N, s), near, rtol=0.0, atol=1e-7)
    assert np.abs(springs_in_series(K, N, np.zeros(2)) @ N).max() < 1e-12 * np.abs(K).max()
    assert not springs_in_series(np.zeros((6, 6)), N, np.zeros(2)).any()


def sway(scene: gx.Scene) -> float:
    """The rate per sample at which the box swings aside or back after a push, from the last two thirds of the run."""
    rec = gx.run(scene)
    assert rec.touching.all()
    moved = (np.diff(rec.object_position, axis=0) ** 2).sum(axis=1)
    part = len(moved) // 3
    return 0.5 * float(np.log(moved[-part:].sum() / moved[-2 * part : -part].sum())) / part


def test_a_run_grows_and_decays_as_the_certificate_says() -> None:
    """5 % on either side of the largest kep, along x, where the pads are; without them 5 % below grows too.

    The box starts at its rest with a push of 0.1 mm/s; at 0.8 and 1.25 of the limit the rate of its swing to 3 %.
    """
    free = {"object__free": [True, False, False]}
    depth = (pressed() / PADS) ** (2 / 3) + pressed() / KIP
    shift = 0.5 * (depth[1] - depth[0])
    at_rest: dict[str, Any] = {"object__position": [shift, 0.0], "object__velocity": [1e-4, 0.0]} | free
    for i, side in enumerate((-1.0, 1.0)):
        start = [shift + side * (HALF - depth[i]), 0.0]
        at_rest |= {f"finger__{i}__start": start, f"finger__{i}__hand__rest": [side * (HALF - SQUEEZE), 0.0]}
        at_rest |= {f"finger__{i}__hand__squeeze": 0.0}
    scene = pinch(**at_rest)
    [certificate] = certificates(scene)
    [limit] = [row for row in certificate.limits if row.mode == "external"]
    assert not limit.exact and limit.limit > 1.5 * KEP
    for factor, grows in ((0.8, False), (0.95, False), (1.05, True), (1.25, True)):
        changed = scene.replace({"coupling.external.stiffness": factor * limit.limit})
        predicted = float(np.log(gx.stability.spectral_radius(changed)))
        assert bool(predicted > 0.0) is grows
        measured = sway(changed)
        assert bool(measured > 0.0) is grows
        if abs(factor - 1.0) > 0.1:  # nearer, two swings of nearly one rate take turns for longer than the run
            assert measured == pytest.approx(predicted, rel=0.03)
    rigid = scene.replace({"finger.0.pad": None, "finger.1.pad": None})
    assert gx.stability.spectral_radius(rigid.replace({"coupling.external.stiffness": 0.95 * limit.limit})) > 1.0


def test_limits_say_that_pads_stand_in_series() -> None:
    """More room than without, internal too; passivity is not judged; the swept limits are the certificate's."""
    [soft] = certificates(pinch())
    [rigid] = certificates(pinch(finger__0__pad=None, finger__1__pad=None))
    assert soft.why_not_passive == "fingertips are compliant"
    limits = [{row.mode: row.limit for row in each.limits} for each in (soft, rigid)]
    assert limits[0]["internal"] > limits[1]["internal"] and limits[0]["external"] > limits[1]["external"]
    swept = limits_of_scene(pinch())
    assert float(swept.external) == pytest.approx(limits[0]["external"], rel=1e-9)
    assert float(swept.conventional) > float(
        limits_of_scene(pinch(finger__0__pad=None, finger__1__pad=None)).conventional
    )
