"""The doctor: settings of a system in a root of the test's own, jitter, round trips of hardware, and its report."""

from __future__ import annotations

import json
import os
import re
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspfx.__main__ import main
from graspfx.commands import doctor
from graspfx.devices.haply_2diy.emulator import DiyWire
from graspfx.loop.realtime.pacing import Lateness
from graspfx.loop.servo_parts import DeviceWiring
from graspfx.machine import system_checks, timing_checks
from graspfx.machine.system_checks import (
    Finding,
    clock_finding,
    governor_finding,
    lab_report,
    machine_kind,
    memory_finding,
    preemption_finding,
    priority_finding,
    sharing_finding,
    throttling_finding,
)
from tests.support.hardware import Fake, VirtualClock

LOOKS: dict[str, Any] = {
    "throttling": throttling_finding, "governor": governor_finding, "preemption": preemption_finding,
    "clock": clock_finding, "sharing": sharing_finding,
}  # fmt: skip
CLOCK = "sys/devices/system/clocksource/clocksource0/current_clocksource"
GOVERNOR = "sys/devices/system/cpu/cpu{}/cpufreq/scaling_governor"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(timing_checks, "WAKE_DURATION", 0.1)
    monkeypatch.setattr(timing_checks, "TRIP_DURATION", 0.1)


@pytest.mark.parametrize(
    ("look", "files", "text", "remedy"),
    [
        ("throttling", {}, "unknown", ""),
        ("throttling", {"proc/sys/kernel/sched_rt_runtime_us": "950000"}, "95% of each 1 s, which is enough", ""),
        ("throttling", {"proc/sys/kernel/sched_rt_runtime_us": "-1"}, "^none$", ""),
        ("throttling", {"proc/sys/kernel/sched_rt_runtime_us": "100000"}, "at most 10% of each 1 s$", "sysctl"),
        ("throttling", {"proc/sys/kernel/sched_rt_runtime_us": "much"}, "unknown", ""),
        ("governor", {}, "governor unknown", ""),
        ("governor", {GOVERNOR.format(0): "performance", GOVERNOR.format(1): "performance"}, "performance", ""),
        ("governor", {GOVERNOR.format(0): "performance", GOVERNOR.format(1): "powersave"}, "powersave", "cpupower"),
        ("preemption", {"sys/kernel/realtime": "1"}, "PREEMPT_RT", ""),
        ("preemption", {"proc/version": "Linux 6.6 #1 SMP PREEMPT_RT"}, "PREEMPT_RT$", ""),
        ("preemption", {"proc/version": "Linux 6.6 #1 SMP PREEMPT_DYNAMIC"}, "PREEMPT_DYNAMIC", ""),
        ("preemption", {"proc/version": "Linux 6.6 #1 SMP"}, "not in this kernel", "lowlatency"),
        (
            "preemption",
            {"proc/version": "Linux #1 SMP PREEMPT_DYNAMIC", "proc/cmdline": "quiet preempt=none"},
            "switched to none",
            "preempt=full",
        ),
        ("clock", {CLOCK: "tsc"}, "tsc", ""),
        ("clock", {CLOCK: "hpet"}, "hpet, which is slow", "dmesg"),
        ("sharing", {"proc/cpuinfo": "flags : fpu vme"}, "a physical machine", ""),
        ("sharing", {"proc/cpuinfo": "flags : fpu hypervisor"}, "a virtual machine", "do not run hardware"),
        ("sharing", {"sys/class/dmi/id/sys_vendor": "QEMU"}, r"a virtual machine \(QEMU\)", "do not run hardware"),
        ("sharing", {"sys/class/dmi/id/sys_vendor": "Microsoft Corporation"}, "a physical machine", ""),
        ("sharing", {".dockerenv": "", "proc/cpuinfo": "flags : fpu"}, "a container on a physical machine", ""),
    ],
)  # fmt: skip
def test_each_setting_is_told_with_a_remedy_where_it_needs_one(
    tmp_path: Path, look: str, files: dict[str, str], text: str, remedy: str
) -> None:
    for name, content in {"proc/sys/kernel/sched_rt_period_us": "1000000", **files}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"{content}\n")
    finding = LOOKS[look](tmp_path)
    assert finding.ok is not bool(remedy)
    assert remedy in finding.remedy
    assert re.search(text, finding.text), finding


def test_a_system_that_allows_less_is_told_what_to_add(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(system_checks, "set_fifo", lambda priority: "other")
    assert "rtprio" in priority_finding().remedy
    monkeypatch.setattr(system_checks, "set_fifo", lambda priority: f"fifo {priority}")
    assert priority_finding().ok
    import resource

    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (65536, 65536))
    assert "memlock" in memory_finding().remedy
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert memory_finding().ok


def counts(late: Lateness) -> np.ndarray:
    return late.array(Lateness.counts)


def test_jitter_is_that_of_both_loops() -> None:
    both = timing_checks.Jitter(0.001, 0.3)
    assert both.ticks == 150
    assert counts(both.pacer).sum() == counts(both.bare).sum() == both.ticks
    ours, bare = both.findings()
    assert "p99" in ours.text
    assert "skipped" in bare.text


def test_a_loop_that_misses_ticks_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    both = timing_checks.Jitter(0.001, 0.01)
    for loop, late in ((both.pacer, 5e-5), (both.bare, 4e-5)):
        counts(loop)[:], loop.most = 0.0, 0.0
        for _ in range(1000):
            loop.add(late)
    both.ticks, both.missed, both.bare_missed = 1000, 0, 0
    assert all(each.ok for each in both.findings())
    both.missed = 2
    assert "PREEMPT_RT" in next(iter(both.findings())).remedy
    both.missed = 0
    counts(both.pacer)[:] = 0.0
    counts(both.pacer)[1000] = 1000.0
    both.pacer.most = 1e-3
    assert "report this" in [*both.findings()][1].remedy


def test_a_device_is_opened_at_zero_force_and_closed() -> None:
    fake = Fake([[0.01]])
    findings = [*timing_checks.round_trip_findings([DeviceWiring(fake, np.arange(1))], ["one"], 0.005, VirtualClock())]
    assert all(each.ok for each in findings)
    assert [each.subject for each in findings] == [
        "the device of one (Fake)", "round trip", "samples of the device of one (Fake)"
    ]  # fmt: skip
    assert not any(force.any() for _, force in fake.forces)
    assert len(fake.forces) >= 100
    assert fake.log[-1][1] == "close"


@pytest.mark.parametrize(
    ("evil", "text"),
    [("read raises OSError", "OSError"), ("NaN", "not finite"), ("a clock that stands", "no new sample")],
)
def test_hardware_that_fails_is_told_and_closed(evil: str, text: str) -> None:
    fake = Fake([[0.01]], evil=evil, at=20)
    (*_, last) = timing_checks.round_trip_findings([DeviceWiring(fake, np.arange(1))], ["one"], 0.005, VirtualClock())
    assert text in last.text
    assert not last.ok
    assert fake.log[-1][1] == "close"


def test_the_command_ends_with_1_and_the_remedy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = Finding("clock", "tsc"), Finding("sharing", "a virtual machine", "no place")
    monkeypatch.setattr(doctor, "system_findings", lambda: iter([good]))
    monkeypatch.setattr(timing_checks.Jitter, "findings", lambda self: iter([good]))
    assert main(["doctor"]) == 0
    assert capsys.readouterr().out.splitlines()[0].split() == ["ok", "clock", "tsc"]
    monkeypatch.setattr(doctor, "system_findings", lambda: iter([good, bad]))
    assert main(["doctor", "--json"]) == 1
    table = json.loads(capsys.readouterr().out)
    assert [each["ok"] for each in table] == [True, False, True]
    assert main(["doctor", "-q"]) == 1
    assert capsys.readouterr().out.split() == ["NO", "sharing", "a", "virtual", "machine", "->", "no", "place"]
    assert main(["doctor", "--period", "5"]) == 2
    assert main(["doctor", "haply-2diy"]) == 2
    assert "port: given None, expected a setting of 'haply-2diy'; required" in capsys.readouterr().err
    assert main(["doctor", "haply-2diy", "--set", "prot=x"]) == 2
    assert "did you mean 'port'?" in capsys.readouterr().err
    assert main(["doctor", "simulated", "--set", "mass=0.1"]) == 2
    assert "a simulated device needs no test" in capsys.readouterr().err
    assert main(["doctor", "paper-spring"]) == 2
    assert "expected a scene with hardware" in capsys.readouterr().err


@pytest.mark.alone
def test_a_report_of_a_device_names_no_port_and_no_machine(capsys: pytest.CaptureFixture[str]) -> None:
    with DiyWire() as wire:
        main(
            ["doctor", "haply-2diy", "--set", f"port={wire.port}", "timeout=0.05", "--period", "0.01", "--out", "my.md"]
        )
        assert not wire.torque.any()
        assert all(torque == (0.0, 0.0) for _, torque in wire.frames)
        assert len(wire.frames) > 100
        said = capsys.readouterr()
        assert "opening haply-2diy at zero force" in said.err
        assert "round trip" in said.out
        text = Path("my.md").read_text()
        assert "- device: haply-2diy; 1 x 2, peak_force" in text
        assert machine_kind() in text
        assert wire.port not in text
    for private in (socket.gethostname(), str(Path.cwd()), wire.port):
        assert private not in text
    assert main(["doctor", "--out", "my.md"]) == 2  # nothing is written over
    assert "my.md" in capsys.readouterr().err
    gone = ["doctor", "haply-2diy", "--set", f"port={wire.port}", "--out", "gone.md"]
    assert main(gone) == 1
    assert "cannot be opened" in Path("gone.md").read_text()
    assert wire.port not in Path("gone.md").read_text()


def test_the_hardware_of_a_scene_is_opened_in_its_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with DiyWire() as wire:
        (tmp_path / "own.toml").write_text(f"""
dimensions = 2
period = 0.01
duration = 1.0
object = {{ mass = 0.1, viscosity = 0.8, rotational_viscosity = 1e-3, shape = {{ kind = "sphere", radius = 0.02 }} }}
coupling = {{ external.stiffness = 10.0, internal.stiffness = 10.0 }}
[[finger]]
start = [0.0, 0.1]
[finger.device]
name = "haply-2diy"
port = "{wire.port}"
timeout = 0.05
rate = 50.0
frame = {{ axes = "-x -y", scale = 2.0 }}
""")
        main(["doctor", "own.toml"])
        out = capsys.readouterr().out
        assert "at a period of 10 ms" in out
        assert "ok samples of the device of finger0 (Haply2Diy)" in " ".join(out.split())
        assert not any(any(torque) for _, torque in wire.frames)


def test_pieces_of_a_report_are_cells() -> None:
    text = lab_report("a | machine", [Finding("a|b", "two\nlines", "do")], [], ["two", "x"])
    assert "| a/b | ... lines | do |" in text
