"""Findings of `graspfx doctor`, and a report of them that a lab can send without private data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from graspfx import __version__
from graspfx.loop.device import Features

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
    """Result of one check.

    Attributes:
        subject: Part of the machine or of its settings that was checked.
        text: Result of the check.
        remedy: Advice to the user; empty if none is needed.
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
    """Write a report in Markdown.

    Args:
        kind: Description of the machine.
        findings: Findings of `graspfx doctor`.
        devices: Drivers' names, each with the features of its device.
        settings: Settings of the devices; their texts, such as ports and serial numbers, are removed from the report.
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
