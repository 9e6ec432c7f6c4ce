"""Promises of every scene: it runs without a fault, repeats to the bit, and makes no energy of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.objects import integrators as body
from graspfx.testing.promise import Promise

if TYPE_CHECKING:
    from graspfx.loop.columns import Layout
    from graspfx.loop.device import Device
    from graspfx.loop.servo import Servo
    from graspfx.recording.history import ObjectMotion
    from graspfx.recording.record import Recording
    from graspfx.recording.recorder import Recorder
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
Number = tuple[str | Callable[["Recording"], Any], Any, float]

ROUNDING = 64.0 * np.finfo(float).eps  # of a sum over fingers, relative to its terms
TOGETHER = 300  # ticks that two servos run in turns
MOST_NUMBERS = 20  # numbers in a message
SMALL_SHARE = 1e-3  # of the largest energy in the ledger


def check_scene(
    scene: Scene | str | PathLike[str] | Callable[[], Scene],
    *,
    duration: float | None = None,
    energy: float | None = SMALL_SHARE,
    number: Number | Sequence[Number] = (),
) -> Recording:
    """Check that a scene of simulated devices keeps its promises; ConformanceError at the first broken one.

    It loads, says its plan and runs without a fault; everything recorded is finite; two runs are the same to the bit;
    the wrench on each object is the sum of its fingers' forces, and of their moments about its centre, to rounding;
    devices are told the negative of the force on the object, and the energy that is recorded for them is that force
    times the way of the fingertip; two servos of the scene built at once share no memory and, run in turns, do what
    one does alone; energy is bounded; and the numbers that are pinned come out.

    **Energy bounded**: at every tick,

        A <= S_0 + W + H          what the coupling gives to the objects, it had,
        E <= E_0 + A + U + J      and what the objects have, they were given,

    each but for a share `energy` of its largest term so far. A is the work of the wrenches on the objects,
    sum f_v'(dx, turn); S_0 = sum 1/2 k |e_0|^2 what the coupling may hold at the start; W what the fingers put in,
    sum f'dp; E the objects' kinetic energy; U the work of gravity, m g'(x - x_0). H and J are what holding forces for a
    sample may make: a spring whose force lags behind its length, sum over samples of 1/2 k |de|^2, and the explicit
    integrator, and it alone, of 1/2 m |dv|^2 + 1/2 I |dw|^2; a loop that is not stable lives on them. k is the largest
    gain of the coupling and I the largest moment of inertia; e = p - c; d is the difference from one tick to the next;
    f, p, c are those of the recording. What the coupling keeps and what viscosity takes are not subtracted.

    Args:
        scene: one, or the name or path of one, or a function that makes it.
        duration: instead of the scene's own [s].
        energy: the share by which a bound may be exceeded, where the projector or the set of touching fingers changes
            or a turn is integrated; None for a scene whose coupling is known to create energy, as literal gain matrices
            and the reaction at the contact point do.
        number: (name, expected, tolerance), or several of them: a key of `Recording.summary`, or a function of the
            recording; arrays are compared entry by entry.

    Returns:
        The recording.
    """
    with _promise("it loads, and says its plan"):
        from graspfx.certificate.plan import plan

        scene_ = _scene(scene)
        list(plan(scene_))
    with _promise("it runs without a fault"):
        from graspfx.assembly.run import run

        recording = run(scene_, duration=duration)
    _check_recording(scene_, recording)
    _check_wrench(scene_, recording)
    with _promise("two runs are the same to the bit") as promise:
        again = run(scene_, duration=duration)
        promise.holds(np.array_equal(recording.rows, again.rows), "other rows in the second run")
    _check_together(scene_, recording)
    if energy is not None:
        _check_energy(scene_, recording, energy)
    numbers = [cast("Number", number)] if _is_one(number) else cast("Sequence[Number]", number)
    for name, expected, tolerance in numbers:
        _check_number(recording, name, expected, tolerance)
    return recording


def _promise(text: str) -> Promise:
    return Promise(text, "scene")


def _scene(source: Scene | str | PathLike[str] | Callable[[], Scene]) -> Scene:
    from graspfx.scene.load import to_scene
    from graspfx.scene.model import Scene

    if isinstance(source, Scene | str | PathLike):
        return to_scene(source)
    make: Any = source
    result: Any = make() if callable(make) else make
    if not isinstance(result, Scene):
        raise InputError("scene", result, "a scene, the name or path of one, or a function that makes one")
    return result


def _check_recording(scene: Scene, recording: Recording) -> None:
    with _promise("nothing goes wrong in a run") as promise:
        promise.holds(not recording.faults, f"{', '.join(map(str, recording.faults))}")
        promise.holds(recording.outcome.complete, "a run that broke off")
    with _promise("everything that is recorded is finite") as promise:
        for name in recording.layout.columns:
            good = np.isfinite(recording.array(name)).reshape(len(recording), -1).all(axis=1)
            promise.holds(good.all(), f"{name} is not from tick {int(np.argmin(good))} on")
    with _promise("its devices are simulated: another run is the same run") as promise:
        promise.holds(recording.true_position is not None, "a device without a plant")
    with _promise("energy at a device is its force, minus that on the object, times its fingertip's way") as promise:
        true = cast("FloatArray", recording.true_position)
        work = -(recording.finger_force[:-1] * np.diff(true, axis=0)).sum(axis=2)
        change = np.diff(recording.device_energy, axis=0)
        scale = np.abs(work).sum() + np.abs(recording.device_energy).max(initial=0.0)
        off = float(np.abs(change - work).max(initial=0.0))
        promise.holds(off <= ROUNDING * max(scale, np.finfo(float).tiny), f"{off} J of difference in a sample")


def _check_wrench(scene: Scene, recording: Recording) -> None:
    """Check f_v = G f (eq. 2), with moments about each object's centre from where the reaction acts."""
    at_contact = scene.coupling.reaction == "contact"
    with _promise(
        "the wrench on an object is the sum of its fingers' forces and of their moments about its centre"
    ) as promise:
        d = scene.dimensions
        places = recording.contact_position if at_contact else recording.finger_position
        moments = recording.finger_moment
        for number, (name, motion) in enumerate(recording.objects.items()):
            own = [i for i, thing in enumerate(recording.layout.finger_objects) if thing == number]
            f, r = recording.finger_force[:, own], places[:, own] - motion.position[:, None, :]
            total = f.sum(axis=1)
            scale = np.abs(f).sum()
            off = float(np.abs(motion.wrench[:, :d] - total).max(initial=0.0))
            promise.holds(off <= ROUNDING * scale, f"{off} N of difference on {name}")
            if d == 1:
                continue
            turn = np.cross(r, f) if d == 3 else (r[..., 0] * f[..., 1] - r[..., 1] * f[..., 0])[..., None]
            if moments is not None:
                turn = turn + (moments[:, own] if d == 3 else moments[:, own, -1:])
                scale += np.abs(moments[:, own]).sum()
            reach = 1.0 + np.abs(places).max(initial=0.0) + np.abs(motion.position).max(initial=0.0)
            off = np.abs(motion.wrench[:, d:] - turn.sum(axis=1)).max(axis=1)
            allowed = ROUNDING * scale * reach + _ahead_of_sample(scene, number, motion) * np.linalg.norm(total, axis=1)
            k = int(np.argmax(off - allowed))
            promise.holds(off[k] <= allowed[k], f"{off[k]} N m of difference on {name} at tick {k}")


def _ahead_of_sample(scene: Scene, number: int, motion: ObjectMotion) -> FloatArray:
    """Bound how far from the recorded centre moments may refer, (N,) [m]: implicit, to the free motion, v T."""
    table = scene.object[number]
    if table.dynamics != "native" or table.integrator != "implicit":
        return np.zeros(len(motion.position))
    g = 0.0 if scene.gravity is None else float(np.linalg.norm(scene.gravity))
    return np.asarray(scene.period * (np.linalg.norm(motion.velocity, axis=1) + g * scene.period))


def _check_energy(scene: Scene, recording: Recording, share: float) -> None:
    from graspfx.assembly.build import build

    with build(scene) as servo:
        coupling, objects = _accounts(scene, recording, [part.grasped.body_state for part in servo.objects])
    for account, text in (
        (coupling, "energy is bounded: the coupling gives no more than the fingers put in"),
        (objects, "energy is bounded: the objects gain no more than the coupling and gravity give"),
    ):
        with _promise(text) as promise:
            over = account.gained - account.had - share * account.scale
            k = int(np.argmax(over))
            promise.holds(
                over[k] <= 0.0,
                f"{account.gained[k]:.6g} J at {recording.time[k]:g} s, of {account.had[k]:.6g} J to be had; "
                f"{share:g} of {account.scale[k]:.3g} J are allowed for",
            )


@dataclass(frozen=True)
class _Account:
    """An energy account over time: the gain and what there was for it, (N,) [J].

    Attributes:
        gained: so far.
        had: what there was to be gained.
        scale: the largest of the terms so far, to measure a difference by.
    """

    gained: FloatArray
    had: FloatArray
    scale: FloatArray


def _accounts(scene: Scene, recording: Recording, bodies: Sequence[FloatArray]) -> tuple[_Account, _Account]:
    """Keep the coupling's account, A against S_0 + W + H, and the objects', E against E_0 + A + U + J.

    Args:
        bodies: the objects' blocks (`graspfx.objects.integrators`), for their masses and moments of inertia.
    """
    N, d = len(recording), scene.dimensions
    k = _stiffest(scene)
    f, p, c = recording.finger_force, recording.finger_position, recording.contact_position
    e = p - c  # (N, n, d) [m]
    put_in = _summed((f[:-1] * np.diff(p, axis=0)).sum(axis=(1, 2)))
    stored = 0.5 * k * _summed((np.diff(e, axis=0) ** 2).sum(axis=(1, 2)))
    at_first = 0.5 * k * float((e[0] ** 2).sum())
    kinetic, work, weight_work, stepped = (np.zeros(N) for _ in range(4))
    g = np.zeros(d) if scene.gravity is None else np.array(scene.gravity)
    for table, motion, block in zip(scene.object, recording.objects.values(), bodies, strict=True):
        m, largest = float(block[body.MASS]), float(block[body.INERTIA : body.INERTIA + 3].max())
        x, v, w = motion.position, motion.velocity, motion.angular_velocity
        kinetic += 0.5 * m * (v**2).sum(axis=1) + _turning(motion, block)
        weight_work += m * (x - x[0]) @ g
        work += _summed((motion.wrench[:-1, :d] * np.diff(x, axis=0)).sum(axis=1))
        if motion.orientation is not None:
            work += _summed((motion.wrench[:-1, d:] * _turns(motion.orientation)).sum(axis=1))
        if table.dynamics == "native" and table.integrator == "explicit":
            stepped += 0.5 * m * _summed((np.diff(v, axis=0) ** 2).sum(axis=1))
            if w is not None:
                stepped += 0.5 * largest * _summed((np.diff(w.reshape(N, -1), axis=0) ** 2).sum(axis=1))
    coupling = _Account(work, at_first + put_in + stored, _largest(work, put_in, stored, at_first))
    objects = _Account(
        kinetic, kinetic[0] + work + weight_work + stepped, _largest(kinetic, work, weight_work, stepped)
    )
    return coupling, objects


def _largest(*terms: FloatArray | float) -> FloatArray:
    return np.maximum.accumulate(np.max(np.abs(np.broadcast_arrays(*terms)), axis=0))


def _summed(steps: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(steps)])


def _stiffest(scene: Scene) -> float:
    """Find the largest gain in any direction [N/m]."""
    largest = 0.0
    for gains in (scene.coupling.external.stiffness, scene.coupling.internal.stiffness):
        values = np.asarray(gains, dtype=float)
        largest = max(largest, float(values.max() if values.ndim < 2 else np.linalg.eigvalsh(values).max()))
    return largest


def _turns(orientation: FloatArray) -> FloatArray:
    """Compute rotations from tick to tick, (N - 1, 1 | 3) [rad], in world axes: exact about an axis that stays."""
    if orientation.ndim == 1:
        return np.diff(orientation)[:, None]
    a, b = orientation[:-1], orientation[1:]
    v = a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(b[:, :3], a[:, :3])  # of b a'
    w = (a * b).sum(axis=1)
    s = np.linalg.norm(v, axis=1)
    angle = 2.0 * np.arctan2(s * np.sign(w), np.abs(w))
    return v * np.where(s > 0.0, angle / np.where(s > 0.0, s, 1.0), 0.0)[:, None]


def _turning(motion: ObjectMotion, block: FloatArray) -> FloatArray:
    """Compute 1/2 w'R I R'w, (N,) [J]."""
    w, q = motion.angular_velocity, motion.orientation
    moments = block[body.INERTIA : body.INERTIA + 3]
    if w is None or q is None:
        return np.zeros(len(motion.position))
    if w.ndim == 1:
        return 0.5 * float(moments[2]) * w**2
    turn = 2.0 * np.cross(-q[:, :3], w)
    own = w + q[:, 3:] * turn + np.cross(-q[:, :3], turn)  # in the body's axes
    return 0.5 * np.asarray(own**2 @ moments)


class _Listener:
    """A device, and what it was told."""

    def __init__(self, device: Device) -> None:
        self.device, self.forces = device, [np.zeros((0, 0))]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)

    def write(self, forces: FloatArray) -> None:
        self.forces[0] = forces.copy()
        self.device.write(forces)


def _check_together(scene: Scene, recording: Recording) -> None:
    """Run two servos at once, tick by tick in turns, and listen to the devices of both."""
    from graspfx.assembly.build import build
    from graspfx.loop.parts import DeviceWiring
    from graspfx.recording.header import Header
    from graspfx.recording.recorder import Recorder

    ticks = min(len(recording), TOGETHER)
    with ExitStack() as stack:
        with _promise("two servos of a scene can be built at once"):
            pair = [stack.enter_context(build(scene)) for _ in range(2)]
        with _promise("two servos of a scene share no memory") as promise:
            for a in _arrays(pair[0]):
                for b in _arrays(pair[1]):
                    promise.holds(not np.shares_memory(a, b), "an array that both of them write to")
        overheard = []
        for servo in pair:
            listener = [_Listener(station.device) for station in servo.stations]
            servo.stations = [
                DeviceWiring(cast("Device", each), station.fingers)
                for each, station in zip(listener, servo.stations, strict=True)
            ]
            overheard.append(listener)
        recorders: list[Recorder] = [Recorder(servo.layout, Header(scene.period)) for servo in pair]
        with _promise("devices are told minus the force on the object") as promise:
            for _ in range(ticks):
                for servo, recorder, listener in zip(pair, recorders, overheard, strict=True):
                    servo.tick(recorder)
                    recorder.drain()
                    force = _forces(servo.layout, servo.row)
                    for each, station in zip(listener, servo.stations, strict=True):
                        used = station.fingers >= 0
                        same = np.array_equal(each.forces[0][used], -force[station.fingers[used]])
                        promise.holds(same, f"{each.forces[0][used].tolist()} for {force.tolist()} on the object")
        with _promise("two servos run in turns do what one does alone") as promise:
            for recorder in recorders:
                rows = recorder.finish().rows
                promise.holds(np.array_equal(rows, recording.rows[:ticks]), "other rows than in a run of its own")


def _forces(layout: Layout, row: FloatArray) -> FloatArray:
    column = layout.columns["finger_force"]
    return row[column.where].reshape(column.shape)


def _arrays(servo: Servo) -> Iterator[FloatArray]:
    yield servo.row
    for part in servo.objects:
        yield part.grasped.block
    for station in servo.stations:
        yield from station.device.read()[:2]
    for group in servo.plants:
        yield group.plant.position
        yield group.plant.velocity


def _is_one(number: Any) -> bool:
    return len(number) == 3 and (isinstance(number[0], str) or callable(number[0]))


def _check_number(
    recording: Recording, name: str | Callable[[Recording], Any], expected: Any, tolerance: float
) -> None:
    label = name if isinstance(name, str) else getattr(name, "__name__", "a number")
    with _promise(f"{label} is {expected}, within {tolerance:g}") as promise:
        if isinstance(name, str):
            summary = recording.summary()
            if name not in summary:
                raise InputError("number", name, f"a key of the summary: {', '.join(summary)}")
            value = summary[name]
        else:
            value = name(recording)
        promise.holds(value is not None, "None")
        off = np.abs(np.asarray(value, dtype=float) - np.asarray(expected, dtype=float))
        promise.holds((off <= tolerance).all(), _worst(np.asarray(value), off))


def _worst(values: FloatArray, off: FloatArray) -> str:
    """Say the finding; of many numbers, the one that is farthest off and its place."""
    if values.size <= MOST_NUMBERS or values.shape != off.shape:
        return f"{values.tolist()}"
    place = np.unravel_index(int(np.argmax(np.where(np.isnan(off), np.inf, off))), off.shape)
    return f"{values[place]} at {[int(i) for i in place]}, the farthest of {values.size}"
