"""Each figure of a summary against a run whose figure is known in closed form."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from graspfx.loop.columns import RunFault
from graspfx.recording.header import Outcome
from graspfx.recording.record import Recording
from graspfx.recording.summary import Sizes
from graspfx.recording.vibration import vibration
from graspfx.show.summary_table import ROWS, Column, columns, lines, print_summary
from tests.support.recordings import PERIOD, layout, recording, waving

T = np.arange(2000) * PERIOD


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize("k", [30.0, 70.0])
def test_a_wave_in_closed_form(n: int, k: float) -> None:
    depth = 0.2 / k  # each finger towards the centre; and all of them 3 mm ahead, which is no deformation
    found = waving(k, n=n).summary()
    assert found["internal_deformation_mean"] == pytest.approx(depth, rel=1e-12)
    assert found["internal_deformation_peak"] == pytest.approx(depth, rel=1e-12)
    assert found["invasion_mean"] == found["invasion_peak"] == pytest.approx(depth, rel=1e-12)
    assert found["tracking_error"] == pytest.approx(0.003, rel=1e-12)
    assert found["touching"] == [1.0] * n
    apart = pytest.approx(0.05 - 2 * depth, rel=1e-12) if n == 2 else None
    assert found["finger_distance_mean"] == apart
    assert found["finger_distance_least"] == apart
    # finger 0 stands at -x: its force along x is k (depth + 3 mm), without the pushes of the others
    assert found["peak_force"][0] == pytest.approx(k * (depth + 0.003), rel=1e-12)
    assert (found["ticks"], found["duration"]) == (2000, 10.0)
    assert found["ticks_per_second"] == pytest.approx(1e4)
    assert found["tick_cost"] == pytest.approx(100.0)


def squeeze(e: np.ndarray, touching: np.ndarray) -> list[float | None]:
    """Peak squeeze of a run of one tick for each row of displacements (N, n, d); None where there is none."""
    made = layout(e.shape[2], e.shape[1])
    columns = {"finger_position": e, "touching": touching}
    peaks = []
    for k in range(len(e)):
        found = recording({name: values[k : k + 1] for name, values in columns.items()}, made).summary()
        peaks.append(found["internal_deformation_peak"])
    return peaks


def test_deformation_counts_only_fingers_that_touch_and_only_when_two_do() -> None:
    e = np.array([[[0.001], [-0.003]], [[0.001], [-0.003]], [[0.004], [0.0]]])
    touching = np.array([[True, True], [True, False], [True, True]])
    # e - mean e = +-2 mm in both ticks that count; a shift of both fingers does not
    assert squeeze(e, touching) == pytest.approx([0.002, 0.0, 0.002])
    assert squeeze(e, np.ones((3, 2))) == pytest.approx([0.002, 0.002, 0.002])


def test_deformation_is_the_residual_of_the_mean_for_three() -> None:
    e = np.random.default_rng(2).normal(size=(10, 3, 2))
    P = np.kron(np.full((3, 3), 1.0 / 3.0), np.eye(2))  # of a grasp whose rotation is locked
    residual = e.reshape(10, 6) @ (np.eye(6) - P)
    expected = np.linalg.norm(residual, axis=1) / np.sqrt(3.0)
    assert squeeze(e, np.ones((10, 3))) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("bad", [None, np.nan, np.inf])
def test_sizes_in_blocks_are_those_of_all(bad: float | None) -> None:
    rng = np.random.default_rng(4)
    sizes, counts = rng.random((3, 300)), rng.random((3, 300)) > 0.4
    if bad is not None:
        sizes[1, 7], counts[1, 7] = bad, True
    some, every = Sizes(3), Sizes(3)
    for first, stop in ((0, 120), (120, 300)):
        every.add(sizes[:, first:stop])
        some.add(sizes[:, first:stop], counts[:, first:stop])
    assert (every.count, some.count) == (900, counts.sum())
    assert every.peaks == pytest.approx(sizes.max(axis=1).tolist(), nan_ok=True)
    assert some.peaks == pytest.approx(np.where(counts, sizes, -1.0).max(axis=1).tolist(), nan_ok=True)
    assert every.mean == pytest.approx(sizes.mean(), rel=1e-13, nan_ok=True)
    assert some.mean == pytest.approx(sizes[counts].mean(), rel=1e-13, nan_ok=True)
    assert Sizes(2).peaks == [None, None] and Sizes().mean is Sizes().peak is None


@pytest.mark.parametrize(("frequency", "gain"), [(0.5, 0.0), (1.0, 0.0), (5.0, 0.5), (20.0, 1.0), (40.0, 1.0)])
def test_vibration_of_a_sine(frequency: float, gain: float) -> None:
    # a sine of 1 mm has an RMS of 1/sqrt(2) mm, and passes by 1/(1 + (5/f)^8)
    assert 1.0 / (1.0 + (5.0 / frequency) ** 8) == pytest.approx(gain, abs=2e-5)
    signal = 1e-3 * np.sin(2.0 * np.pi * frequency * T + 0.3)[:, None, None]
    assert vibration(signal, PERIOD) == pytest.approx(1e-3 / np.sqrt(2.0) * gain, rel=0.02, abs=1e-6)  # ends: 1.5 %


@pytest.mark.parametrize("period", [0.01, 0.005, 0.001, 0.00025])
def test_vibration_finds_a_tremor_in_a_wave_at_any_rate(period: float) -> None:
    t = np.arange(round(10.0 / period)) * period
    signal = np.zeros((len(t), 2, 2))
    signal[:, :, 0] = (0.05 * np.sin(np.pi * t + 0.7))[:, None]
    signal[:, 0, 1] = 1e-5 * np.sin(2 * np.pi * 20.0 * t)  # at one of two fingers: an RMS of 1e-5 / 2 over both
    assert vibration(signal, period) == pytest.approx(5e-6, rel=0.01)


def test_vibration_is_blind_to_a_cubic() -> None:
    # fourth differences of a cubic are zero: what is left is rounding, 1e-16 of 1 m, times q^(1/2) = 1600
    assert vibration(np.array((T - 3.0)[:, None, None] ** 3 / 343.0), PERIOD) == pytest.approx(0.0, abs=1e-11)


def test_vibration_is_what_whittakers_smoother_leaves() -> None:
    x = np.random.default_rng(3).normal(size=(300, 1, 1))
    D = np.diff(np.eye(300), 4, axis=0)
    q = (2.0 * np.sin(np.pi * 5.0 * PERIOD)) ** -8
    left = x[:, 0, 0] - np.linalg.solve(np.eye(300) + q * D.T @ D, x[:, 0, 0])
    assert vibration(x, PERIOD) == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-9)


@pytest.mark.parametrize(("N", "period"), [(20, 0.005), (79, 0.005), (1000, 0.1), (0, 0.005)])
def test_vibration_that_cannot_be_told_is_none(N: int, period: float) -> None:
    assert vibration(np.zeros((N, 2, 2)), period) is None


def test_fingers_vibrate_as_they_truly_do_where_that_is_known() -> None:
    shake = np.zeros((2000, 2, 2))
    shake[:, :, 0] = (1e-3 * np.sin(2 * np.pi * 20.0 * T))[:, None]
    made = layout()
    assert recording({"true_position": shake}, made).summary()["finger_vibration"] == pytest.approx(7.07e-4, rel=0.01)
    assert recording({"finger_position": shake}, made).summary()["finger_vibration"] == 0.0
    real = layout(simulated=False)
    assert recording({"finger_position": shake}, real).summary()["finger_vibration"] == pytest.approx(7.07e-4, rel=0.01)


def test_energy_touching_and_faults() -> None:
    energy = np.cumsum(np.full((10, 2), [1e-3, -2e-3]), axis=0)
    touching = np.ones((10, 2))
    touching[:4, 1] = 0.0
    outcome = Outcome((RunFault(3, "thumb"),), None, False)
    found = recording({"device_energy": energy, "touching": touching}, layout(), outcome).summary()
    assert found["port_energy"] == pytest.approx([0.01, -0.02])
    assert found["touching"] == [1.0, 0.6]
    assert found["faults"] == 1
    assert found["wall_time"] is found["tick_cost"] is found["ticks_per_second"] is None


def test_fingers_count_for_the_object_that_they_touch() -> None:
    made = layout(1, 4, objects=2)  # fingers 0 and 2 on the first, 1 and 3 on the second
    p = np.tile([0.0, 10.0, 0.2, 10.4], (5, 1))
    x = {"objects/object0/position": np.full((5, 1), 0.1), "objects/object1/position": np.full((5, 1), 10.2)}
    found = recording({"finger_position": p, "contact_position": p, "touching": np.ones((5, 4)), **x}, made).summary()
    assert found["tracking_error"] == pytest.approx(0.0, abs=1e-12)
    assert found["internal_deformation_peak"] == 0.0


def test_attached_contacts_have_no_invasion() -> None:
    made = layout(1, 2, gaps=False)
    found = recording({"touching": np.ones((5, 2))}, made).summary()
    assert found["invasion_mean"] is found["invasion_peak"] is None


@pytest.mark.parametrize("N", [0, 1, 400])
def test_a_summary_is_json(N: int) -> None:
    rec = waving(N=N)
    assert json.loads(json.dumps(rec.summary(), allow_nan=False)) == rec.summary()


def test_every_row_of_the_table_is_a_key_of_the_summary() -> None:
    assert {key for _, key, _, _ in ROWS} <= waving(N=100).summary().keys()


def table_of(recordings: list[Recording], titles: list[str] | None = None) -> list[Column]:
    return columns([each.summary() for each in recordings], titles or [each.header.scene for each in recordings])


def printed(recordings: list[Recording], titles: list[str] | None = None) -> list[list[str]]:
    return [[cell.strip() for cell in line.split("│")] for line in lines(table_of(recordings, titles), 120)]


def test_two_runs_side_by_side_with_their_change() -> None:
    lines = {line[0]: line[1:] for line in printed([waving(30.0), waving(60.0)], ["soft", "hard"])}
    # 200/30 and 200/60 mm
    assert lines["internal deformation, mean"] == ["6.67", "3.33", "-50 %", "mm"]
    assert lines["tracking error, RMS"] == ["3.00", "3.00", "+0 %", "mm"]
    assert lines["ticks"] == ["2000", "2000", "", ""]
    assert lines["cost per tick"] == ["100", "100", "+0 %", "us"]


def test_one_run_has_no_change_and_rows_without_numbers_are_left_out() -> None:
    rec = recording({"touching": np.ones((5, 2))}, layout(1, 2, gaps=False))
    lines = {line[0]: line[1:] for line in printed([rec])}
    assert lines["faults"] == ["0", ""]
    assert "wall time" not in lines
    assert "penetration depth of a finger, mean" not in lines
    assert len(table_of([rec])) == 3


def test_a_terminal_gets_a_head_in_bold_and_one_without_unicode_plain_rules(capsys, monkeypatch) -> None:
    print_summary([waving(N=100)], ["soft"])
    assert "soft ┃ unit\n" in capsys.readouterr().out
    monkeypatch.setattr(type(sys.stdout), "encoding", "ascii")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    print_summary([waving(N=100)], ["soft"])
    said = capsys.readouterr().out
    assert said.isascii()
    assert said.splitlines()[0].startswith("\033[1m ")
    assert "soft | unit\033[0m" in said
