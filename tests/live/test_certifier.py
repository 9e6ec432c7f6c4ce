"""Verdicts on a scene with other values: in full those of the certificate, and provisionally close to them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest

import graspfx as gx
from graspfx.live.certifier import Certifier, Verdict

KEP, KIP, KED, KID = (
    f"coupling.{share}.{quantity}" for share, quantity in (
        ("external", "stiffness"), ("internal", "stiffness"), ("external", "damping"), ("internal", "damping"),
    )
)  # fmt: skip


def full(certifier: Certifier, values: Mapping[str, Any]) -> Verdict:
    """Give the last of a certifier's verdicts."""
    *others, last = certifier.stages(values)
    assert all(verdict.is_provisional for verdict in others)
    return last


@pytest.mark.parametrize("name", ["paper-waving", "sphere-three-fingers", "two-objects"])
def test_the_full_verdict_is_the_certificate(name: str) -> None:
    scene = gx.load(name)
    values = {KIP: 1.3 * float(scene.coupling.internal.stiffness)}  # type: ignore[arg-type]
    verdict = full(Certifier(scene), values)
    certificates = gx.certify(scene.replace(values))
    assert (verdict.is_stable, verdict.is_provisional, verdict.error) == (certificates.stable, False, "")
    assert verdict.spectral_radius == max(each.spectral_radius for each in certificates)
    for certificate in certificates:
        limits = {row.mode: row for row in certificate.limits}
        rows = [row for row in verdict.rows if row.name == certificate.object]
        for row in rows:
            twin = limits.pop(row.mode)
            assert (row.gain, row.limit, row.margin) == (twin.gain, twin.limit, twin.margin)
        pushing = [row.margin for row in rows if not row.is_mode]
        assert all(mode.startswith("pushing") for mode in limits)
        assert all(limit.margin >= min(pushing) for limit in limits.values())


@pytest.mark.parametrize(
    ("name", "changes", "error"),
    [
        ("paper-waving", {KEP: 2.5}, 1e-9),
        ("sphere-three-fingers", {KEP: 0.4}, 1e-9),
        ("sphere-three-fingers", {KEP: 1.7, KED: 3.0, KID: 0.5}, 1e-9),
        ("sphere-three-fingers", {KIP: 1.5}, 1e-3),
        ("mug", {KEP: 2.2, KID: 2.0}, 1e-6),
        ("mug", {KIP: 0.7}, 1e-4),
        ("mug", {"object.viscosity": 3.0, "object.rotational_viscosity": 2.0}, 1e-6),
        ("knob", {"object.mass": 1.5}, 1e-9),
        ("soft-pads", {KEP: 1.5, KED: 2.0}, 1e-4),
    ],
)
def test_a_provisional_radius_is_the_full_one_to_stated_digits(
    name: str, changes: dict[str, float], error: float
) -> None:
    """The external gains, damping and viscosity leave the rest as it is; the internal stiffness changes the squeeze."""
    scene = gx.load(name)
    certifier = Certifier(scene)
    assert certifier.provisional({}) is None
    full(certifier, {})
    values = {key: factor * _value(scene, key) for key, factor in changes.items()}
    before = certifier.provisional(values)
    assert before is not None
    assert before.is_provisional
    after = full(certifier, values)
    assert before.spectral_radius == pytest.approx(after.spectral_radius, abs=error)
    assert before.is_stable == after.is_stable
    gains = [
        [row.gain for row in verdict.rows if row.mode.startswith(("internal", "external"))]
        for verdict in (before, after)
    ]
    assert gains[0] == pytest.approx(gains[1])


def _value(scene: gx.Scene, key: str) -> float:
    part: Any = scene
    for name in key.split("."):
        part = getattr(part, name)
        part = part[0] if isinstance(part, tuple) else part
    return float(part)


@pytest.mark.parametrize(("name", "lead", "after"), [("paper-waving", 2.0, 20.0), ("sphere-three-fingers", 0.5, 4.0)])
@pytest.mark.parametrize("key", [KEP, KIP])
def test_runs_agree(name: str, lead: float, after: float, key: str) -> None:
    """A run whose gain is 10 % beyond its limit from some tick on shakes ever more, 10 % below it calms down."""
    scene = gx.load(name, {"duration": 100.0})
    certifier = Certifier(scene)
    mode = key.split(".")[1]
    limit = next(row.limit for row in full(certifier, {}).rows if row.mode == mode)
    for factor in (0.9, 1.1):
        values = {key: factor * limit}
        first = certifier.provisional(values)
        assert first is not None
        with gx.open(scene, live=[key]) as session:
            session.step(round(lead / scene.period))
            session.set(values)
            session.step(round(after / scene.period))
            growth = session.recording.summary()["growth"]
        assert first.is_stable == full(certifier, values).is_stable == (factor < 1.0)
        assert [each["mode"].split()[0] for each in growth] == ([] if factor < 1.0 else [mode])


def test_what_cannot_be_certified_is_a_text() -> None:
    certifier = Certifier(gx.load("reference-1dof"))
    assert full(certifier, {}).is_stable
    bad = full(certifier, {KEP: -1.0})
    assert (bad.is_stable, bad.is_provisional) == (None, False)
    assert "coupling.external.stiffness: expected no less than 0" in bad.error
    assert bad.text.startswith("not judged: scenes/reference-1dof.toml")
    unknown = full(certifier, {"coupling.middle.stiffness": 1.0})
    assert "middle" in unknown.error
    assert full(certifier, {KEP: 20.0}).is_stable


def test_values_that_say_nothing_of_the_last_loop_have_no_provisional_verdict() -> None:
    scene = gx.load("sphere-three-fingers")
    certifier = Certifier(scene)
    full(certifier, {})
    for values in ({KEP: [[1.0, 0.0, 0.0]] * 3}, {"coupling.fade": [0.01, 0.02]}, {"hand.right.stiffness": 100.0}):
        assert certifier.provisional(values) is None
    friction = certifier.provisional({"coupling.friction": 0.3})
    assert friction is not None  # contacts stick, whatever their friction is
    assert friction.spectral_radius == full(certifier, {}).spectral_radius


def test_values_of_which_no_loop_can_be_made_have_no_provisional_verdict() -> None:
    certifier = Certifier(gx.load("reference-1dof"))
    full(certifier, {})
    assert certifier.provisional({"object.mass": 0.2}) is not None
    assert certifier.provisional({"object.mass": 5e-324}) is None


def test_the_squeeze_of_stiffer_contacts_is_that_of_springs_in_series() -> None:
    """Nine tenths of what a stiffer squeeze does to the loop are in the provisional radius."""
    scene = gx.load("sphere-three-fingers", {"coupling.friction": 3.0})
    certifier = Certifier(scene)
    radius = full(certifier, {}).spectral_radius
    values = {KIP: 4.0 * _value(scene, KIP)}
    first = certifier.provisional(values)
    assert first is not None
    change = full(certifier, values).spectral_radius - radius
    assert abs(change) > 1e-3
    assert first.spectral_radius - radius == pytest.approx(change, rel=0.1)
    assert not math.isnan(first.rows[0].margin)
