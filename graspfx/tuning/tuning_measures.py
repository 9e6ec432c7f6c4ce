"""Measures of a judgement by name, each with its formula and unit, and keys of a scene by their short names."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from graspfx.assembly.live import value_of
from graspfx.certificate.certificate import STANDING
from graspfx.certificate.judgement import Judgement
from graspfx.errors import GraspFXError, InputError, UnknownNameError
from graspfx.scene.model import Scene


@dataclass(frozen=True)
class Measure:
    """A number that a judgement has.

    Attributes:
        formula: in words.
        unit: of it; empty for a ratio.
        read: takes it from a judgement.
    """

    formula: str
    unit: str
    read: Callable[[Judgement], float]


def _standing(one: Judgement) -> float:
    rows = [row.limit.margin for row in one.limits if row.limit.mode.startswith(STANDING)]
    return min(rows, default=math.inf)


def _frequency(one: Judgement) -> float:
    return math.inf if one.worst is None else one.worst.limit.frequency


MEASURES: dict[str, Measure] = {
    "margin": Measure("the least limit over gain of all modes while all fingers hold", "", lambda one: one.margin),
    "margin.internal": Measure("limit over gain of k_ip", "", lambda one: one.margin_of("internal")),
    "margin.external": Measure("limit over gain of k_ep", "", lambda one: one.margin_of("external")),
    "margin.external_translation": Measure(
        "limit over gain of k_ep for shifts alone", "", lambda one: one.margin_of("external translation")
    ),
    "margin.external_rotation": Measure(
        "limit over gain of k_ep for turns alone", "", lambda one: one.margin_of("external rotation")
    ),
    "margin.standing": Measure("limit over gain on what carries the object", "", _standing),
    "margin.pushing": Measure(
        "the least limit over gain of fingers that push without the others", "",
        lambda one: min((row.limit.margin for row in one.pushing), default=math.inf),
    ),
    "grip": Measure("squeeze at rest over the least that holds weight, drag, acceleration", "", lambda one: one.grip),
    "depth": Measure("distance of the deepest fingertip from its contact at rest", "m", lambda one: one.depth),
    "squeeze": Measure("largest internal force of a finger at rest", "N", lambda one: one.squeeze),
    "force": Measure("largest force of a finger at rest", "N", lambda one: one.force),
    "frequency": Measure("at which the mode of least margin is lost", "Hz", _frequency),
    "spectral_radius": Measure("largest abs(z) of the sampled loop", "", lambda one: one.spectral_radius),
    "displayed.stiffness": Measure("abs(f_i)^2/(f_i.e) of the squeeze at rest", "N/m", lambda one: one.displayed),
}  # fmt: skip
GAINS = {
    f"{part}.{kind}": f"coupling.{part}.{kind}"
    for part in ("internal", "external")
    for kind in ("stiffness", "damping")
}


def key_of(scene: Scene, name: str) -> str | None:
    """Give the key that a name stands for; None for a measure.

    Raises:
        UnknownNameError: it is neither.
        InputError: the key's value is no number.
    """
    if name in MEASURES:
        return None
    key = GAINS.get(name, name)
    try:
        value = value_of(scene, key)
    except UnknownNameError as error:
        remedy = str(error) if "." in name else "or any key of the scene that is a number"
        raise UnknownNameError("measure or key", name, (*MEASURES, *GAINS), remedy) from error
    except GraspFXError:
        value = None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(name, value, "a key whose value is one number", "a measure, or another key")
    return key


def numbers_of(
    keys: Mapping[str, str | None], one: Judgement, instead: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Give the number of each name in a judgement.

    Args:
        keys: of each name, as `key_of` gives them.
        one: the judgement.
        instead: other numbers for some names.
    """
    result = {name: MEASURES[name].read(one) if key is None else _number(one, key) for name, key in keys.items()}
    return result | {name: value for name, value in (instead or {}).items() if name in result}


def _number(one: Judgement, key: str) -> float:
    value = one.values[key] if key in one.values or one.scene is None else value_of(one.scene, key)
    return float(value) if isinstance(value, int | float) else math.nan
