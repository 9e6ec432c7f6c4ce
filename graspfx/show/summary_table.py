"""Summaries of runs in the terminal: tables of one or several runs, and warnings."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.cones.problem import SLIDE
from graspfx.coupling.rules import BAND

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

BOLD, PLAIN = "\033[1m", "\033[0m"
RULES = "┃│━╇"  # separators of head cells and row cells, line below the head, and its crossings
ASCII = "||-+"


class Column(NamedTuple):
    """Column of a table.

    Attributes:
        title: Title in the head of the table.
        cells: Texts below the title.
        right: Whether the texts are aligned on the right.
        folds: Whether long texts are wrapped.
    """

    title: str
    cells: Sequence[str]
    right: bool = False
    folds: bool = False


def lines(columns: Sequence[Column], width: int, *, rules: str = RULES, bold: bool = False) -> Iterator[str]:
    """Yield the lines of a table.

    Args:
        columns: Columns with equal numbers of cells.
        width: Width of the terminal in characters. Columns with `folds` share the width that other columns leave. A
            line can be longer than the terminal, since cells are wrapped only between words.
        rules: Four characters in the order of RULES: separator of head cells, separator of other cells, line below the
            head, and crossing of this line with a separator.
        bold: Whether the head is bold.
    """
    fixed = sum(_widest([each.title, *each.cells]) for each in columns if not each.folds)
    rest = width - fixed - 3 * (len(columns) - 1)  # a rule with a blank on both sides
    share = rest // max(1, sum(each.folds for each in columns))
    widths = [_width(each, share) for each in columns]
    head, row, below, crossing = tuple(rules)
    titles = [_folded(each.title, size) for each, size in zip(columns, widths, strict=True)]
    height = max(map(len, titles))
    for line in _row([[""] * (height - len(each)) + each for each in titles], columns, widths, head):
        yield f"{BOLD}{line}{PLAIN}" if bold else line
    yield f"{below}{crossing}{below}".join(below * size for size in widths)
    for cells in zip(*(each.cells for each in columns), strict=True):
        yield from _row([_folded(*each) for each in zip(cells, widths, strict=True)], columns, widths, row)


def _row(cells: Sequence[list[str]], columns: Sequence[Column], widths: Sequence[int], rule: str) -> Iterator[str]:
    for part in range(max(map(len, cells))):
        texts = [cell[part] if part < len(cell) else "" for cell in cells]
        blanks = [" " * (size - _size(text)) for text, size in zip(texts, widths, strict=True)]
        parts = zip(texts, blanks, columns, strict=True)
        yield f" {rule} ".join(blank + text if each.right else text + blank for text, blank, each in parts)


def _width(column: Column, share: int) -> int:
    width = _widest([column.title, *column.cells])
    if not column.folds or width <= share:
        return width
    return max(share, _widest(word for text in (column.title, *column.cells) for word in text.split()))


def _widest(texts: Iterable[str]) -> int:
    return max((_size(line) for text in texts for line in text.split("\n")), default=0)


def _folded(text: str, width: int) -> list[str]:
    """Wrap a text between words into lines of at most `width` characters; split only words longer than `width`."""
    lines = []
    for line in text.split("\n"):
        full = ""
        for word in line.split(" "):
            joined = f"{full} {word}" if full else word
            if full and _size(joined) > width:
                lines.append(full.rstrip())
                joined = word
            while _size(joined) > width:
                cut = max(1, next(i for i in range(len(joined) + 1) if _size(joined[:i]) > width) - 1)
                lines.append(joined[:cut])
                joined = joined[cut:]
            full = joined
        lines.append(full)
    return lines


def _size(text: str) -> int:
    """Count the terminal columns of a text: two for a wide character, zero for a combining character."""
    if text.isascii():
        return len(text)
    from unicodedata import combining, east_asian_width

    return sum(0 if combining(letter) else 1 + (east_asian_width(letter) in "WF") for letter in text)


MOST_CHANGES = 8  # largest number of printed changes during a run

Row = tuple[str, str, str, float]  # description, key, unit, factor on the SI value

ROWS: tuple[Row, ...] = (
    ("internal deformation, mean", "internal_deformation_mean", "mm", 1e3),
    ("internal deformation, peak", "internal_deformation_peak", "mm", 1e3),
    ("penetration depth of a finger, mean", "invasion_mean", "mm", 1e3),
    ("penetration depth of a finger, peak", "invasion_peak", "mm", 1e3),
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
    ("friction margin of the grip, least", "grip_margin", "N", 1.0),
    ("coefficient of friction needed", "friction_needed", "", 1.0),
    ("finger vibration above 5 Hz, RMS", "finger_vibration", "um", 1e6),
    ("object vibration above 5 Hz, RMS", "object_vibration", "um", 1e6),
    ("energy at each device port", "port_energy", "mJ", 1e3),
    ("leak: internal, translation, rotation", "leak", "mJ", 1e3),
    ("largest damping of the brake", "braking", "N s/m", 1.0),
    ("energy dissipated by the brake", "braked", "mJ", 1e3),
    ("residual of the energy ledger", "ledger_gap", "", 1.0),
    ("time touching, per finger", "touching", "%", 100.0),
    ("coupling.fade too short by", "fade_shortfall", "mm", 1e3),
    ("samples in the blend's band", "blended", "%", 100.0),
    ("samples with the associated law", "associated", "%", 100.0),
    ("friction law's largest residual", "friction_residual", "N", 1.0),
    ("ticks", "ticks", "", 1.0),
    ("wall time", "wall_time", "s", 1.0),
    ("ticks per second", "ticks_per_second", "1/s", 1.0),
    ("cost per tick", "tick_cost", "us", 1.0),
    ("tick engine", "engine", "", 1.0),
    ("faults", "faults", "", 1.0),
    ("values changed during the run", "changes", "", 1.0),
)

BRIEF: tuple[Row, ...] = (
    ("depth of a finger, mean", "invasion_mean", "mm", 1e3),
    ("squeeze: internal force, mean", "internal_force_mean", "N", 1.0),
    ("squeeze: vibration above 5 Hz, RMS", "internal_force_vibration", "mN", 1e3),
    ("push: external force, mean", "external_force_mean", "N", 1.0),
    ("push: vibration above 5 Hz, RMS", "external_force_vibration", "mN", 1e3),
    ("force vibration above 5 Hz, RMS", "force_vibration", "mN", 1e3),
)


def columns(summaries: Sequence[dict[str, Any]], names: Sequence[str], table: Sequence[Row] = ROWS) -> list[Column]:
    """Return the columns of a table of summaries.

    They are the quantities, the values of each summary, for two summaries the change from the first to the second [%],
    and the units.
    """
    rows = [row for row in table if any(summary[row[1]] is not None for summary in summaries)]
    listed = [Column("", [quantity for quantity, _, _, _ in rows])]
    for name, summary in zip(names, summaries, strict=True):
        cells = [_cell(summary[key], scale) for _, key, _, scale in rows]
        listed.append(Column(name.replace("/", "/\n"), cells, right=True, folds=True))
    if len(summaries) == 2:
        before, after = summaries
        listed.append(Column("change", [_change(before[key], after[key]) for _, key, _, _ in rows], right=True))
    return [*listed, Column("unit", [unit for _, _, unit, _ in rows])]


def print_summary(
    recordings: Sequence[Recording], titles: Sequence[str] | None = None, table: Sequence[Row] = ROWS
) -> None:
    """Print a table with the summaries of one or more recordings, and below it notes about the recordings."""
    encoding = (getattr(sys.stdout, "encoding", None) or "utf-8").lower()
    rules = RULES if encoding.startswith("utf") else ASCII
    width = get_terminal_size().columns
    summaries = [recording.summary() for recording in recordings]
    names = titles or [recording.header.scene for recording in recordings]
    for line in lines(columns(summaries, names, table), width, rules=rules, bold=sys.stdout.isatty()):
        print(line)
    for name, summary, recording in zip(names, summaries, recordings, strict=True):
        of = f"{name}: " if len(summaries) > 1 else ""
        for change in recording.changes[:MOST_CHANGES]:
            print(f"note: {of}from {change.tick * recording.period:g} s on {change.key} = {change.value}")
        if len(recording.changes) > MOST_CHANGES:
            print(f"note: {of}and {len(recording.changes) - MOST_CHANGES} more changes; see Recording.changes")
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


FELL = 1e-3  # smallest reported fall of an object, larger than when it is put down [m]
MOST_TOUCHES = 10  # contacts of one finger in a run; a hand does not close more often
FASTEST = 5.0  # contacts per second; a hand does not close faster [1/s]


def remarks(recording: Recording) -> list[str]:
    """Return a sentence for each warning about the contacts of a run.

    The list is empty if the contacts are attached, if a required column was not recorded, or if the run has no ticks.
    """
    needs = {"gap", "touching", *(f"objects/{name}/position" for name in recording.layout.objects)}
    if not needs.isdisjoint(recording.layout.omitted) or recording.gap is None or not len(recording):
        return []
    return [*_shortfall(recording), *_untouched(recording, recording.gap), *_lost(recording), *_chatter(recording)]


def _shortfall(recording: Recording) -> Iterator[str]:
    """Warn if `coupling.fade` is too small: fingers left the grasp where they could still touch the object again."""
    needed = recording.outcome.fade_needed
    if needed > 0.0:
        h1 = 1e-4 * math.ceil(1e4 * needed)
        short = _length(recording.outcome.fade_shortfall)
        yield (
            f"free fingers began to fade out of the grasp {short} too close to the object: "
            f"set coupling.fade = [{h1:.4g}, {h1 + BAND:.4g}]"
        )


def _untouched(recording: Recording, gap: NDArray[np.float64]) -> Iterator[str]:
    layout = recording.layout
    for i in np.flatnonzero(~recording.touching.any(axis=0)):
        name = layout.objects[layout.finger_objects[i]]
        yield f"{layout.fingers[i]} never touches {name}: smallest gap {_length(gap[:, i].min())}"


def _lost(recording: Recording) -> Iterator[str]:
    """Warn of objects that no finger touches at the end, if they slid out of the last fingers or then fell."""
    layout = recording.layout
    down = np.array(recording.header.scene_table.get("gravity") or [0.0] * layout.dimensions, dtype=float)
    down /= np.linalg.norm(down) or 1.0
    for number, name in enumerate(layout.objects):
        own = np.flatnonzero(np.array(layout.finger_objects) == number)
        ticks = np.flatnonzero(recording.touching[:, own].any(axis=1))
        if not ticks.size or ticks[-1] == len(recording) - 1:
            continue
        last = ticks[-1]
        left = own[recording.touching[last, own]]
        slid = recording.status is not None and bool((recording.status[last, left] == SLIDE).all())
        position = recording.objects[name].position[last:] @ down
        fell = float(np.nanmax(position) - position[0])
        remarks = ["slides out of the fingers"] if slid else []
        remarks += [f"falls by {_length(fell)}"] if fell > FELL else []
        if remarks:
            yield f"{name} {' and '.join(remarks)}: no finger touches it after {recording.time[last]:.4g} s"


def _chatter(recording: Recording) -> Iterator[str]:
    touching = recording.touching
    touches = (touching[1:] & ~touching[:-1]).sum(axis=0)
    often = np.flatnonzero(touches > max(MOST_TOUCHES, FASTEST * recording.end))
    if often.size:
        names = ", ".join(recording.layout.fingers[i] for i in often)
        verb = "touches and lets" if often.size == 1 else "touch and let"
        yield f"{names} {verb} go up to {touches.max()} times: contacts chatter if stiffness and period are too large"


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 1.0 else f"{1e3 * metres:.3g} mm"
