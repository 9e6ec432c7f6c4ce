"""Mass and friction of a scene's devices, stiffness and damping of its hands, and delays, as matrices."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.grasps import StillHand
from graspfx.assembly.resolve import Parts
from graspfx.assembly.wiring import Wire
from graspfx.errors import InputError
from graspfx.loop.device import Features, SimulatedDevice, is_hardware
from graspfx.loop.device_mount import Frame
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

MECHANICAL = {"mass", "friction"}  # measures that replace an arm's posture-dependent values


@runtime_checkable
class Postured(Protocol):
    """A device whose mass and damping depend on the finger's position, such as an arm."""

    def effective_mass(self, position: Sequence[float]) -> FloatArray: ...

    def effective_friction(self, position: Sequence[float]) -> FloatArray: ...


@dataclass(frozen=True, eq=False)
class Mechanics:
    """Properties of devices and hands for n fingers in d dimensions.

    Attributes:
        mass, friction: Mass [kg] and friction [N s/m] of the device of each finger, (n, d, d).
        stiffness, damping: Stiffness [N/m] and damping [N s/m] of the hands, (n d, n d).
        delay: Delay of the displayed force of each finger, (n,) [samples].
        lateness: Additional time from the reading of a position to the displayed force, (n,) [s].
        age: Age of the positions when they are read, (n,) [s].
        jitter: 1st and 99th percentiles of the lateness, (2, n) [s]; both are the lateness if they were not measured.
        round_trip: Part of the lateness that reading and writing take, (n,) [s].
        hardware: Mask of the fingers on real devices, (n,).
        assumed: Sentences about properties that are unknown and assumed to be zero, or that are neglected or not
            simulated.
    """

    mass: FloatArray
    friction: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    delay: NDArray[np.int64]
    lateness: FloatArray
    age: FloatArray
    jitter: FloatArray
    round_trip: FloatArray
    hardware: NDArray[np.bool_]
    assumed: tuple[str, ...]


def mechanics(parts: Parts, position: FloatArray, hands: Sequence[StillHand]) -> Mechanics:
    """Compute the mechanics of a scene's devices, for positions (n, d) of the fingers [m], and of its hands.

    Raises:
        InputError: If a device does not report its mass or friction; the message names the fingers of the device.
    """
    n, d = position.shape
    mass, friction = np.zeros((n, d, d)), np.zeros((n, d, d))
    delay = np.zeros(n, dtype=np.int64)
    lateness, age, round_trip, jitter = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((2, n))
    hardware = np.zeros(n, dtype=bool)
    assumed: set[str] = set()
    for wire in parts.wires:
        used = wire.used
        own_mass, own_friction = _mass_and_friction(parts.scene, used, wire.features)
        assumed.update(_assumed(wire, [parts.scene.finger_names[i] for i in used]))
        lateness[used], age[used] = wire.features.lateness or 0.0, wire.features.latency or 0.0
        jitter[:, used] = np.array(wire.fitting.jitter or (wire.features.lateness or 0.0,) * 2)[:, None]
        round_trip[used], hardware[used] = wire.fitting.round_trip, is_hardware(wire.device)
        delay[used] = wire.features.delay or 0
        for i in used:
            if isinstance(wire.device, Postured) and not MECHANICAL & wire.fitting.measures.keys():
                mass[i], friction[i] = _in_posture(wire.device, wire.fitting.frame, position[i])
            else:
                mass[i], friction[i] = own_mass * np.eye(d), own_friction * np.eye(d)
    K, B = np.zeros((n, d, n, d)), np.zeros((n, d, n, d))
    for still in hands:
        for total, part in ((K, still.hand.stiffness), (B, still.hand.damping)):
            for a in range(d):
                total[np.ix_(still.fingers, [a], still.fingers, [a])] = part[a][:, None, :, None]
    return Mechanics(
        mass, friction, K.reshape(n * d, n * d), B.reshape(n * d, n * d), delay, lateness, age, jitter, round_trip,
        hardware, tuple(sorted(assumed)),
    )  # fmt: skip


def _assumed(wire: Wire, names: Sequence[str]) -> Iterator[str]:
    """Yield sentences about properties of a device that are unknown, neglected or not simulated."""
    features, who = wire.features, ", ".join(names)
    if features.delay is None and features.lateness is None:
        yield "no output delay for devices that do not report it"
    if features.resolution:
        yield "the encoder resolution is neglected"
    late = (features.lateness or 0.0) + (features.latency or 0.0)
    if late and isinstance(wire.device, SimulatedDevice):
        yield f"forces of {who} {1e3 * late:.3g} ms late, as measured; a simulation does not include this delay"


def _in_posture(device: Postured, frame: Frame | None, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    if frame is None:
        return device.effective_mass(position.tolist()), device.effective_friction(position.tolist())
    own = frame.back(position).tolist()
    return frame.impedance(device.effective_mass(own)), frame.impedance(device.effective_friction(own))


def _mass_and_friction(scene: Scene, fingers: NDArray[np.intp], features: Features) -> tuple[float, float]:
    if features.mass is not None and features.friction is not None:
        return features.mass, features.friction
    lacking = [name for name in ("mass", "friction") if getattr(features, name) is None]
    raise InputError(
        f"the device of {', '.join(scene.finger_names[i] for i in fingers)}", None,
        f"a device that reports its {' and '.join(lacking)}",
        "a stability limit depends on mass and friction (viscous damping [N s/m]) at a fingertip; set them in the "
        "driver's features, or give the driver the settings that determine them",
    )  # fmt: skip
