"""Checks of system settings for real-time loops, and a report of the results without private data."""

from __future__ import annotations

import os
import platform
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

from graspfx import __version__
from graspfx.loop.device import Features
from graspfx.loop.realtime.process import SERVO
from graspfx.system.scheduling import most_locked, set_fifo

LIMITS = "/etc/security/limits.d/graspfx.conf"
SHARE = 0.5  # share of processor time that real-time threads need
GOOD_CLOCKS = ("tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page")
VENDORS = {
    "QEMU": "QEMU", "VMware": "VMware", "innotek": "VirtualBox", "Xen": "Xen", "Amazon EC2": "Amazon EC2",
    "Google": "Google Compute Engine", "Microsoft Corporation": "Hyper-V", "Parallels": "Parallels",
}  # fmt: skip
CONTAINERS = (".dockerenv", "run/.containerenv")
NO_PLACE = "do not run hardware from a virtual machine that shares its processors: use a physical machine"
SHORTEST = 3  # shortest setting that is removed from the report
PERSON = (
    "Force gauge at the finger, 0.2 N commanded in each direction: measured force",
    "Ruler: reported positions and true positions of the finger",
    "Cable pulled while a force was on: time until the force was zero",
    "Program killed (kill -9) while a force was on: time until the force was zero",
    "Emergency stop pressed while a force was on: time until the force was zero",
    "Anything unexpected that was felt: ringing, steps, drift",
)


@dataclass(frozen=True)
class Finding:
    """Result of one check of the computer.

    Attributes:
        subject: Name of the setting or part of the computer that was checked.
        text: Description of the result.
        remedy: Advice to the user; empty if the check has passed.
    """

    subject: str
    text: str
    remedy: str = ""

    @property
    def ok(self) -> bool:
        return not self.remedy


def lab_report(
    kind: str, findings: Sequence[Finding], devices: Sequence[tuple[str, Features]], settings: Sequence[object]
) -> str:
    """Write a report of the computer, its devices and the results of the checks, in Markdown.

    Args:
        kind: Description of the computer.
        findings: Results of `graspfx doctor`.
        devices: Names of the drivers, each with the features of its device.
        settings: Settings of the devices. Their texts, such as ports and serial numbers, are removed from the report.
    """
    lines = [f"# GraspFX {__version__}: report of a machine", "", f"- machine: {kind}"]
    lines += [f"- device: {name}; {_figures(features)}" for name, features in devices]
    lines += ["", "| what | found | remedy |", "|---|---|---|"]
    lines += [f"| {_cell(each.subject)} | {_cell(each.text)} | {_cell(each.remedy)} |" for each in findings]
    lines += ["", "Observed by a person (fill in, or leave empty):", "", *(f"- {each}: " for each in PERSON), ""]
    text = "\n".join(lines)
    for value in sorted({str(each) for each in settings}, key=len, reverse=True):
        if len(value) >= SHORTEST:
            text = text.replace(value, "...")
    return text


def _figures(features: Features) -> str:
    figures = {name: getattr(features, name) for name in ("peak_force", "resolution", "watchdog", "rate", "latency")}
    texts = [f"{name} {value:g}" for name, value in figures.items() if value is not None]
    return f"{features.fingers} x {features.dimensions}" + "".join(f", {each}" for each in texts)


def _cell(text: str) -> str:
    return text.replace("|", "/").replace("\n", " ")


# System settings ------------------------------------------------------------------------------------------------------


def system_findings(root: Path = Path("/")) -> Iterator[Finding]:
    """Yield the results of all checks of system settings.

    Args:
        root: Root of the file system that is checked.
    """
    if not sys.platform.startswith("linux"):
        text = f"{platform.system() or sys.platform}: priority, memory and preemption are checked on Linux only"
        yield Finding("system", text)
        return
    yield priority_finding()
    yield memory_finding()
    yield throttling_finding(root)
    yield governor_finding(root)
    yield preemption_finding(root)
    yield clock_finding(root)
    yield sharing_finding(root)


def priority_finding() -> Finding:
    """Check whether a thread may get the real-time priority of a servo."""
    policies: list[str] = []
    thread = Thread(target=lambda: policies.append(set_fifo(SERVO)))
    thread.start()
    thread.join()
    if policies[0].startswith("fifo"):
        return Finding("priority", f"SCHED_FIFO {SERVO} is allowed")
    remedy = f"add '@realtime - rtprio 99' to {LIMITS}, add yourself to the group realtime, and log in again"
    return Finding("priority", "SCHED_FIFO is not allowed: other programs can delay the loop", remedy)


def memory_finding() -> Finding:
    """Check whether memory can be locked; a tick that accesses locked memory never waits for the disk."""
    most = most_locked()
    if most is None:
        return Finding("memory", "unknown")
    if most == float("inf"):
        return Finding("memory", "can be locked")
    remedy = f"add '@realtime - memlock unlimited' to {LIMITS}, and log in again"
    return Finding("memory", f"only {most // 1024:.0f} kB can be locked", remedy)


def throttling_finding(root: Path) -> Finding:
    """Check which share of the processor time real-time threads may use."""
    runtime = _number(root / "proc/sys/kernel/sched_rt_runtime_us")
    period = _number(root / "proc/sys/kernel/sched_rt_period_us")
    if runtime is None or not period:
        return Finding("throttling", "unknown")
    share = 1.0 if runtime < 0 else runtime / period
    if share >= 1.0:
        return Finding("throttling", "none")
    text = f"real-time threads get at most {share:.0%} of each {1e-6 * period:g} s"
    if share < SHARE:
        return Finding("throttling", text, "sysctl -w kernel.sched_rt_runtime_us=950000")
    return Finding("throttling", f"{text}, which is enough because the loop sleeps most of the time")


def governor_finding(root: Path) -> Finding:
    """Check whether the frequency governor of the processors is `performance`."""
    files = sorted((root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor"))
    kinds = sorted({text for file in files if (text := _text(file))})
    if not kinds:
        return Finding("clock rate", "governor unknown")
    slow = kinds != ["performance"]
    return Finding(
        "clock rate", f"governor {', '.join(kinds)}", "cpupower frequency-set -g performance" if slow else ""
    )


def preemption_finding(root: Path) -> Finding:
    """Check whether the kernel is preemptible."""
    version = _text(root / "proc/version")
    if _text(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in version:
        return Finding("preemption", "PREEMPT_RT")
    match = re.search(r"PREEMPT(_DYNAMIC)?", version)
    if match is None:
        return Finding("preemption", "not in this kernel", "boot a PREEMPT_RT or lowlatency kernel")
    line = re.search(r"preempt=(\w+)", _text(root / "proc/cmdline"))
    if match[1] and line is not None and line[1] in ("none", "voluntary"):
        return Finding("preemption", f"{match[0]}, switched to {line[1]}", "boot with preempt=full")
    return Finding("preemption", f"{match[0]}; PREEMPT_RT would be better")


def clock_finding(root: Path) -> Finding:
    """Check whether the kernel's clock source can be read quickly."""
    name = _text(root / "sys/devices/system/clocksource/clocksource0/current_clocksource")
    if not name or name in GOOD_CLOCKS:
        return Finding("clock", name or "unknown")
    return Finding("clock", f"{name}, which is slow to read", "find out why tsc was rejected: dmesg | grep -i tsc")


def sharing_finding(root: Path) -> Finding:
    """Check whether this computer is a virtual machine, which shares its processors with others."""
    vendor = _text(root / "sys/class/dmi/id/sys_vendor") + " " + _text(root / "sys/class/dmi/id/product_name")
    name = next((kind for words, kind in VENDORS.items() if words in vendor and not _is_bare(vendor)), "")
    guest = re.search(r"^flags\s*:.*\bhypervisor\b", _text(root / "proc/cpuinfo"), re.MULTILINE) is not None
    inside = any((root / each).exists() for each in CONTAINERS)
    if guest or name:
        text = f"a virtual machine{f' ({name})' if name else ''}{', in a container' if inside else ''}"
        return Finding("sharing", f"{text}: other guests can stop it for milliseconds", NO_PLACE)
    return Finding("sharing", "a container on a physical machine" if inside else "a physical machine")


def machine_kind(root: Path = Path("/")) -> str:
    """Describe the machine for a report: processor, kernel and Python."""
    cpu = _text(root / "proc/cpuinfo")
    match = re.search(r"^model name\s*:\s*(.+)$", cpu, re.MULTILINE)
    model = " ".join(match[1].split()) if match else platform.machine()
    kernel = f"{platform.system()} {platform.release()}"
    return f"{model}, {os.cpu_count()} processors, {kernel}, Python {platform.python_version()}"


def _is_bare(vendor: str) -> bool:
    """Return whether a computer whose vendor also makes hypervisors, such as Microsoft, is physical."""
    return "Microsoft Corporation" in vendor and "Virtual Machine" not in vendor


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def _number(file: Path) -> int | None:
    try:
        return int(_text(file))
    except ValueError:
        return None
