"""Whole scenes in other units, against 50 digits, and at extremes of mass, size, period, speed and finger count."""

from __future__ import annotations

import re
from typing import Any

import mpmath as mp
import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import GraspFXError, SceneError
from tests.support.bad_values import bad_values
from tests.support.exact import DIGITS
from tests.support.exact_bodies import exact_step
from tests.support.families import efforts, family
from tests.support.scatter import decades
from tests.support.scenes import COLUMNS, factor, in_units, random_table

UNITS = family("scenes: other units", "the same numbers, of the largest in a column")
LINE = family("scenes: one dimension, attached", "50 digits, of the largest position")
PROMISES = family("scenes: extremes", "gx.testing.check_scene: finite, repeats, action = reaction")
SAID = family("scenes: extremes that diverge", "a fault, finite rows before it, no force from it on")
RESTS = family("scenes: a box on the stiffest floor", "weight over stiffness, of that depth")
REFUSED = family("scenes: bad values of every key", "SceneError, or a run without NaN before a fault")
NO_BOUND = 1e39  # [N], in any unit


@efforts(short=3, full=60)
def test_other_units_give_the_same_numbers(cases: int) -> None:
    rng = np.random.default_rng(31)
    for case in range(cases):
        table = random_table(rng)
        # 1 um to 1 km, 1e-6 to 1e3 kg, 0.06 to 16 ms; powers of two, so that nothing is rounded on the way
        units = (2.0 ** int(rng.integers(-15, 15)), 2.0 ** int(rng.integers(-16, 14)), 2.0 ** int(rng.integers(-4, 5)))
        other = in_units(table, units)
        table["coupling"]["force_bound"] = other["coupling"]["force_bound"] = NO_BOUND
        here, there = gx.run(gx.Scene(**table)), gx.run(gx.Scene(**other))
        label = f"case {case}: {table['dimensions']}-D, {len(table['finger'])} fingers, units {units}"
        assert [f.tick for f in here.faults] == [f.tick for f in there.faults], label
        for name, column in here.layout.columns.items():
            last, a, b = name.rpartition("/")[2], here.array(name), there.array(name)
            scale: Any = factor(COLUMNS.get(last, (1, 1, -2)), units)
            if last == "wrench":
                moments = np.arange(column.shape[0]) >= table["dimensions"]
                scale = np.where(moments, factor((2, 1, -2), units), scale)
            # a residual is nothing but rounding: it is measured by the forces
            size = here.finger_force if last == "residual" else a
            largest = np.abs(size * scale).max() or 1.0
            UNITS.check(float(np.abs(a * scale - b).max() / largest), 1e-9, f"{label}, {name}")


def line_table(rng: np.random.Generator) -> dict[str, Any]:
    """Fingers attached to an object on a line: stable gains for any mass and period."""
    n, T = round(decades(rng, 1.0, 100.0)), decades(rng, 5e-5, 2e-2)
    mass, heavy, away = decades(rng, 1e-6, 1e3), decades(rng, 1e-2, 1e2), 1e3 * (rng.random() < 0.3)
    integrator = str(rng.choice(["explicit", "semi-implicit", "exact", "implicit"]))
    z = decades(rng, 1e-3, 1.0 if integrator in ("explicit", "semi-implicit") else 1e3)
    top = 0.02 * mass * min(1.0, heavy / n) / T**2
    ratio = decades(rng, 1e-6, 1e6)
    ke, ki = (top, top * ratio) if ratio < 1.0 else (top / ratio, top)
    rest = away + decades(rng, 1e-6, 1.0) * rng.normal(size=n)
    fingers = [
        {
            "device": {"name": "simulated", "mass": mass * float(rng.uniform(0.5, 2.0)), "damping": 0.1 * mass / T},
            "hand": {"stiffness": 0.01 * mass / T**2, "damping": 0.01 * mass / T, "rest": [float(x)]},
            "start": [float(x + 1e-3 * rng.normal())],
        }
        for x in rest
    ]
    return {
        "dimensions": 1, "period": T, "duration": 30 * T,
        "object": {"mass": mass * heavy, "viscosity": z * mass * heavy / T, "integrator": integrator,
                   "position": [away], "velocity": [float(rng.uniform(-10.0, 10.0))]},
        "coupling": {"contact": "attached", "external": {"stiffness": ke}, "internal": {"stiffness": ki}},
        "finger": fingers,
    }  # fmt: skip


def line_run(table: dict[str, Any]) -> tuple[list[Any], list[Any]]:
    """Positions of fingers and object at the last recorded tick, at 50 digits from the laws."""
    real = mp.mpf
    T, thing, n = real(table["period"]), table["object"], len(table["finger"])
    ke, ki = (real(table["coupling"][name]["stiffness"]) for name in ("external", "internal"))
    m, b = real(thing["mass"]), real(thing["viscosity"])
    x, v, z = real(thing["position"][0]), real(thing["velocity"][0]), b / m * T
    p = [real(finger["start"][0]) for finger in table["finger"]]
    w, step = [real(0)] * n, []
    for finger in table["finger"]:
        device, hand = finger["device"], finger["hand"]
        M, B, K = real(device["mass"]), real(device["damping"]) + real(hand["damping"]), real(hand["stiffness"])
        A = mp.matrix([[0, 1, 0], [-K / M, -B / M, 1 / M], [0, 0, 0]]) * T
        step.append((mp.expm(A), K * real(hand["rest"][0])))
    implicit = thing["integrator"] == "implicit"
    for _ in range(round(table["duration"] / table["period"]) - 1):
        at, yields = x, real(0)
        if implicit:  # f with the object where it will be under that very force
            at, yields = x + T * v / (1 + z), T * T / (1 + z) / m
        mean = sum(p) / n - at
        total = n * ke * mean / (1 + n * ke * yields)
        e = [q - at - yields * total for q in p]
        common = sum(e) / n
        f = [ki * each + (ke - ki) * common for each in e]
        for i, (E, pull) in enumerate(step):
            now = E * mp.matrix([p[i], w[i], pull - f[i]])
            p[i], w[i] = now[0], now[1]
        x, v = exact_step(thing["integrator"], x, v, sum(f) / m, z, T)
    return p, [x]


@efforts(short=4, full=80)
def test_one_dimension_against_fifty_digits(cases: int) -> None:
    rng = np.random.default_rng(32)
    for case in range(cases):
        table = line_table(rng)
        table["coupling"]["force_bound"] = NO_BOUND
        recording = gx.run(gx.Scene(**table))
        assert not recording.faults
        with mp.workdps(DIGITS):
            p, x = line_run(table)
            found = [*recording.finger_position[-1, :, 0].tolist(), float(recording.object_position[-1, 0])]
            off = [float(abs(mp.mpf(a) - b)) for a, b in zip(found, p + x, strict=True)]
        scale = float(max(np.abs(recording.finger_position).max(), np.abs(recording.object_position).max()))
        thing, n = table["object"], len(table["finger"])
        label = (
            f"case {case}: {n} fingers, {thing['integrator']}, {thing['mass']:.1e} kg, {1e3 * table['period']:.2g} ms"
        )
        LINE.check(max(off) / scale, 2e-14, label)


@efforts(short=4, full=50)
def test_extremes_keep_the_promises(cases: int) -> None:
    rng = np.random.default_rng(33)
    for case in range(cases):
        table = random_table(rng, most=16 if case % 10 == 9 else 6)
        units = (decades(rng, 2e-5, 2e4), decades(rng, 1e-5, 1e4), decades(rng, 0.05, 20.0))
        table = in_units(table, units)
        d, far = table["dimensions"], 1e3 * (rng.random() < 0.3) * rng.normal(size=table["dimensions"])
        table["object"]["position"] = far.tolist()
        table["object"]["velocity"] = (10.0 * rng.uniform(-1.0, 1.0, d)).tolist()
        for finger in table["finger"]:
            finger["start"] = (np.array(finger["start"]) + far).tolist()
            finger["hand"]["rest"] = (np.array(finger["hand"]["rest"]) + far).tolist()
        table["coupling"]["force_bound"] = NO_BOUND
        label = f"case {case}: {d}-D, {len(table['finger'])} fingers, units {units}"
        scene, duration = gx.Scene(**table), 20 * table["period"]
        recording = gx.run(scene, duration=duration)
        if recording.faults:
            # what crosses many of its own sizes in a sample, or is spun by that, diverges: the run has to say so
            [fault] = recording.faults
            assert re.search(r"(is not finite|above coupling.force_bound = .*); all forces are zero", fault.message), (
                label
            )
            assert np.isfinite(recording.rows[: fault.tick]).all(), label
            assert not recording.finger_force[fault.tick :].any(), label
            SAID.tried()
            continue
        try:
            gx.testing.check_scene(scene, duration=duration, energy=None)
        except GraspFXError as error:
            pytest.fail(f"{label}: {error}")
        PROMISES.tried()


@pytest.mark.parametrize("contact", ["attached", "unilateral"])
def test_a_hundred_fingers_in_space(contact: str) -> None:
    # all around a sphere, every second one where another is; the wrench is the sum of forces, moments about the centre
    rng = np.random.default_rng(35)
    u = np.repeat(rng.normal(size=(50, 3)), 2, axis=0)
    start = 0.03 * u / np.linalg.norm(u, axis=1, keepdims=True) * rng.uniform(0.97, 1.0, (100, 1))
    gains = {"external": {"stiffness": 0.3}, "internal": {"stiffness": 30.0}}
    body = {"mass": 0.1, "viscosity": 0.5, "rotational_viscosity": 1e-4, "shape": {"kind": "sphere", "radius": 0.03}}
    fingers = [{"device": {"name": "simulated", "mass": 0.1, "damping": 0.5}, "start": x.tolist()} for x in start]
    table = {"dimensions": 3, "period": 0.001, "duration": 0.004, "object": body, "finger": fingers}
    recording = gx.run(gx.Scene(**table, coupling={"contact": contact, "absent": "follow", **gains}))
    assert not recording.faults
    f, x = recording.finger_force, recording.object_position[:, None]
    wrench = np.hstack([f.sum(axis=1), np.cross(recording.finger_position - x, f).sum(axis=1)])
    scale = np.abs(f).sum(axis=(1, 2)).max()
    assert np.abs(recording.wrench - wrench).max() <= 1e-14 * scale
    assert scale > 0.0 or contact == "attached"
    PROMISES.tried()


def keys(table: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths to every value of a table."""
    if isinstance(table, dict):
        return [path for key, value in table.items() for path in [(*at, key), *keys(value, (*at, key))]]
    if isinstance(table, list) and table and isinstance(table[0], dict):
        return [path for i, value in enumerate(table[:1]) for path in keys(value, (*at, i))]
    return [at]


@pytest.mark.parametrize(
    ("key", "bad"), [("period", 5e-324), ("object.mass", 1e-300), ("coupling.external.stiffness", 1e200)]
)
def test_sizes_that_formulas_cannot_take(key: str, bad: float) -> None:
    # a period of 5e-324 s raised OverflowError when the recorder counted rows per second
    with pytest.raises(SceneError, match=rf"{key}: expected no (less|more) than"):
        gx.load("reference-1dof", {key: bad})


def resting(d: int, mass: float, period: float, stiffness: float, integrator: str) -> gx.Scene:
    up = [0.0] * (d - 1)
    return gx.Scene(
        dimensions=d,
        period=period,
        duration=100 * period,
        gravity=[*up, -9.81],
        object={
            "mass": mass, "viscosity": 0.0, "rotational_viscosity": 0.0, "integrator": integrator,
            "shape": {"kind": "box", "size": [0.05] * d}, "position": [*up, 0.025],
        },
        obstacle=[{"shape": {"kind": "half-space", "normal": [*up, 1.0]}}],
        world={"stiffness": stiffness},
        coupling={"external": {"stiffness": 10.0}, "internal": {"stiffness": 10.0}},
        finger=[{"device": {"name": "simulated", "mass": 0.1, "damping": 1.0}, "start": [*up, 1.0]}],
    )  # fmt: skip


@pytest.mark.parametrize(("mass", "period"), [(1e-6, 5e-5), (1e-6, 2e-2), (1e-4, 2e-2), (0.1, 1e-3), (1e3, 2e-2)])
@pytest.mark.parametrize("d", [2, 3])
def test_a_box_rests_on_the_stiffest_floor_and_a_stiffer_one_is_refused(d: int, mass: float, period: float) -> None:
    # 0.1 g on the default 1e5 N/m at 20 ms was thrown up by metres without a word: k T^2/m of 4e5
    stiffest = 1e4 * mass / period**2
    for integrator in ("exact", "implicit"):
        recording = gx.run(resting(d, mass, period, 0.999 * stiffest, integrator))
        sunk = float(recording.object_position[-1, -1]) - 0.025
        expected = -mass * 9.81 / (2 ** (d - 1) * 0.999 * stiffest)
        RESTS.check(abs(sunk / expected - 1.0), 1e-5, f"{d}-D, {mass:g} kg, {1e3 * period:g} ms, {integrator}")
    with pytest.raises(SceneError, match=r"world.stiffness: .*rounding errors cause the object to jump off"):
        resting(d, mass, period, 1.01 * stiffest, "exact")


def test_a_scene_without_objects_says_so() -> None:
    # IndexError where hands with fingers were checked
    with pytest.raises(SceneError, match="object: "):
        gx.load("knob", {"object": []})


@efforts(short=40, full=1500)
def test_bad_values_of_every_key(cases: int) -> None:
    rng = np.random.default_rng(34)
    tables = [random_table(rng, most=3) for _ in range(6)]
    tables += [gx.load(name).to_dict() for name in ("sphere-three-fingers", "knob", "pick-and-place", "soft-pinch")]
    places = [(table, path) for table in tables for path in dict.fromkeys(keys(table)) if path]
    for _ in range(cases):
        table, path = places[int(rng.integers(len(places)))]
        dotted = ".".join(map(str, path))
        good: Any = table
        for part in path:
            good = good[part]
        values = list(bad_values(good))
        bad = values[int(rng.integers(len(values)))]
        REFUSED.tried()
        label = f"{dotted} = {bad!r:.60}"
        try:
            scene = gx.Scene(**table).replace({dotted: bad})
        except SceneError:
            continue
        try:
            recording = gx.run(scene, duration=min(scene.duration, 3.0 * scene.period))
        except GraspFXError:
            continue
        fault = min((fault.tick for fault in recording.faults), default=len(recording))
        assert np.isfinite(recording.rows[:fault]).all(), label
        assert not recording.finger_force[fault:].any(), label
