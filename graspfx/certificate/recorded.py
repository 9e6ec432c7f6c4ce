"""State of a grasp in the last row of a recording, and the delays of forces that a recording contains."""

from __future__ import annotations

from os import PathLike

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.loop import radius_of
from graspfx.assembly.mechanics import Mechanics
from graspfx.certificate.grip import Grip, Ground, bearers
from graspfx.certificate.operating_point import (
    NotGraspingError,
    OperatingPoint,
    incomplete,
    no_rest_error,
    operating_point,
)
from graspfx.cones.problem import STICK
from graspfx.coupling.grasp_state import FingerState
from graspfx.errors import InputError
from graspfx.objects import integrators as body
from graspfx.objects.body_state import BodyState
from graspfx.recording.record import Recording
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

LAST = 0.1  # time during which forces at rest must not change [s]
CALM = 1e-3  # largest change of a force in that time, relative to the largest force
SAME = 1e-3  # largest difference of recorded forces from those of the scene's gains, relative to the largest force
BORNE = 1e-2  # remainder of the forces on the object above which something else carries it, relative to the largest
ENDS = (1.0, 99.0)  # percentiles of the samples
COLUMNS = ("late", "io")  # columns of a real-time run


def recording_of(scene: Scene, source: Recording | str | PathLike[str]) -> Recording:
    """Return a recording, which is loaded if a path is given, after checking that it is of this scene.

    Raises:
        InputError: If the recording has other fingers, objects or dimensions than the scene, or has no rows.
        RecordingError: If the file at the path is missing or not a recording.
    """
    recording = source if isinstance(source, Recording) else Recording.load(source)
    layout = recording.layout
    has = (layout.dimensions, tuple(layout.fingers), tuple(layout.objects))
    wants = (scene.dimensions, tuple(scene.finger_names), tuple(thing.name for thing in scene.object))
    if has != wants:
        raise InputError(
            "recording",
            f"{has[0]} dimensions, fingers {', '.join(has[1])}, objects {', '.join(has[2])}",
            f"one of this scene: {wants[0]} dimensions, fingers {', '.join(wants[1])}, objects {', '.join(wants[2])}",
        )
    if not len(recording):
        raise InputError(
            "recording", "no rows", "a recording with at least one row", "run the scene until the grasp is at rest"
        )
    return recording


def recorded(
    scene: Scene, index: int, grip: Grip, fingers: NDArray[np.intp], recording: Recording, ground: Ground | None
) -> OperatingPoint:  # fmt: skip
    """Set an object and its fingers to the state in the last row of a recording, and return this state.

    The positions of contacts and fingers and the pose of the object are those of the row. The forces are computed from
    these positions with the scene's gains. `assumed` of the result lists the differences between the recorded state and
    an equilibrium of the scene (`differences`).

    Raises:
        NotGraspingError: If no finger touches the object in the last row.
        NoRestError: If only some fingers touch the object in the last row, a finger pulls, or forces do not converge.
    """
    g, name = grip.grasped, scene.object[index].name
    place = OperatingPoint("recorded", None, np.full(grip.n, np.nan))
    touching = recording.touching[-1, fingers] | (scene.coupling.contact == "attached")
    if not touching.any():
        gaps = recording.gap  # missing if the recording has selected columns
        gap = float("nan") if gaps is None else float(gaps[-1, fingers].min())
        raise NotGraspingError(name, gap, "at the end of the recording")
    if not touching.all():
        raise incomplete(scene, index, fingers[~touching], "at the end of the recording")
    set_pose(grip, recording, name)
    set_contacts(grip, recording, fingers)
    if g.soft:
        set_torsions(grip, recording, fingers)
    with grip.frozen():
        now = grip.forces()
    if now is None:
        raise no_rest_error(name, "at the end of the recording the forces of a sample do not converge")
    place.assumed += differences(scene, index, grip, fingers, recording, ground)
    if not g.touching.all():
        raise no_rest_error(name, "at the end of the recording a finger pulls")
    return operating_point(name, grip, place)


def set_pose(grip: Grip, recording: Recording, name: str) -> None:
    """Set the object's pose to that in the last row of a recording; the object's velocity is not changed."""
    state, d, motion = grip.grasped.body_state, grip.d, recording.objects[name]
    state[body.POSITION : body.POSITION + d] = motion.position[-1]
    if motion.orientation is not None and d == 2:
        state[body.ANGLE] = motion.orientation[-1]
    elif motion.orientation is not None:
        state[body.QUATERNION : body.QUATERNION + 4] = motion.orientation[-1]
    body.orient(BodyState(state))


def set_contacts(grip: Grip, recording: Recording, fingers: NDArray[np.intp]) -> None:
    """Set positions of fingers and contacts to those in the last row of a recording; all contacts stick."""
    g, d = grip.grasped, grip.d
    c = recording.contact_position[-1, fingers]
    g.meet(c)  # finds faces and normals
    state = g.body_state
    R = state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
    wide = np.zeros((grip.n, 3))
    wide[:, :d] = c - state[body.POSITION : body.POSITION + d]
    g.array(FingerState.contact)[:] = wide @ R
    g.array(FingerState.touching)[:] = 1.0
    g.array(FingerState.status)[:] = STICK
    g.finger_position[:] = recording.finger_position[-1, fingers]


def set_torsions(grip: Grip, recording: Recording, fingers: NDArray[np.intp]) -> None:
    """Rotate the anchors of soft fingers so that the torsions of the fingers equal those in a recording's last row."""
    moments = recording.finger_moment
    g = grip.grasped
    at_anchor, patch = g.array(FingerState.torsion_at_anchor), g.array(FingerState.patch)
    g.array(FingerState.anchor)[:] = g.body_state[body.ROTATION : body.ROTATION + 9]
    at_anchor[:] = 0.0
    soft = np.flatnonzero(patch > 0.0)
    if moments is None or not len(soft):
        return
    torsions = (moments[-1, fingers] * g.inward()).sum(axis=1)[soft] / patch[soft]

    def torsion(retained: FloatArray) -> FloatArray:
        at_anchor[soft] = retained
        grip.forces()
        return np.array(g.array(FingerState.local)[soft, 3])

    length = 1e-4
    with grip.frozen():  # torsion is linear in the anchors' rotation
        none = torsion(np.zeros(len(soft)))
        slopes = np.stack([torsion(length * e) - none for e in np.eye(len(soft))], axis=1) / length
        at_anchor[soft] = np.linalg.solve(slopes, torsions - none)


def differences(
    scene: Scene, index: int, grip: Grip, fingers: NDArray[np.intp], recording: Recording, ground: Ground | None
) -> list[str]:  # fmt: skip
    """List differences between the state at the end of a recording and an equilibrium of the scene, as sentences."""
    g, texts = grip.grasped, []
    force = recording.finger_force[:, fingers]
    largest = max(float(np.abs(force[-1]).max(initial=0.0)), 1e-9)
    before = force[-min(len(force), round(LAST / recording.row_period) + 1) :]
    change = float(np.abs(before - force[-1]).max(initial=0.0)) / largest
    if change > CALM:
        texts.append(f"the recording is not at rest at its end: forces change by {100 * change:.2g} % in {LAST:g} s")
    off = float(np.abs(g.force - force[-1]).max(initial=0.0)) / largest
    if off > SAME:
        texts.append(f"the recorded forces differ from those of this scene's gains by up to {100 * off:.2g} %")
    full = np.zeros(6)
    if scene.gravity is not None:
        full[: grip.d] = float(g.body_state[body.MASS]) * np.array(scene.gravity)
    missing = (g.wrench[grip.rows_of_wrench] + full[grip.axes])[grip.axes < 3]
    scale = max(largest, float(np.abs(full).max(initial=0.0)))
    if ground is None and change <= CALM and np.abs(missing).max(initial=0.0) > BORNE * scale:
        who = ", ".join(bearers(scene, index)) or "something outside the scene"
        texts.append(
            f"{float(np.linalg.norm(missing)):.3g} N of the object's load are carried by {who}, which is ignored"
        )
    return texts


def exchange_times(recording: Recording) -> tuple[float, float] | None:
    """Return the 1st and 99th percentile of the time from a tick's scheduled start to the end of its writing [s].

    The time is the sum of the delay of the tick's start and of the times of reading from and writing to devices. It
    does not include the computation between reading and writing, which is not recorded. If a recording lacks the
    columns `late` and `io`, both values are the round trip in its header. The result is None without hardware.
    """
    if all(name in recording.layout.columns for name in COLUMNS) and recording.header.settled:
        late, calls = (recording.array(name) for name in COLUMNS)
        low, high = np.percentile(late + calls.sum(axis=1), ENDS)
        return max(float(low), 0.0), max(float(high), 0.0)
    trip = recording.header.round_trip
    return (trip, trip) if trip > 0.0 else None


def lateness_ends(mechanics: Mechanics, recording: Recording | None) -> FloatArray:
    """Return the smallest and the largest delay of the force of each finger, (2, n) [s].

    For fingers on hardware, the times in a recording (`exchange_times`) replace the round trip that the devices state.
    """
    times = None if recording is None else exchange_times(recording)
    if times is None:
        return mechanics.jitter
    own = np.maximum(mechanics.lateness - mechanics.round_trip, 0.0)
    ends = own + np.array(times)[:, None]
    return np.where(mechanics.hardware, ends, mechanics.jitter)


def less_stable(linear: Linearisation, ends: FloatArray) -> tuple[Linearisation, list[str]]:
    """Return the loop with the smallest or the largest delay of forces, whichever is less stable.

    The second item is a list with a sentence about the delay, which is empty if both delays are equal.

    Args:
        linear: Linearised loop.
        ends: Smallest and largest delay in each coordinate, (2, m) [s].
    """
    loops = [linear.with_arrays(lateness=each) for each in ends]
    if (ends[0] == ends[1]).all():
        return loops[1], []
    worse = int(radius_of(loops[1]) >= radius_of(loops[0]))
    low, high = (1e3 * float(each.max()) for each in ends)
    text = f"forces are {low:.3g} to {high:.3g} ms late in 98 % of the samples; judged at {(low, high)[worse]:.3g} ms"
    return loops[worse], [text]
