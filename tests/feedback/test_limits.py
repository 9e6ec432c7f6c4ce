"""`gx.Feedback.limits`: against the wall's closed form, the poles by another way, and runs 3 % to either side."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import graspfx as gx
from graspfx.errors import InputError
from tests.support.hosted import Line, hosted, hosted_scene, raw, spring

DEVICE: dict[str, Any] = {
    "mass": 0.1,
    "damping": 0.5,
    "period": 0.001,
    "push_stiffness": 100.0,
    "squeeze_stiffness": 50.0,
}
HAND: dict[str, Any] = {"hand_stiffness": 200.0, "hand_damping": 2.0}


@pytest.mark.parametrize(("ticks", "delay"), [(1, 0), (1, 1), (1, 7), (5, 0), (10, 10), (10, 20)])
@pytest.mark.parametrize("hand", [{}, HAND])
def test_a_host_of_whole_samples_is_the_wall_of_its_own_period(ticks, delay, hand):
    limits = gx.Feedback.limits(**DEVICE, **hand, host_ticks=ticks, delay=delay)
    spring_, damper = hand.get("hand_stiffness", 0.0), hand.get("hand_damping", 0.0)
    wall = gx.stability.wall_limit(
        0.1, 0.5, 0.001 * ticks, spring=spring_, spring_damping=damper, delay=delay // ticks
    )  # fmt: skip
    assert limits.stiffness == pytest.approx(wall, rel=1e-8)
    assert limits.push == pytest.approx(wall / 100.0, rel=1e-8)
    assert limits.squeeze == pytest.approx(wall / 50.0, rel=1e-8)


def test_a_delay_of_part_of_a_host_period_is_the_walls_latency():
    """Ticks refine nothing here: a force that is held from D on is that of a wall with a delay of D/R samples."""
    limits = gx.Feedback.limits(**DEVICE, host_ticks=10, delay=13)
    wall = gx.stability.wall_limit(0.1, 0.5, 0.01, latency=0.013)
    assert limits.stiffness == pytest.approx(wall, rel=1e-8)


def slow_radius(K, R, D, predict, ratio):
    """The largest eigenvalue tick by tick, from a state with every tick's position: no lifting by hand."""
    m, b, T, k, c = 0.1, 0.5, 0.001, 200.0, 2.0
    A = np.zeros((3, 3))
    A[0, 1], A[1] = 1.0, [-k / m, -(b + c) / m, 1.0 / m]
    E = expm(A * T)[:2]
    past = D + 3 * R
    whole = np.eye(2 + past)
    for j in range(R):
        step = np.zeros((2 + past, 2 + past))
        age = (j - D) % R
        ago = age + D  # ticks since the sample that is used
        y = np.zeros(2 + past)

        def at(n):
            row = np.zeros(2 + past)
            row[0 if n == 0 else 1 + n] = 1.0
            return row

        y = at(ago)
        if predict == "linear":
            y = y + (at(ago) - at(ago + R)) * age / R
        if predict == "model":
            y = (1.0 - ratio) * y + ratio * at(0)
        step[:2, :2] = E[:, :2]
        step[:2] -= np.outer(E[:, 2], K * y)
        step[2] = at(0)
        for n in range(1, past):
            step[2 + n, 1 + n] = 1.0
        whole = step @ whole
    return np.abs(np.linalg.eigvals(whole)).max()


@pytest.mark.parametrize("predict", ["hold", "linear", "model"])
@pytest.mark.parametrize("delay", [1, 6, 15])
def test_the_lifted_loop_is_the_one_of_every_tick(predict, delay):
    more = {"model": 0.8} if predict == "model" else {}
    limits = gx.Feedback.limits(**DEVICE, **HAND, host_ticks=10, delay=delay, predict=predict, **more)
    for share in (0.999, 1.001):
        radius = slow_radius(share * limits.stiffness, 10, delay, predict, 0.8)
        assert (radius < 1.0) == (share < 1.0)


def amplitude(predict, delay, port, stiffness):
    """Run the loop itself, a millimetre from rest, and give how much larger its forces end than they were."""
    model = {f"{name}_stiffness": 0.8 * stiffness for name in ("push", "squeeze")}
    host = {"predict": predict, "tank": 0.0, "silence": 10.0, "speed": 1e3, **(model if predict == "model" else {})}
    scene = hosted_scene(host, dimensions=1, hand={"stiffness": 200.0, "damping": 2.0}, mass=0.1, damping=0.5)
    table = scene.to_dict()
    for i, finger in enumerate(table["finger"]):
        finger["start"] = [finger["start"][0] + (1e-4 if port == "push" or i == 0 else -1e-4)]
    with hosted(gx.Scene(**table)) as (session, link):
        line, rest = Line(link), np.array([finger["hand"]["rest"] for finger in table["finger"]])
        for number in range(1, 401):
            read, j = link.read(), session.tick - 1
            external, internal = spring(read, rest, stiffness, stiffness)
            sample = (number, external, internal, read.position, 0.001 * j)
            line.send(j + delay, partial(raw, link, *sample))
            for _ in range(10):
                line.deliver(session.tick)
                session.step()
        assert session.fault is None
        force = np.abs(session.recording.displayed_force).max(axis=(1, 2))
    return force[3000:].max() / force[1000:2000].max()


@pytest.mark.parametrize("port", ["push", "squeeze"])
@pytest.mark.parametrize(("predict", "delay"), [("hold", 1), ("hold", 16), ("linear", 16), ("model", 16)])
def test_runs_below_the_limit_calm_down_and_above_it_grow(port, predict, delay):
    more = {"model": 0.8} if predict == "model" else {}
    limits = gx.Feedback.limits(**DEVICE, **HAND, host_ticks=10, delay=delay, predict=predict, **more)
    below, above = (amplitude(predict, delay, port, share * limits.stiffness) for share in (0.97, 1.03))
    assert below < 0.9
    assert above > 1.1


def test_a_range_of_delays_has_the_limit_of_its_worst():
    each = [gx.Feedback.limits(**DEVICE, host_ticks=10, delay=d).stiffness for d in range(5, 26)]
    whole = gx.Feedback.limits(**DEVICE, host_ticks=10, delay=(5, 25))
    assert whole.stiffness == min(each)
    assert whole.delay == 5 + int(np.argmin(each))


@pytest.mark.parametrize(
    "wrong",
    [{"mass": 0.0}, {"period": -1.0}, {"host_ticks": 0}, {"delay": (5, 2)}, {"delay": -1}, {"delay": 0.5},
     {"predict": "spline"}, {"push_stiffness": -1.0}],
)  # fmt: skip
def test_arguments_that_cannot_be_meant_are_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        gx.Feedback.limits(**{**DEVICE, "host_ticks": 10, "delay": 5, **wrong})
