"""Columns of values against scenes that are built, bit by bit: shelf scenes, random ones, one key and pairs."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.resolve import resolve
from graspfx.batch.variants import FULL, Variants
from graspfx.batch.varied_entries import plain_keys
from graspfx.errors import GraspFXError, SceneError
from tests.support.random_scenes import random_case
from tests.support.small_scenes import line

GAINS = [f"coupling.{share}.{quantity}" for share in ("external", "internal") for quantity in ("stiffness", "damping")]
OTHERS = ["coupling.friction", "object.mass", "object.viscosity", "object.rotational_viscosity", "finger.0.friction"]
PARTS = [
    "finger.0.hand.stiffness", "finger.0.hand.damping", "finger.0.hand.squeeze", "finger.0.hand.squeeze_ramp",
    "finger.0.hand.motion.amplitude", "finger.0.hand.motion.frequency", "hand.0.arm.stiffness", "hand.0.grip.damping",
    "hand.0.squeeze", "finger.0.device.mass", "finger.*.device.damping", "finger.1.device.force_limit",
    "device.0.mass", "device.0.damping", "device.0.force_limit",
]  # fmt: skip
SHELF = ["paper-spring", "sphere-three-fingers", "paper-waving", "soft-pinch"]
COUNT = FULL + 4


def values_of(scene: gx.Scene, key: str, rng: np.random.Generator) -> np.ndarray | None:
    """Random values around the scene's own, zero and those of other gains among them; None where it has none."""
    from graspfx.assembly.live import value_of

    try:
        own = value_of(scene, key)
    except GraspFXError:
        return None
    if not isinstance(own, int | float):
        return None
    values = (own or 0.1) * np.exp(rng.uniform(-0.4, 0.4, COUNT))
    if key in GAINS:
        values[3] = 0.0
        values[5] = getattr(getattr(scene.coupling, rng.choice(["external", "internal"])), key.split(".")[2])
    return values


def faults_of(make: Callable[[], object]) -> list[str]:
    """Faults of a scene that is made."""
    try:
        make()
    except SceneError as error:
        return [fault.message for fault in error.faults]
    return []


def require_as_built(scene: gx.Scene, values: dict[str, np.ndarray]) -> int:
    """Require that every variant is as it would be built, or raises what it raises; count those that were built."""
    lists = {key: each.tolist() for key, each in values.items()}
    numbers = np.repeat(np.arange(COUNT)[:, None], len(values), axis=1)
    good = []
    for k in range(COUNT):
        expected = faults_of(partial(scene.replace, {key: each[k] for key, each in lists.items()}))
        if not expected:
            good.append(k)
            continue
        assert faults_of(Variants(scene, lists, numbers[[k] * (FULL + 1)]).groups) == expected
    numbers = numbers[good]
    variants = Variants(scene, lists, numbers)
    groups = variants.groups()
    assert not variants.notes
    built = variants.builds
    assert sorted(k for group in groups for k in group.members.tolist()) == list(range(len(numbers)))
    for group in groups:
        for place, member in enumerate(group.members.tolist()):
            whole = variants.built(numbers[member])
            assert whole.arena.tobytes() == group.arenas(slice(place, place + 1))[0].tobytes()
            assert variants._programs[whole.layout] is group.program
    return built


@pytest.mark.parametrize("name", SHELF)
def test_columns_are_what_is_built_on_the_shelf(name: str) -> None:
    scene, rng = gx.load(name), np.random.default_rng(len(name))
    keys = {key: values for key in [*GAINS, *OTHERS] if (values := values_of(scene, key, rng)) is not None}
    assert len(keys) >= 4
    for key in rng.permutation(list(keys))[:5]:
        require_as_built(scene, {key: keys[key]})
    pairs = list(itertools.combinations(keys, 2))
    for k in rng.choice(len(pairs), size=4, replace=False):
        require_as_built(scene, {key: keys[key] for key in pairs[k]})


@pytest.mark.parametrize("name", ["reference-1dof", "paper-spring", "paper-waving", "carry-bar"])
def test_devices_and_hands_are_what_is_built_on_the_shelf(name: str) -> None:
    scene, rng = gx.load(name), np.random.default_rng(len(name))
    keys = {key: values for key in PARTS if (values := values_of(scene, key, rng)) is not None}
    assert keys
    for key, values in keys.items():
        assert require_as_built(scene, {key: values}) <= 4, key
    first, second = rng.choice([*keys, "coupling.internal.stiffness"], size=2, replace=False).tolist()
    keys["coupling.internal.stiffness"] = rng.uniform(40.0, 90.0, COUNT)
    require_as_built(scene, {first: keys[first], second: keys[second]})


def test_a_value_that_a_driver_refuses_is_said_as_of_one_scene() -> None:
    scene = gx.load("reference-1dof")
    values = np.linspace(0.1, 0.2, 40)
    values[17] = -1.0
    with pytest.raises(SceneError) as single:
        scene.replace({"finger.0.device.mass": -1.0})
    with pytest.raises(SceneError, match=r"finger\.0\.device\.mass = -1\.0") as several:
        gx.run_batch(scene, {"finger.0.device.mass": values}, 0.1)
    assert [fault.message for fault in several.value.faults] == [fault.message for fault in single.value.faults]


@pytest.mark.parametrize("seed", range(6))
def test_columns_are_what_is_built_of_random_scenes(seed: int) -> None:
    table: dict[str, Any] = random_case(seed).table
    scene, rng = gx.Scene(**table, duration=1.0), np.random.default_rng(seed)
    keys = {key: values for key in [*GAINS, *OTHERS] if (values := values_of(scene, key, rng)) is not None}
    for size in (1, 2, 3):
        chosen = rng.choice(list(keys), size=min(size, len(keys)), replace=False)
        require_as_built(scene, {str(key): keys[str(key)] for key in chosen})


def test_columns_stand_beside_values_that_are_built() -> None:
    """Starts of which each is built, and gains and masses that are not, together."""
    scene, rng = gx.load("reference-1dof"), np.random.default_rng(1)
    values: dict[str, Any] = {
        "coupling.external.stiffness": rng.uniform(10.0, 60.0, COUNT),
        "finger.0.start": np.array([[0.002], [0.0021]] * (COUNT // 2)),
        "object.mass": rng.uniform(0.05, 0.2, COUNT),
    }
    assert plain_keys(scene, resolve(scene), {key: each.tolist() for key, each in values.items()}) == [
        "coupling.external.stiffness", "object.mass",
    ]  # fmt: skip
    require_as_built(scene, values)


def test_few_variants_of_plain_keys_are_built() -> None:
    scene, rng = gx.load("reference-1dof"), np.random.default_rng(2)
    assert (
        require_as_built(scene, {key: rng.uniform(0.3, 0.9, COUNT) for key in ("object.mass", "object.viscosity")}) <= 4
    )


def test_an_automatic_fade_begins_where_each_variant_asks_for_it() -> None:
    scene = line(coupling__external__stiffness=30.0)
    stiffness = np.geomspace(2.0, 200.0, COUNT)
    require_as_built(scene, {"coupling.external.stiffness": stiffness})
    lists = {"coupling.external.stiffness": stiffness.tolist()}
    groups = Variants(scene, lists, np.arange(COUNT)[:, None]).groups()
    starts = [k for group in groups for k in group.varying.tolist()]
    assert len(set(starts)) > 1  # not the gains alone


@pytest.mark.parametrize(
    ("name", "key", "bad"),
    [
        ("paper-spring", "coupling.external.stiffness", 0.0),
        ("paper-spring", "coupling.internal.stiffness", -1.0),
        ("paper-spring", "object.viscosity", 50.0),  # more than explicit integration stands
        ("reference-1dof", "object.mass", 0.0),
        ("reference-1dof", "object.mass", float("nan")),
        ("reference-1dof", "coupling.external.damping", float("inf")),
        ("sphere-three-fingers", "coupling.friction", -0.5),
    ],
)
def test_one_bad_value_of_many_is_said_with_its_key(name: str, key: str, bad: float) -> None:
    scene = gx.load(name)
    with pytest.raises(SceneError) as single:
        scene.replace({key: bad})
    values = np.linspace(0.5, 0.9, 40)
    values[23] = bad
    with pytest.raises(SceneError, match=rf"{key} = {bad!r}") as several:
        gx.run_batch(scene, {key: values}, 0.1)
    assert [fault.message for fault in several.value.faults] == [fault.message for fault in single.value.faults]
