"""Summaries of runs as a table on the terminal, several of them side by side."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Any

from graspfx.show.table import ASCII, RULES, Column, lines

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

MOST_CHANGES = 8  # in mid-run that are printed

Row = tuple[str, str, str, float]  # what, key, unit, by what an SI value is multiplied

ROWS: tuple[Row, ...] = (
    ("internal deformation, mean", "internal_deformation_mean", "mm", 1e3),
    ("internal deformation, peak", "internal_deformation_peak", "mm", 1e3),
    ("invasion of a finger, mean", "invasion_mean", "mm", 1e3),
    ("invasion of a finger, peak", "invasion_peak", "mm", 1e3),
    ("distance of the fingers, mean", "finger_distance_mean", "mm", 1e3),
    ("distance of the fingers, least", "finger_distance_least", "mm", 1e3),
    ("tracking error, RMS", "tracking_error", "mm", 1e3),
    ("peak force per finger", "peak_force", "N", 1.0),
    ("peak displayed force per finger", "peak_displayed_force", "N", 1.0),
    ("samples at the limit, per finger", "saturated", "%", 100.0),
    ("force vibration above 5 Hz, RMS", "force_vibration", "mN", 1e3),
    ("internal force, peak per finger", "internal_force_peak", "N", 1.0),
    ("internal force, mean", "internal_force_mean", "N", 1.0),
    ("internal force, vibration above 5 Hz", "internal_force_vibration", "mN", 1e3),
    ("external force, peak per finger", "external_force_peak", "N", 1.0),
    ("external force, mean", "external_force_mean", "N", 1.0),
    ("external force, vibration above 5 Hz", "external_force_vibration", "mN", 1e3),
    ("moment of internal forces, of |f| r", "internal_moment", "%", 100.0),
    ("finger vibration above 5 Hz, RMS", "finger_vibration", "um", 1e6),
    ("object vibration above 5 Hz, RMS", "object_vibration", "um", 1e6),
    ("energy at each device port", "port_energy", "mJ", 1e3),
    ("leak: internal, translation, rotation", "leak", "mJ", 1e3),
    ("brake, at most", "braking", "N s/m", 1.0),
    ("taken by the brake", "braked", "mJ", 1e3),
    ("gap of the energy's ledger", "ledger_gap", "", 1.0),
    ("share of time in touch, per finger", "touching", "%", 100.0),
    ("coupling.fade too short by", "fade_shortfall", "mm", 1e3),
    ("samples in the blend's band", "blended", "%", 100.0),
    ("samples with the associated law", "associated", "%", 100.0),
    ("friction law's largest residual", "friction_residual", "N", 1.0),
    ("ticks", "ticks", "", 1.0),
    ("wall time", "wall_time", "s", 1.0),
    ("ticks per second", "ticks_per_second", "1/s", 1.0),
    ("cost per tick", "tick_cost", "us", 1.0),
    ("ticks ran", "engine", "", 1.0),
    ("faults", "faults", "", 1.0),
    ("values changed in mid-run", "changes", "", 1.0),
)

BRIEF: tuple[Row, ...] = (
    ("depth of a finger, mean", "invasion_mean", "mm", 1e3),
    ("squeeze: internal force, mean", "internal_force_mean", "N", 1.0),
    ("its vibration above 5 Hz, RMS", "internal_force_vibration", "mN", 1e3),
    ("push: external force, mean", "external_force_mean", "N", 1.0),
    ("its vibration above 5 Hz, RMS", "external_force_vibration", "mN", 1e3),
    ("force vibration above 5 Hz, RMS", "force_vibration", "mN", 1e3),
)


def columns(recordings: Sequence[Recording], titles: Sequence[str] | None = None) -> list[Column]:
    """Name the rows, then one column per recording, of two the change from first to second, and units.

    Args:
        recordings: one or more.
        titles: of the columns; each recording's scene if not given.
    """
    return _columns([recording.summary() for recording in recordings], _names(recordings, titles), ROWS)


def _names(recordings: Sequence[Recording], titles: Sequence[str] | None) -> Sequence[str]:
    return titles or [recording.header.scene for recording in recordings]


def _columns(summaries: Sequence[dict[str, Any]], names: Sequence[str], table: Sequence[Row]) -> list[Column]:
    rows = [row for row in table if any(summary[row[1]] is not None for summary in summaries)]
    columns = [Column("", [quantity for quantity, _, _, _ in rows])]
    for name, summary in zip(names, summaries, strict=True):
        cells = [_cell(summary[key], scale) for _, key, _, scale in rows]
        columns.append(Column(name.replace("/", "/\n"), cells, right=True, folds=True))
    if len(summaries) == 2:
        before, after = summaries
        columns.append(Column("change", [_change(before[key], after[key]) for _, key, _, _ in rows], right=True))
    return [*columns, Column("unit", [unit for _, _, unit, _ in rows])]


def print_summary(
    recordings: Sequence[Recording], titles: Sequence[str] | None = None, table: Sequence[Row] = ROWS
) -> None:
    """Print the summary of one recording, or of several side by side, as wide as the terminal, then its notes."""
    encoding = (getattr(sys.stdout, "encoding", None) or "utf-8").lower()
    rules = RULES if encoding.startswith("utf") else ASCII
    width = get_terminal_size().columns
    summaries, names = [recording.summary() for recording in recordings], _names(recordings, titles)
    for line in lines(_columns(summaries, names, table), width, rules=rules, bold=sys.stdout.isatty()):
        print(line)
    for name, summary, recording in zip(names, summaries, recordings, strict=True):
        of = f"{name}: " if len(summaries) > 1 else ""
        for change in recording.changes[:MOST_CHANGES]:
            print(f"note: {of}from {change.tick * recording.period:g} s on {change.key} = {change.value}")
        if len(recording.changes) > MOST_CHANGES:
            print(
                f"note: {of}and {len(recording.changes) - MOST_CHANGES} changes more, all of them in Recording.changes"
            )
        if summary["recorded"]:
            print(f"note: {of}{summary['recorded']}")
        for growth in summary["growth"]:
            print(f"note: {of}{growth['text']}")


def _cell(value: Any, scale: float) -> str:
    if isinstance(value, list):
        return "  ".join(_cell(item, scale) for item in value)
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return f"{value * scale:.0f}"
    return _three_digits(value * scale)


def _three_digits(value: float) -> str:
    if value == 0.0 or 1e-3 <= abs(value) < 1e6:
        return f"{value:#.3g}".rstrip(".") if abs(value) < 1000 else f"{value:,.0f}"
    return f"{value:.2e}"


def _change(before: Any, after: Any) -> str:
    if not isinstance(before, float) or not isinstance(after, float) or before == 0.0:
        return ""
    text = f"{(after / before - 1.0) * 100.0:+.0f} %"
    return "+0 %" if text == "-0 %" else text
