"""The verdict on the page: green as long as the object is held, and what it says when it was dropped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.live.certifier import MarginRow, Verdict
from graspfx.live.frame import Frames
from graspfx.live.live_run import LiveRun
from graspfx.live.sliders import sliders
from graspfx.live.view.live_page import margin_bars
from tests.support.recordings import layout, recording
from tests.support.waiting import wait_until

ROWS = tuple(MarginRow("internal", name, 70.0, 700.0, 10.0, 31.0) for name in ("cup", "lid"))
STABLE = Verdict(is_provisional=False, is_stable=True, spectral_radius=0.99, rows=ROWS, stage=2)
UNSTABLE = replace(STABLE, is_stable=False, spectral_radius=1.01)
UNKNOWN = Verdict(is_provisional=False, error="a device does not tell its mass", stage=2)


def kinds(told: dict[str, Any]) -> list[str]:
    return [each["kind"] for each in (*told["boxes"], *told["rows"])]


def test_a_stable_grasp_is_green_while_it_is_held() -> None:
    assert kinds(margin_bars(STABLE, {})) == ["green"] * (1 + len(ROWS))


@pytest.mark.parametrize("verdict", [STABLE, UNSTABLE, UNKNOWN, None])
def test_what_nobody_holds_is_not_green(verdict: Verdict | None) -> None:
    told = margin_bars(verdict, {"cup": 0.0127, "lid": 44.1})
    first, second = told["boxes"]
    assert "green" not in kinds(told) and first["kind"] == "amber"
    assert first["words"] == (
        "NOT HELD: no finger touches cup (the nearest finger is 12.7 mm away), lid (the nearest finger is 44.1 m away)"
    )
    assert first["note"] == "touch the object from both sides"
    assert (second["kind"] == "red") == (verdict is UNSTABLE)
    assert (second["words"] == "stable when all objects are held") == (verdict is STABLE)


def test_of_two_objects_the_margins_of_the_one_that_is_held_stay_green() -> None:
    told = margin_bars(STABLE, {"cup": float("nan")})
    assert [each["kind"] for each in told["rows"]] == ["grey", "green"]
    assert told["boxes"][0]["words"] == "NOT HELD: no finger touches cup"


def test_bars_are_logarithmic_and_the_mark_is_a_margin_of_one() -> None:
    rows = tuple(
        MarginRow("internal", "cup", 1.0, margin, margin, 5.0) for margin in (0.5, 0.9, 1.0, 1.2, 10.0, np.inf)
    )
    told = margin_bars(replace(STABLE, rows=rows), {})
    shares = [each["share"] for each in told["rows"]]
    assert shares == sorted(shares) and shares[2] == told["mark"] and shares[4:] == [1.0, 1.0]
    assert [each["kind"] for each in told["rows"]] == ["red", "red", "amber", "amber", "green", "green"]
    assert told["rows"][1]["words"] == "limit 0.9 N/m, lost at 5 Hz" and told["rows"][5]["margin"] == "no limit"


def test_an_object_is_loose_that_none_of_its_fingers_touches_in_any_row() -> None:
    made = layout(2, 4, objects=3, finger_objects=(0, 0, 1, 1))  # no finger is on the last
    touching = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    gap = np.array([[-0.001, 0.01, 0.01, 0.02], [0.001, 0.01, 0.04, 0.03]])
    run = recording({"touching": touching, "gap": gap}, made)
    assert Frames(run).loose == {"object1": 0.03}
    assert Frames(run.part(1, 2)).loose == {"object0": 0.001, "object1": 0.03}
    assert Frames(run.part(1, 1)).loose == {}


@pytest.mark.parametrize(
    ("columns", "expected"), [(("touching",), {"object": pytest.approx(np.nan, nan_ok=True)}), (("gap",), {})]
)
def test_what_is_not_recorded_is_not_told(columns: tuple[str, ...], expected: dict[str, Any]) -> None:
    changes = {"duration": 0.05, "engine": "interpreted", "record.columns": list(columns)}
    assert Frames(gx.run(gx.load("pick-and-place").replace(changes))).loose == expected


def test_a_page_is_not_green_while_an_object_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("websockets", reason="the page needs websockets: pip install 'graspfx[view]'")
    from graspfx.live.view import live_page

    monkeypatch.setattr(live_page, "HELD", 0.05)
    scene = gx.load("paper-waving").replace({"engine": "interpreted"})
    with (
        LiveRun(scene, guide="hands", paused=True) as run,
        live_page.LivePage(run, [], Path, port=0, tell=lambda _: None) as view,
    ):
        view._margins = SimpleNamespace(latest=lambda: STABLE, close=lambda: None)  # type: ignore[assignment]

        def shown(way: float) -> dict[str, Any]:
            for number, sign in enumerate((-1.0, 1.0)):
                run.guide(number, [sign * way, 0.0])
            last = run.tick + 40
            run.step(40)
            wait_until(lambda: run.tick == last)
            told: dict[str, Any] = view._state()["margins"]
            return told

        assert kinds(shown(0.0))[0] == "green"
        dropped = shown(0.03)
        assert dropped["boxes"][0]["words"].startswith("NOT HELD: no finger touches object (the nearest finger is ")
        assert dropped["boxes"][1]["words"] == "stable when all objects are held"
        assert kinds(shown(0.0))[0] == "green"


def test_a_certificate_is_requested_for_the_values_that_the_run_has() -> None:
    """For those that differ from the first ones; an order that fails changes neither run nor certificate."""
    pytest.importorskip("websockets", reason="the page needs websockets: pip install 'graspfx[view]'")
    from graspfx.live.view.live_page import LivePage

    requests: list[dict[str, Any]] = []
    kep, kip = "coupling.external.stiffness", "coupling.internal.stiffness"
    scene = gx.load("paper-waving", {"engine": "interpreted"})
    numbers = [each for each in sliders(scene) if each.key in (kep, kip)]
    with (
        LiveRun(scene, live=[kep, kip], paused=True) as run,
        LivePage(run, numbers, Path, port=0, tell=lambda _: None) as view,
    ):
        view._margins = SimpleNamespace(ask=requests.append, close=lambda: None)  # type: ignore[assignment]
        view._certify()
        assert requests == []
        for value in (40.0, 50.0):
            view.sliders.set(kep, value)
        wait_until(lambda: run.scene.coupling.external.stiffness == 50.0)
        view._certify()
        view._certify()
        assert requests == [{kep: 50.0}]
        view.sliders.set(kep, -1.0)
        wait_until(lambda: "was not set" in view._remark)
        view._certify()
        assert view.sliders.values[kep] == view.sliders.shown[kep] == 50.0 and len(requests) == 1
        view.sliders.set(kip, 90.0)
        wait_until(lambda: run.scene.coupling.internal.stiffness == 90.0)
        view._certify()
        assert requests[1:] == [{kep: 50.0, kip: 90.0}]
