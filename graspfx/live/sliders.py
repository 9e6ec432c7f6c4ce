"""Sliders of a scene: values that can change during a run, and their ranges."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.build import build
from graspfx.assembly.live import GAINS, INERTIA, OBJECT_GAINS, value_of
from graspfx.assembly.steering import Steering
from graspfx.errors import GraspFXError
from graspfx.live.certifier import Verdict
from graspfx.loop.servo import Servo, Steerable
from graspfx.scene.keys import general
from graspfx.scene.model import Scene
from graspfx.scene.tables.part_tables import ObjectImpedance

FloatArray = NDArray[np.float64]

OBJECT_STIFFNESS = OBJECT_GAINS[0]
GAIN_TEXTS = dict(zip(GAINS, (
    ("external stiffness", "k_ep", "N/m"), ("external damping", "k_ed", "N s/m"),
    ("internal stiffness", "k_ip", "N/m"), ("internal damping", "k_id", "N s/m"),
), strict=True))  # fmt: skip
ABOVE = 4.0  # end of a range relative to the present value
BEYOND = 1.5  # end of a range relative to the stability limit
RELAXATION = 0.02  # largest damping relative to the stiffness [s]
ROUGHEST = 1.5  # largest coefficient of friction
FACTORS = (0.1, 5.0)  # on the object's stiffness
STEPS = 200  # approximate number of steps of a range


@dataclass(frozen=True, eq=False)
class Slider:
    """Value of a scene that can change during a run.

    The value is either a number in the scene, or a factor by which the stiffness matrix K_o of the object is multiplied
    for translation or for rotation.

    Attributes:
        key: Live key of the number; for a factor, the live key of K_o followed by ".translation" or ".rotation".
        label: Description with the symbol used in the paper.
        unit: Unit of the value; empty for a factor or a coefficient of friction.
        least, most: Smallest and largest value; the range includes the present value.
        step: Step between values.
        value: Present value.
        stiffness: For a factor, K_o at factor 1 (w, w); otherwise None.
        freedoms: For a factor, indices of the object's degrees of freedom to which the factor applies.
    """

    key: str
    label: str
    unit: str
    least: float
    most: float
    step: float
    value: float
    stiffness: FloatArray | None = None
    freedoms: tuple[int, ...] = ()

    @property
    def live(self) -> str:
        """Live key of the scene that the slider changes."""
        return self.key if self.stiffness is None else OBJECT_STIFFNESS

    def to_dict(self) -> dict[str, Any]:
        """Return the description of the slider for a page."""
        return {
            "key": self.live, "label": self.label, "unit": self.unit, "least": self.least, "most": self.most,
            "step": self.step, "value": self.value,
        }  # fmt: skip


def sliders(scene: Scene) -> list[Slider]:
    """List the sliders of a scene: gains, friction, and the viscosity and mass of objects, if they can change.

    Ranges are linear and end at 4 times the present value or more (2 times for friction); `widened` extends a range
    beyond the stability limit. A stiffness matrix of the object has one factor for translation and one for rotation.
    """
    with build(scene, engine="interpreted") as servo:
        found = list(_factors(servo, scene))
        for key, (label, unit) in _candidates(scene).items():
            value = value_of(scene, key)
            if _is_number(value) and _can_change(servo, scene, key, value):
                least, most = _range(scene, key, value)
                found.append(Slider(key, label, unit, least, most, _step(least, most), float(value)))
    return found


def _factors(servo: Servo, scene: Scene) -> Iterator[Slider]:
    """Yield the factors of the object's stiffness for translation and for rotation, if this stiffness can change."""
    part = scene.coupling.external
    if not isinstance(part, ObjectImpedance) or not _can_change(servo, scene, OBJECT_STIFFNESS, 1.0):
        return
    K, d = np.array(part.stiffness), scene.dimensions
    least, most = FACTORS
    for name, freedoms in ("translation", range(d)), ("rotation", range(d, len(K))):
        if K.diagonal()[freedoms.start : freedoms.stop].any():
            key, label = f"{OBJECT_STIFFNESS}.{name}", f"stiffness of the object in {name}, factor"
            yield Slider(key, label, "", least, most, _step(least, most), 1.0, K, tuple(freedoms))


def live_keys(sliders: Sequence[Slider]) -> list[str]:
    """List the live keys that sliders change, without duplicates."""
    return list(dict.fromkeys(each.live for each in sliders))


def values_of(slider: Slider, others: Sequence[Slider], values: Mapping[str, float]) -> dict[str, Any]:
    """Return the value of the live key that a slider changes: a number, or the stiffness K_o of the object.

    With the factors a for translation (index t) and b for rotation (index r), K_o becomes
    [[a K_tt, sqrt(a b) K_tr], [sqrt(a b) K_rt, b K_rr]], which remains positive semidefinite.

    Args:
        slider: Slider whose value has changed.
        others: All sliders.
        values: Value of each slider, by the key of the slider.
    """
    if slider.stiffness is None:
        return {slider.live: values[slider.key]}
    root = np.ones(len(slider.stiffness))
    for each in others:
        if each.stiffness is not None:
            root[list(each.freedoms)] = math.sqrt(values[each.key])
    return {slider.live: (slider.stiffness * np.outer(root, root)).tolist()}


def value_in(slider: Slider, values: Mapping[str, Any]) -> float | None:
    """Return the value of a slider from the values of live keys; None if the slider's live key is not among them."""
    if slider.live not in values:
        return None
    if slider.stiffness is None:
        return float(values[slider.live])
    i = max(slider.freedoms, key=lambda k: float(np.asarray(slider.stiffness)[k, k]))
    return float(np.asarray(values[slider.live])[i, i] / slider.stiffness[i, i])


def widened(slider: Slider, verdict: Verdict) -> Slider:
    """Extend the range of a stiffness to 1.5 times its stability limit, rounded up, if the range ends below the limit.

    For a factor of the object's stiffness, the limit is the factor in the verdict times the margin of its mode.
    """
    limit = max(filter(math.isfinite, _limits(slider, verdict)), default=0.0)
    if limit < slider.most:
        return slider
    most = _nice_above(BEYOND * limit)
    return replace(slider, most=most, step=_step(slider.least, most))


def _limits(slider: Slider, verdict: Verdict) -> list[float]:
    """List the stability limits of a slider's value, one for each row of the mode that the value belongs to."""
    plain = general(slider.key)
    if slider.stiffness is not None:
        own = f"external {plain.rpartition('.')[2]}"
        mode = own if any(row.mode == own for row in verdict.rows) else "external"  # where there is one mode
        now = value_in(slider, verdict.values)
        return [(slider.value if now is None else now) * row.margin for row in verdict.rows if row.mode == mode]
    if plain not in GAINS or not plain.endswith(".stiffness"):
        return []
    return [row.limit for row in verdict.rows if row.mode == plain.split(".")[1]]


def _range(scene: Scene, key: str, value: float) -> tuple[float, float]:
    """Return the smallest and the largest value of a slider, from the present value."""
    plain = general(key)
    if plain.endswith(".friction"):
        return min(0.05, value), _nice_above(max(ROUGHEST, 2.0 * value))
    if plain in INERTIA:
        return _nice_below(value / ABOVE), _nice_above(ABOVE * value)
    if plain.endswith("viscosity"):
        return 0.0, _nice_above(ABOVE * value) if value > 0.0 else 1.0
    if plain.endswith(".damping"):
        stiffness = value_of(scene, plain.replace("damping", "stiffness"))
        spring = stiffness if _is_number(stiffness) else 0.0
        return 0.0, _nice_above(max(ABOVE * value, RELAXATION * spring) or 1.0)
    return _nice_below(value / 10.0), _nice_above(ABOVE * value or 1.0)


def _candidates(scene: Scene) -> Mapping[str, tuple[str, str]]:
    """Return label and unit of each key that may have a slider."""
    texts = {key: (f"{words}, {letter}", unit) for key, (words, letter, unit) in GAIN_TEXTS.items()}
    if isinstance(scene.coupling.external, ObjectImpedance):  # its gains have other keys, and are not numbers
        texts = {key: text for key, text in texts.items() if not key.startswith("coupling.external.")}
    texts["coupling.friction"] = ("friction, µ", "")
    for i, (finger, name) in enumerate(zip(scene.finger, scene.finger_names, strict=True)):
        if finger.friction is not None:
            texts[f"finger.{i}.friction"] = (f"friction of {name}, µ", "")
    lone = len(scene.object) == 1
    for i, table in enumerate(scene.object):
        at, of = ("object", "") if lone else (f"object.{i}", f" of {table.name}")
        texts[f"{at}.{'mass' if table.density is None else 'density'}"] = (
            (f"mass{of}, m", "kg") if table.density is None else (f"density{of}", "kg/m³")
        )
        texts[f"{at}.viscosity"] = (f"viscosity{of}, b_v", "N s/m")
        if table.rotational_viscosity is not None:
            texts[f"{at}.rotational_viscosity"] = (f"rotational viscosity{of}, b_w", "N m s/rad")
    return texts


def _can_change(servo: Servo, scene: Scene, key: str, value: float) -> bool:
    plain = general(key)
    if plain in ("coupling.friction", "finger.*.friction") and value <= 0.0:
        return False  # a contact with friction has additional state
    if plain in INERTIA and any(isinstance(mover.body, Steerable) for mover in servo.movers):
        return False  # numbers that an object on planes derives from its mass do not reach a servo in another process
    try:
        Steering(servo, scene, [key])
    except GraspFXError:
        return False
    return True


def _step(least: float, most: float) -> float:
    return _nice_below((most - least) / STEPS)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _nice_above(value: float) -> float:
    """Round up to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    factor = next(each for each in (1.0, 2.0, 5.0, 10.0) if each * power >= value * (1.0 - 1e-9))
    return float(f"{factor * power:.6g}")


def _nice_below(value: float) -> float:
    """Round down to 1, 2 or 5 times a power of ten; return 0 for values of 0 or less."""
    if value <= 0.0:
        return 0.0
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    factor = next(each for each in (5.0, 2.0, 1.0) if each * power <= value * (1.0 + 1e-9))
    return float(f"{factor * power:.6g}")
