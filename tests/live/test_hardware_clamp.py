"""New gains on their way to hardware: what is certified passes, the rest is clamped or refused, and that is said."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError
from graspfx.live import hardware_clamp
from graspfx.live.certifier import Certifier, Verdict
from graspfx.live.hardware_clamp import INSIDE, SHARE, HardwareClamp, Outcome, lower, shortfall
from graspfx.live.live_run import LiveRun
from graspfx.live.margins import Margins
from tests.support.servo_wires import BUSY, PATIENT, PRESSED, board, boards_scene, settled
from tests.support.waiting import wait_until

KEP, KIP, KID = "coupling.external.stiffness", "coupling.internal.stiffness", "coupling.internal.damping"
PATIENCE = 120.0  # [s], of a busy machine
MECHANICS = {"finger.*.device.measures": {"mass": 0.1, "friction": 1.5}}


class Recorder:
    """A run that takes every value, unless it is told to fail, and lists them."""

    def __init__(self) -> None:
        self.values: list[Mapping[str, Any]] = []
        self.error: Exception | None = None

    def set(self, values: Mapping[str, Any]) -> Future[None]:
        future: Future[None] = Future()
        self.values.append(dict(values))
        if self.error is None:
            future.set_result(None)
        else:
            future.set_exception(self.error)
        return future


class Gate:
    """A clamp before a run that takes every value."""

    def __init__(self, margins: Margins) -> None:
        self.run = Recorder()
        self.clamp = HardwareClamp(lambda values: self.run.set(values), margins)

    def order(self, values: Mapping[str, Any]) -> Outcome:
        return self.clamp.set(values).result(PATIENCE)


@pytest.fixture
def gate() -> Iterator[Gate]:
    with Margins(gx.load("sphere-three-fingers")) as margins:
        gate = Gate(margins)
        yield gate
        gate.clamp.close()


def verdict_of(values: Mapping[str, Any], scene: str = "sphere-three-fingers") -> Verdict:
    return list(Certifier(gx.load(scene)).stages(values))[-1]


@pytest.mark.parametrize("scene", ["sphere-three-fingers", "mug", "paper-waving"])
@pytest.mark.parametrize("key", [KEP, KIP])
def test_what_is_beyond_a_limit_is_lowered_to_a_share_of_it(scene: str, key: str) -> None:
    present = verdict_of({}, scene)
    values: dict[str, Any] = {key: 2e4}
    for _ in range(hardware_clamp.ROUNDS):
        verdict = verdict_of(values, scene)
        if not shortfall(verdict, present):
            break
        less = lower(values, verdict, present)
        assert less is not None
        assert less[key] < values[key]
        values = less
    assert verdict.is_stable
    room = min(
        row.margin / min(1.0 / SHARE, before.margin)
        for row in verdict.rows
        for before in present.rows
        if row.mode == before.mode or not (row.is_mode or before.is_mode)
    )
    assert 1.0 - 1e-6 <= room < 1.0 + 5.0 * INSIDE  # not less, and not much more than was asked for


def test_a_certified_value_passes_as_it_is(gate: Gate) -> None:
    assert gate.order({KEP: 300.0}) == Outcome({KEP: 300.0})
    assert gate.order({KEP: 150.0, KIP: 350.0}).text == ""
    assert gate.run.values == [{KEP: 300.0}, {KEP: 150.0, KIP: 350.0}]


def test_a_value_beyond_its_limit_is_clamped_and_that_is_said(gate: Gate) -> None:
    order = gate.order({KEP: 900.0})
    [values] = gate.run.values
    assert order.values == values
    limit = next(row.limit for row in verdict_of(values).rows if row.mode == "external")
    assert values[KEP] == pytest.approx(SHARE * limit, rel=3.0 * INSIDE)
    assert values[KEP] <= SHARE * limit
    assert order.text.startswith(f"requested {KEP} = 900; set {KEP} = {values[KEP]:.5g}, at most 0.9 of each limit")
    assert "margin 0.6" in order.text
    again = gate.order({KEP: 1000.0})  # it is at its limit already: nothing is set, and nothing is lowered
    assert not again.values
    assert again.text.startswith(f"refused: {KEP} = 1000: external")
    assert len(gate.run.values) == 1
    assert gate.order({KEP: 200.0}).text == ""


def test_what_no_smaller_stiffness_mends_is_refused(gate: Gate) -> None:
    order = gate.order({KID: 1000.0})
    assert not order.values
    assert not gate.run.values
    assert order.text.startswith(f"refused: {KID} = 1000: ")
    assert "margin" in order.text or "not stable" in order.text


def test_without_a_certificate_nothing_passes(gate: Gate) -> None:
    order = gate.order({KEP: -1.0})
    assert not order.values
    assert "there is no certificate for these values: " in order.text
    assert "expected no less than 0" in order.text
    assert gate.order({KEP: 210.0}).values == {KEP: 210.0}  # the next one is judged by itself
    assert gate.run.values == [{KEP: 210.0}]


def test_a_device_that_does_not_tell_its_mass_has_no_certificate() -> None:
    with board() as wire, Margins(boards_scene([wire], PATIENT)) as margins:
        gate = Gate(margins)
        order = gate.order({KIP: 10.0})
        gate.clamp.close()
    assert not order.values
    assert "there is no certificate for the present values: " in order.text
    assert "a device that reports its mass and friction" in order.text
    assert not gate.run.values


def test_orders_that_wait_become_one(gate: Gate) -> None:
    gate.order({KIP: 390.0})
    held, free = threading.Event(), threading.Event()
    inner = gate.run.set

    def slowly(values: Mapping[str, Any]) -> Future[None]:
        held.set()
        free.wait(PATIENCE)
        return inner(values)

    gate.run.set = slowly  # type: ignore[method-assign]
    first = gate.clamp.set({KEP: 210.0})
    assert held.wait(PATIENCE)
    futures = [gate.clamp.set({KEP: 220.0 + k} if k else {KIP: 410.0}) for k in range(20)]
    free.set()
    assert first.result(PATIENCE).values == {KEP: 210.0}
    last = Outcome({KIP: 410.0, KEP: 239.0})
    assert [future.result(PATIENCE) for future in futures] == [last] * 20
    assert gate.run.values == [{KIP: 390.0}, {KEP: 210.0}, last.values]


def test_what_a_run_refuses_is_raised_and_counts_as_not_set(gate: Gate) -> None:
    gate.run.error = InputError("session", 1, "a session that is running")
    with pytest.raises(InputError, match="a session that is running"):
        gate.order({KEP: 300.0})
    gate.run.error = None
    assert gate.order({KIP: 380.0}).values == {KIP: 380.0}
    gate.clamp.close()
    late = gate.clamp.set({KEP: 220.0}).result(PATIENCE)
    assert late.text.endswith("the run has ended")


def test_a_verdict_is_on_what_the_run_has_after_it_refused_a_value(gate: Gate) -> None:
    gate.run.error = InputError("run", "closed", "a run that is running")
    with pytest.raises(InputError):
        gate.order({KEP: 300.0})
    margins = gate.clamp._margins
    wait_until(lambda: (verdict := margins.latest()) is not None and not verdict.values)


def test_the_end_of_the_certificates_is_the_end_of_changes() -> None:
    margins = Margins(gx.load("sphere-three-fingers"))
    gate = Gate(margins)
    assert gate.order({KEP: 210.0}).values
    margins.close()
    assert not gate.order({KEP: 220.0}).values
    gate.clamp.close()


def test_a_board_gets_what_is_certified_and_its_recording_has_it(tmp_path: Path) -> None:
    """An emulated 2DIY is pressed into its ball; its gain goes up, is clamped, comes down, and is refused for good."""
    with board() as wire:
        scene = boards_scene([wire], PATIENT, **MECHANICS, **BUSY)
        limit = next(row.limit for row in list(Certifier(scene).stages({}))[-1].rows if row.mode == "internal")
        assert 70.0 < SHARE * limit < 1000.0

        def begin() -> LiveRun:
            return LiveRun(scene, live=[KIP, KID], out=tmp_path / "run")

        with settled(begin) as run, Margins(scene) as margins:
            wire.place(np.array(PRESSED))
            wait_until(lambda: bool(np.abs(wire.torque).max() > 1e-3))
            clamp = HardwareClamp(run.set, margins)
            orders = [
                clamp.set(values).result(PATIENCE)
                for values in ({KIP: 75.0}, {KIP: 1000.0}, {KIP: 40.0}, {KID: 500.0}, {KIP: -3.0})
            ]
            clamp.close()
            at_the_end = run.scene.coupling.internal
        file = tmp_path / "run" / "recording.h5"
    assert [bool(order.values) for order in orders] == [True, True, True, False, False]
    highest = orders[1].values[KIP]
    assert SHARE * limit * (1.0 - 2.0 * INSIDE) < highest < SHARE * limit
    assert (at_the_end.stiffness, at_the_end.damping) == (40.0, 0.0)
    recording = gx.Recording.load(file)
    assert [(change.key, change.value) for change in recording.changes] == [(KIP, 75.0), (KIP, highest), (KIP, 40.0)]
    again = gx.replay(recording)
    for name in ("finger_force", "displayed_force", "touching"):
        assert np.array_equal(getattr(again, name), getattr(recording, name)), name
