"""ROS bags: every number of a recording, read back by the package that reads bags."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.errors import MissingPackageError, RecordingError
from graspfx.show.ros_bag import BAGS, stamps, topics, write_bag

pytest.importorskip("rosbags", reason="bags of ROS: pip install 'graspfx[ros]'")
SCENES = {"reference-1dof": 0.05, "paper-waving-turning": 0.05, "sphere-three-fingers": 0.02}


def numbers_of(message: Any) -> tuple[list[float], list[float]]:
    if hasattr(message, "pose"):
        linear, turn = message.pose.position, message.pose.orientation
        angular = [turn.x, turn.y, turn.z, turn.w]
    else:
        parts = message.twist if hasattr(message, "twist") else message.wrench
        linear, spin = (parts.linear, parts.angular) if hasattr(message, "twist") else (parts.force, parts.torque)
        angular = [spin.x, spin.y, spin.z]
    return [linear.x, linear.y, linear.z], angular


@pytest.mark.parametrize("name", SCENES)
def test_every_number_comes_back(name: str, tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader

    recording = gx.run(name, {"engine": "interpreted"}, duration=SCENES[name])
    expected = {topic.name: topic for topic in topics(recording)}
    d, thumb = recording.layout.dimensions, expected[f"/fingers/{recording.layout.fingers[0]}/wrench"]
    assert np.array_equal(thumb.linear[:, :d], recording.finger_force[:, 0])
    assert len(expected) == 5 * len(recording.layout.fingers) + 3 * len(recording.layout.objects)
    for kind, ending in BAGS.items():
        path = tmp_path / f"bag{ending}"
        write_bag(recording, path, kind)
        counts = dict.fromkeys(expected, 0)
        with AnyReader([path]) as reader:
            for connection, time, data in reader.messages():
                message: Any = reader.deserialize(data, connection.msgtype)
                topic, k = expected[connection.topic], counts[connection.topic]
                assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == time == stamps(recording)[k]
                linear, angular = numbers_of(message)
                assert linear == topic.linear[k].tolist() and angular == topic.angular[k].tolist()
                assert message.header.frame_id == "world" and connection.msgtype == topic.kind
                counts[connection.topic] += 1
        assert set(counts.values()) == {len(recording)}
        with pytest.raises(RecordingError, match="exists already"):
            write_bag(recording, path, kind)


def test_the_command_writes_bags(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gx.run("reference-1dof", {"engine": "interpreted"}, duration=0.05, out=tmp_path)
    assert main(["export", str(tmp_path), "--format", "rosbag"]) == 0
    assert main(["export", str(tmp_path), "--out", str(tmp_path / "one.bag")]) == 0
    assert main(["export", str(tmp_path), "--format", "bag", "--out", str(tmp_path / "one.mcap")]) == 2
    assert "a file that ends in .bag" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"recording.h5", "recording.mcap", "one.bag"}


def test_what_is_missing_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = gx.run("reference-1dof", {"engine": "interpreted"}, duration=0.05)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(MissingPackageError, match=r"graspfx\[ros\]"):
        write_bag(recording, tmp_path / "a.bag", "bag")
