"""The hosts of docs/how-to/feedback.md with simulated devices: a plain loop, MuJoCo's two hands, PyBullet, C."""

import os
import shutil
import subprocess

import numpy as np
import pytest

import graspfx as gx
from graspfx.system.shared_memory import file_of
from tests.support import feedback_page as page

PLAIN, MUJOCO, BULLET = page.blocks("python")
GRIPPER, HAND = page.blocks("xml")
DURATION = 3.0  # the hand closes at once, lifts from 1 to 1.8 s, and holds


def loop(folder, name, **overrides):
    return page.scene(folder, **{"host.name": f"{name}-{os.getpid()}", "host.silence": 5.0, **overrides})


def near(given, expected):
    """Within the 2 % that the page promises of steady grasps."""
    return given == pytest.approx(expected, rel=0.02)


def test_every_host_is_short():
    for block in (PLAIN, MUJOCO, BULLET, *page.blocks("c")):
        assert page.code_lines(block) <= page.LONGEST


def test_a_plain_loop(tmp_path):
    """Hand and wall in series: 300 N/m from the rest at 8 mm, 400 N/m from 20 mm, which are 12 mm apart."""
    rows = []

    def watch(shown, hand, space):
        if space["time"] > 1.0:
            rows.append((*shown.fingers[:, 0], shown.grip, *hand.force[:, 0]))

    page.run_host(PLAIN, loop(tmp_path, "plain"), 1.5, watch=watch)
    series = 0.012 / (1.0 / 300.0 + 1.0 / 400.0)
    thumb, index, grip, *shown = np.mean(rows, axis=0)
    assert near(thumb, -series)
    assert near(index, series)
    assert near(grip, -series)
    assert near(shown[0], -series)
    assert near(shown[1], series)


def steady(name, block, folder, model, fingers):
    """Run a MuJoCo host and give what was shown over the last half second, with the simulation's own account."""
    rows = []

    def watch(shown, hand, space):
        data, mujoco = space["data"], space["mujoco"]
        if data.time > DURATION - 0.5:
            closing = [data.joint(f"finger{i}_closes").qfrc_constraint[0] for i in range(fingers)]
            rows.append((shown.grip, *shown.push, -np.mean(closing), *hand.force.sum(axis=0), hand.centre[2]))
            assert mujoco.mjVERSION_HEADER > 0

    (folder / "model.xml").write_text(model, encoding="utf-8")
    names = {"MODEL": str(folder / "model.xml")}
    page.run_host(block, loop(folder, name), DURATION, names, watch)
    return np.mean(rows, axis=0)


def test_a_gripper_in_mujoco(tmp_path):
    """It holds 0.1 kg: the push is the weight; the grip is half of the joints' constraint forces, which open it."""
    grip, *push, closing, _, _, shown, height = steady("gripper", MUJOCO, tmp_path, GRIPPER, 2)
    assert near(push[2], -0.1 * 9.81)
    assert np.abs(push[:2]).max() < 0.02
    assert closing > 1.0
    assert near(grip, -0.5 * closing)
    assert near(shown, -0.1 * 9.81)  # by the device, in the loop
    assert height > 0.02


def test_a_hand_with_three_fingers_in_mujoco(tmp_path):
    grip, *push, closing, _, _, shown, _ = steady("hand", MUJOCO, tmp_path, HAND, 3)
    assert near(push[2], -0.1 * 9.81)
    assert np.abs(push[:2]).max() < 0.02
    assert closing > 1.0
    assert near(grip, -0.5 * closing)
    assert near(shown, -0.1 * 9.81)


def test_pybullet(tmp_path):
    """Two springs of 400 N/m press the balls: 400 N/m times what is left to their targets, half of it at gain 0.5."""
    pytest.importorskip("pybullet")
    rows = []

    def watch(shown, hand, space):
        if space["time"] > 1.0:
            x = [space["p"].getBasePositionAndOrientation(finger)[0][0] for finger in space["fingers"]]
            target = hand.aperture / 2.0 + 0.005
            rows.append((shown.grip, 400.0 * (0.5 * (x[1] - x[0]) - target), shown.push[0]))

    page.run_host(BULLET, loop(tmp_path, "bullet"), 1.5, watch=watch)
    grip, pressed, push = np.mean(rows, axis=0)
    assert pressed > 0.5
    assert near(grip, -0.5 * pressed)
    assert abs(push) < 0.02


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c(tmp_path):
    """The same wall as in Python: 1 N on each finger of a hand that stays 2.5 mm inside, in the internal part alone."""
    source, program = tmp_path / "host.c", tmp_path / "host"
    source.write_text(page.blocks("c")[0], encoding="utf-8")
    subprocess.run(["cc", "-O2", "-Wall", "-Werror", "-o", program, source], check=True)
    scene = loop(tmp_path, "c")
    with gx.open(scene, real_time=True) as session:
        host = subprocess.Popen([program, file_of(scene.host.name)])
        session.wait(2.0)
        host.kill()
        host.wait()
        assert session.fault is None
    recording = session.recording
    force, where = recording.displayed_force[-300:-1, :, 0], recording.finger_position[-300:-1, :, 0]
    assert near(force[:, 1].mean(), (400.0 * (0.02 - where[:, 1])).mean())
    assert near(force[:, 0].mean(), -force[:, 1].mean())
    assert force[:, 1].mean() > 0.5


def test_a_host_that_is_killed_ends_the_force(tmp_path):
    """As a process that dies writes no more: forces fade after `host.silence`, the run goes on at zero and says so."""
    source, program = tmp_path / "host.c", tmp_path / "host"
    source.write_text(page.blocks("c")[0], encoding="utf-8")
    subprocess.run(["cc", "-O2", "-o", program, source], check=True)
    scene = loop(tmp_path, "killed", **{"host.silence": 0.3})
    with gx.open(scene, real_time=True) as session:
        host = subprocess.Popen([program, file_of(scene.host.name)])
        session.wait(1.0)
        host.kill()
        host.wait()
        session.wait(1.0)
        fault = session.fault
        assert not session.recording.displayed_force[-1].any()
    assert "host.silence" in str(fault)
    assert np.abs(session.recording.displayed_force).max() > 0.5
