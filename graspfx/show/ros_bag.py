"""Recordings as ROS 1 and ROS 2 bags: poses, twists and wrenches as stamped messages of geometry_msgs."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError, MissingPackageError, RecordingError, UnknownNameError
from graspfx.recording.files import placing, recording_path, require_vacancy
from graspfx.show.picture.instant import lifted

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

FloatArray = NDArray[np.float64]

BAGS = {"bag": ".bag", "mcap": ".mcap", "db3": ".db3"}  # ROS 1, and ROS 2 in its two file formats
FRAME = "world"  # frame of every message
VERSION: Literal[9] = 9  # version of the metadata of ROS 2 bags
POSE, TWIST, WRENCH = (f"geometry_msgs/msg/{name}Stamped" for name in ("Pose", "Twist", "Wrench"))
SECOND = 1_000_000_000  # [ns]


class Topic(NamedTuple):
    """A topic with one message for each of the N rows of a recording.

    Attributes:
        name: Name of the topic, such as "/fingers/thumb/wrench".
        kind: Type of the messages.
        linear: Position [m], velocity [m/s] or force [N] (N, 3).
        angular: Quaternion x, y, z, w (N, 4), angular velocity [rad/s] or moment [N m] (N, 3).
    """

    name: str
    kind: str
    linear: FloatArray
    angular: FloatArray


def topics(recording: Recording) -> Iterator[Topic]:
    """Yield the topics of a recording.

    A finger has topics for its pose (without rotation), its twist, and the total, internal and external wrench that it
    exerts on the object. An object has topics for its pose, its twist and the wrench exerted on it. All data are in
    space: a line becomes the x axis, and a plane becomes the plane of x and y. Values may be NaN or infinite;
    `write_bag` omits messages with such values.
    """
    rows, columns = len(recording), recording.layout.columns
    unturned = np.tile([0.0, 0.0, 0.0, 1.0], (rows, 1))
    nothing = np.zeros((rows, 3))
    moments: Mapping[str, FloatArray | None] = {
        "": recording.finger_moment if "finger_moment" in columns else None,
        "internal_": recording.internal_moment if "finger_moment" in columns else None,
        "external_": recording.external_moment if "finger_moment" in columns else None,
    }
    for i, finger in enumerate(recording.layout.fingers):
        home = f"/fingers/{_word(finger)}"
        yield Topic(f"{home}/pose", POSE, lifted(recording.finger_position[:, i], 3), unturned)
        yield Topic(f"{home}/twist", TWIST, lifted(recording.finger_velocity[:, i], 3), nothing)
        for part in ("", "internal_", "external_"):
            force = recording.finger_force if not part else getattr(recording, f"{part}force")
            moment = moments[part]
            angular = nothing if moment is None else _spatial(moment[:, i])
            yield Topic(f"{home}/{part}wrench", WRENCH, lifted(force[:, i], 3), angular)
    for name in recording.layout.objects:
        motion, home = recording.objects[name], f"/objects/{_word(name)}"
        yield Topic(f"{home}/pose", POSE, lifted(motion.position, 3), _quaternions(motion.orientation, rows))
        spin = nothing if motion.angular_velocity is None else _spatial(motion.angular_velocity)
        yield Topic(f"{home}/twist", TWIST, lifted(motion.velocity, 3), spin)
        d = recording.layout.dimensions
        torque = motion.wrench[:, d:]
        angular = _spatial(torque if torque.shape[1] != 1 else torque[:, 0]) if torque.shape[1] else nothing
        yield Topic(f"{home}/wrench", WRENCH, lifted(motion.wrench[:, :d], 3), angular)


def write_bag(recording: Recording, path: str | PathLike[str], kind: str, *, overwrite: bool = False) -> None:
    """Write a recording as a bag.

    Args:
        recording: Recording with all columns of poses, velocities, forces and moments.
        path: Path of the file to write.
        kind: "bag" for ROS 1, "mcap" or "db3" for ROS 2.
        overwrite: Whether to replace an existing file.

    Raises:
        MissingPackageError: If rosbags is not installed.
        RecordingError: If the file exists or cannot be written, or the recording has no rows or lacks required columns.
        InputError: If the path names no file.
        UnknownNameError: If the kind is unknown.
    """
    if kind not in BAGS:
        raise UnknownNameError("kind of bag", kind, BAGS)
    place = recording_path(path, "path")
    if not place.name:
        raise InputError("path", str(path), "the path of a file, such as recording.mcap")
    if not overwrite:
        require_vacancy([place])
    _require_rosbags()
    with placing(place) as draft:
        if kind == "bag":
            draft.unlink(missing_ok=True)
            _write_one(recording, draft)
        else:
            _write_two(recording, draft, kind)


def stamps(recording: Recording) -> NDArray[np.int64]:
    """Compute the time of each row since 1970-01-01 UTC [ns].

    It is the recording's time of creation, rounded to 1 s, plus the time of the row in the run.
    """
    try:
        start = round(datetime.fromisoformat(recording.header.created).timestamp()) * SECOND
    except ValueError:
        start = SECOND  # zero means "no time" in ROS
    return start + np.round(recording.time * SECOND).astype(np.int64)


def _write_one(recording: Recording, file: Path) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS1_NOETIC)
    with Writer(file) as writer:
        _write(recording, writer, store, store.serialize_ros1, with_number=True)


def _write_two(recording: Recording, file: Path, kind: str) -> None:
    """Write a ROS 2 bag as a single file, without the folder and the metadata file that usually surround it."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with tempfile.TemporaryDirectory(dir=file.parent, prefix=".bag-") as home:
        folder = Path(home) / "recording"
        with Writer(folder, version=VERSION, storage_plugin=plugin) as writer:
            _write(recording, writer, store, store.serialize_cdr, with_number=False)
        (inside,) = folder.glob(f"*{BAGS[kind]}")
        shutil.move(inside, file)


def _write(
    recording: Recording, writer: Any, store: Any, serialize: Callable[[Any, str], Any], *, with_number: bool
) -> None:  # fmt: skip
    """Write the messages of all topics in the order of time; omit messages with NaN or infinite values."""
    times = stamps(recording).tolist()
    every = list(topics(recording))
    if not times:
        raise RecordingError("the recording has no rows to write to a bag")
    connections = [writer.add_connection(each.name, each.kind, typestore=store) for each in every]
    make = _maker(store, with_number=with_number)
    rows: list[Any] = [
        (each.kind, each.linear.tolist(), each.angular.tolist(),
         (np.isfinite(each.linear).all(axis=1) & np.isfinite(each.angular).all(axis=1)).tolist())
        for each in every
    ]  # fmt: skip
    for k, time in enumerate(times):
        for connection, (kind, linear, angular, is_there) in zip(connections, rows, strict=True):
            if is_there[k]:
                message = make(kind, k, time, linear[k], angular[k])
                writer.write(connection, time, serialize(message, kind))


def _maker(store: Any, *, with_number: bool) -> Callable[..., Any]:
    types = store.types
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    vector, point = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Point"]
    quaternion, pose = types["geometry_msgs/msg/Quaternion"], types["geometry_msgs/msg/Pose"]
    plain = {TWIST: types["geometry_msgs/msg/Twist"], WRENCH: types["geometry_msgs/msg/Wrench"]}

    def make(kind: str, number: int, time: int, linear: list[float], angular: list[float]) -> Any:
        clock = stamp(sec=time // SECOND, nanosec=time % SECOND)
        first = header(seq=number, stamp=clock, frame_id=FRAME) if with_number else header(stamp=clock, frame_id=FRAME)
        if kind == POSE:
            return types[kind](first, pose(point(*linear), quaternion(*angular)))
        return types[kind](first, plain[kind](vector(*linear), vector(*angular)))

    return make


def _word(name: str) -> str:
    """Convert a name to a valid part of a topic name: letters, digits and "_", with no digit at the start."""
    text = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in name)
    return text if text[:1].isalpha() else f"_{text}"


def _spatial(spin: FloatArray) -> FloatArray:
    """Convert angular velocities or moments to vectors (N, 3); the scalar values of a plane are the z components."""
    if spin.ndim == 2 and spin.shape[1] == 3:
        return spin
    vectors = np.zeros((len(spin), 3))
    vectors[:, 2] = spin.reshape(len(spin))
    return vectors


def _quaternions(turn: FloatArray | None, rows: int) -> FloatArray:
    """Convert orientations to quaternions x, y, z, w (N, 4).

    Args:
        turn: Quaternions (N, 4); angles about z (N,) [rad]; or None for no rotation.
        rows: Number of rows N.
    """
    if turn is not None and turn.ndim == 2:
        return turn
    angle = np.zeros(rows) if turn is None else turn
    quaternions = np.zeros((rows, 4))
    quaternions[:, 2], quaternions[:, 3] = np.sin(0.5 * angle), np.cos(0.5 * angle)
    return quaternions


def _require_rosbags() -> None:
    try:
        import rosbags  # noqa: F401 (whether it is there)
    except ImportError as error:
        raise MissingPackageError.of_extra("rosbags", "a bag", "ros") from error
