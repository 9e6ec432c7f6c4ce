"""Mechanics of a scene's fingers, as matrices: masses and dampings of devices, springs and dampers of hands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspfx.build.resolve import Parts
from graspfx.build.still_hands import StillHand
from graspfx.errors import InputError
from graspfx.loop.device import Features
from graspfx.loop.device_frame import Frame
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


@runtime_checkable
class Postured(Protocol):
    """A device whose mass and damping depend on where its finger is, as those of an arm do."""

    def effective_mass(self, position: Sequence[float]) -> FloatArray: ...

    def effective_friction(self, position: Sequence[float]) -> FloatArray: ...


@dataclass(frozen=True, eq=False)
class Mechanics:
    """Matrices of n fingers in d dimensions, where they are.

    Attributes:
        mass, friction: (n, d, d) [kg], [N s/m].
        stiffness, damping: of the hands, (n d, n d) [N/m], [N s/m].
        delay: of each device's output, (n,) [samples].
        assumed: what devices do not tell and is taken as zero.
    """

    mass: FloatArray
    friction: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    delay: NDArray[np.int64]
    assumed: tuple[str, ...]


def mechanics(parts: Parts, position: FloatArray, hands: Sequence[StillHand]) -> Mechanics:
    """Give the mechanics of devices with their fingers at positions (n, d) [m], and of hands.

    Raises:
        InputError: a device that does not tell its mass or damping, by its finger.
    """
    n, d = position.shape
    mass, friction = np.zeros((n, d, d)), np.zeros((n, d, d))
    delay = np.zeros(n, dtype=np.int64)
    assumed: set[str] = set()
    for wire in parts.wires:
        used = wire.used
        mechanics_of = _device_mechanics(parts.scene, used, wire.features)
        if mechanics_of.delay is None:
            assumed.add("no output delay, where devices tell none")
        if mechanics_of.resolution:
            assumed.add("encoders too fine to be felt")
        for i in used:
            delay[i] = mechanics_of.delay or 0
            if isinstance(wire.device, Postured):
                mass[i], friction[i] = _in_posture(wire.device, wire.fitting.frame, position[i])
            else:
                mass[i], friction[i] = mechanics_of.mass * np.eye(d), mechanics_of.friction * np.eye(d)
    K, B = np.zeros((n, d, n, d)), np.zeros((n, d, n, d))
    for still in hands:
        for total, part in ((K, still.hand.stiffness), (B, still.hand.damping)):
            for a in range(d):
                total[np.ix_(still.fingers, [a], still.fingers, [a])] = part[a][:, None, :, None]
    return Mechanics(mass, friction, K.reshape(n * d, n * d), B.reshape(n * d, n * d), delay, tuple(sorted(assumed)))


def _in_posture(device: Postured, frame: Frame | None, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    if frame is None:
        return device.effective_mass(position.tolist()), device.effective_friction(position.tolist())
    own = frame.back(position).tolist()
    return frame.impedance(device.effective_mass(own)), frame.impedance(device.effective_friction(own))


@dataclass(frozen=True)
class _DeviceMechanics:
    mass: float
    friction: float
    delay: int | None
    resolution: float | None


def _device_mechanics(scene: Scene, fingers: NDArray[np.intp], features: Features) -> _DeviceMechanics:
    lacking = [name for name in ("mass", "friction") if getattr(features, name) is None]
    if features.mass is None or features.friction is None:
        names = ", ".join(scene.finger_names[i] for i in fingers)
        raise InputError(
            f"the device of {names}",
            None,
            f"one that tells its {' and '.join(lacking)}",
            "a limit of stability needs both; give the driver the settings that its features are made of",
        )
    return _DeviceMechanics(features.mass, features.friction, features.delay, features.resolution)
