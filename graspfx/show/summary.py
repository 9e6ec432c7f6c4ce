"""Summaries of runs as a table on the terminal, two of them side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from graspfx.loop.record import Recording

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
    ("force vibration above 5 Hz, RMS", "force_vibration", "mN", 1e3),
    ("finger vibration above 5 Hz, RMS", "finger_vibration", "um", 1e6),
    ("object vibration above 5 Hz, RMS", "object_vibration", "um", 1e6),
    ("energy at each device port", "port_energy", "mJ", 1e3),
    ("leak: internal, translation, rotation", "leak", "mJ", 1e3),
    ("brake, at most", "braking", "N s/m", 1.0),
    ("taken by the brake", "braked", "mJ", 1e3),
    ("gap of the energy's ledger", "ledger_gap", "", 1.0),
    ("share of time in touch, per finger", "touching", "%", 100.0),
    ("coupling.fade too short by", "fade_shortfall", "mm", 1e3),
    ("samples with the associated law", "associated", "%", 100.0),
    ("friction law's largest residual", "friction_residual", "N", 1.0),
    ("ticks", "ticks", "", 1.0),
    ("wall time", "wall_time", "s", 1.0),
    ("ticks per second", "ticks_per_second", "1/s", 1.0),
    ("cost per tick", "tick_cost", "us", 1.0),
    ("faults", "faults", "", 1.0),
)


def table(recordings: Sequence[Recording], titles: Sequence[str] | None = None) -> Table:
    """One column per recording; of two, a third with the change from the first to the second.

    Args:
        recordings: one or more.
        titles: of the columns; each recording's scene if not given.
    """
    from rich.table import Table

    summaries = [recording.summary() for recording in recordings]
    compared = len(summaries) == 2
    made = Table(show_edge=False, pad_edge=False, header_style="bold")
    made.add_column("", no_wrap=True)
    for title in titles or [recording.header.scene for recording in recordings]:
        made.add_column(title.replace("/", "/\n"), justify="right", overflow="fold")
    if compared:
        made.add_column("change", justify="right", no_wrap=True)
    made.add_column("unit", no_wrap=True)
    for what, key, unit, scale in ROWS:
        values = [summary[key] for summary in summaries]
        if all(value is None for value in values):
            continue
        cells = [_cell(value, scale) for value in values]
        made.add_row(what, *cells, *([_change(*values)] if compared else []), unit)
    return made


def print_summary(
    recordings: Sequence[Recording], titles: Sequence[str] | None = None, console: Console | None = None
) -> None:
    """Prints the summary of one recording, or those of several side by side."""
    from rich.console import Console

    (console or Console()).print(table(recordings, titles))


def _cell(value: Any, scale: float) -> str:
    if isinstance(value, list):
        return "  ".join(_cell(item, scale) for item in value)
    if value is None:
        return "-"
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
    return f"{(after / before - 1.0) * 100.0:+.0f} %"
