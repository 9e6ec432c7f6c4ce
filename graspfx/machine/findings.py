"""A report that a lab can send: what `graspfx doctor` sees, and what a person does; nothing that is private."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from graspfx import __version__
from graspfx.loop.device import Features

SHORTEST = 3  # letters of a setting that is struck out wherever it stands
PERSON = (
    "Force gauge at the finger, 0.2 N in each direction: what it shows",
    "Ruler: places that were read, and where the finger was",
    "Cable pulled with a force on: how long until there was none",
    "Program killed with a force on (kill -9): how long until there was none",
    "Emergency stop pressed with a force on: how long until there was none",
    "Anything felt that should not be there: ringing, steps, drift",
)


@dataclass(frozen=True)
class Finding:
    """One thing that a loop in real time needs.

    Attributes:
        subject: what was looked at.
        text: what there is.
        remedy: what to do; empty where it is well.
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
        kind: of the machine.
        findings: of the doctor.
        devices: names of the drivers, each with what its device tells.
        settings: of the devices: texts among them, such as ports and serial numbers, are struck out.
    """
    lines = [f"# GraspFX {__version__}: report of a machine", "", f"- machine: {kind}"]
    lines += [f"- device: {name}; {_figures(features)}" for name, features in devices]
    lines += ["", "| what | found | remedy |", "|---|---|---|"]
    lines += [f"| {_cell(each.subject)} | {_cell(each.text)} | {_cell(each.remedy)} |" for each in findings]
    lines += ["", "Seen by a person (fill in, or leave empty):", "", *(f"- {each}: " for each in PERSON), ""]
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
