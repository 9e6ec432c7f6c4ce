"""HTML fragments of the page: legend, status of the run, stability margins as bars, banners and messages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from graspfx.show.style import CONTACTS, EXTERNAL, GRID, INK, INTERNAL

if TYPE_CHECKING:
    from graspfx.live.stability_verdict import MarginRow, Verdict

RED, AMBER, GREEN = "#b3001b", "#b26a00", "#2e7d32"  # colours of stability results
GREY = "#616161"  # replaces green for objects that are not held
STATES = {
    "free": "free", "touch": "touches", "stick": "sticks", "slide": "slides", "limit": "at its force limit",
}  # fmt: skip
PAGE_STYLE = (
    "<style>"
    ".gfx{font:13px/1.45 system-ui,sans-serif;padding:2px 12px;color:#1a1a1a}.gfx b{font-weight:600}"
    ".gfx .note{color:#555}.gfx .dot{display:inline-block;width:11px;height:11px;border-radius:50%;margin:0 5px -1px 0;"
    "border:1px solid #0003}.gfx .bar{position:relative;height:9px;background:#eceff1;border-radius:5px;"
    "margin:1px 0 7px}"
    ".gfx .bar i{position:absolute;left:0;top:0;bottom:0;border-radius:5px}.gfx .bar u{position:absolute;top:-2px;"
    "bottom:-2px;width:2px;background:#1a1a1a}.gfx .row{display:flex;justify-content:space-between}</style>"
)
FULL_BAR = 10.0  # margin of a full bar; bars are logarithmic, and the mark is a margin of 1
EMPTY_BAR = 0.5


def legend(states: Sequence[str], scale: str) -> str:
    """Return the legend of colours and arrows."""
    dots = " &nbsp; ".join(
        f"<span style='white-space:nowrap'><span class=dot style='background:{CONTACTS[state]}'></span>"
        f"{STATES[state]}</span>" for state in states
    )  # fmt: skip
    parts = " &nbsp; ".join(
        f"<span style='white-space:nowrap;color:{colour}'><b>➔ {text}</b></span>"
        for colour, text in ((INTERNAL, "squeeze (internal)"), (EXTERNAL, "push (external)"))
    )
    return (
        f"<div class=gfx><div><b>Force on the object</b><br>{parts}<br><span class=note>arrows: {escape(scale)}</span>"
        f"</div><div style='margin-top:6px'><b>A fingertip</b><br>{dots}</div></div>"
    )


def status(state: str, time: float, remarks: Sequence[str]) -> str:
    """Return the status of the run."""
    words = {"running": "running in real time", "paused": "paused", "ended": "ended", "replay": "replay"}
    lines = "".join(f"<div class=note>{escape(each)}</div>" for each in remarks)
    head = f"<div class=row><b>{words.get(state, escape(state))}</b><span>{time:.1f} s</span></div>"
    return f"<div class=gfx>{head}{lines}</div>"


def margins(verdict: Verdict | None, loose: Mapping[str, float]) -> str:
    """Return a stability result: a summary, and each margin as a bar with a mark at the stability limit.

    Args:
        verdict: Result for the grasp as held by its hands; None before the first.
        loose: Objects that are not held, with the gap to the nearest finger, from `Frames.loose`; they are never green.
    """
    alarm = _box(AMBER, f"NOT HELD: no finger touches {', '.join(_apart(*each) for each in loose.items())}") * bool(
        loose
    )
    if verdict is None:
        return f"<div class=gfx>{alarm}<b>Stability</b> <span class=note>is being computed …</span></div>"
    if verdict.is_stable is None:
        why = escape(verdict.error)
        return f"<div class=gfx>{alarm}<b>Stability is not known</b><div class=note>{why}</div></div>"
    colour = RED if not verdict.is_stable else GREY if loose else GREEN
    word = "UNSTABLE: it will shake" if not verdict.is_stable else "stable once it is held" if loose else "stable"
    how = "provisional, the full result is being computed" if verdict.is_provisional else "full"
    head = _box(colour, word, f"{how}; spectral radius {verdict.spectral_radius:.5f}")
    opacity = ";opacity:.55" if verdict.is_provisional else ""
    rows = "".join(_row(row, GREY if row.name in loose else GREEN) for row in verdict.rows)
    return f"<div class=gfx>{alarm}{head}<div style='{opacity}'>{rows}</div></div>"


def _box(colour: str, words: str, note: str = "") -> str:
    small = f"<div style='font-size:11px;opacity:.9'>{note}</div>" if note else ""
    style = f"background:{colour};color:#fff;border-radius:5px;padding:4px 9px;margin:2px 0 6px"
    return f"<div style='{style}'><b>{words}</b>{small}</div>"


def _apart(name: str, gap: float) -> str:
    """Return the name of an object, with the distance of the nearest finger [m] if known."""
    away = f"{gap:.3g} m" if gap >= 1.0 else f"{1e3 * max(gap, 0.0):.3g} mm"
    return escape(name) + (f" (the nearest is {away} away)" if math.isfinite(gap) else "")


def _row(row: MarginRow, ample: str) -> str:
    margin = row.margin
    share = 1.0 if not math.isfinite(margin) else _share(margin)
    colour = RED if margin < 1.0 else AMBER if margin < 1.5 else ample
    number = "no limit" if not math.isfinite(margin) else f"{margin:.2f} ×"
    where = f", lost at {row.frequency:.3g} Hz" if math.isfinite(row.frequency) else ""
    name = escape(row.mode)
    limit = f"limit {row.limit:.4g} N/m{where}" if math.isfinite(row.limit) else ""
    return (
        f"<div class=row title='{limit}'><span>{name}</span><b style='color:{colour}'>{number}</b></div>"
        f"<div class=bar><i style='width:{100 * share:.1f}%;background:{colour}'></i>"
        f"<u style='left:{100 * _share(1.0):.1f}%'></u></div>"
    )


def _share(margin: float) -> float:
    least, most = math.log(EMPTY_BAR), math.log(FULL_BAR)
    return min(1.0, max(0.02, (math.log(max(margin, 1e-9)) - least) / (most - least)))


def banner(text: str, *, panel: bool) -> str:
    """Return a red banner at the top of the page, with red panels if `panel`; empty without a text."""
    if not text:
        return "<div></div>"
    words = "".join(each if each.isprintable() else " " for each in text)  # a form feed would end a CSS string
    words = words.replace("\\", "").replace("'", "’").replace("<", "‹")[:300]
    style = (
        f"body::before{{content:'{words}';position:fixed;top:0;left:0;right:0;z-index:99999;background:{RED};"
        "color:#fff;padding:9px 14px;font:600 16px system-ui,sans-serif;text-align:center;pointer-events:none}"
        "#root{top:40px!important}"
    )
    if panel:
        style += f".mantine-Paper-root{{background:#ffe3e6!important;box-shadow:inset 0 0 0 3px {RED}}}"
    return f"<style>{style}</style>"


def message(text: str, colour: str = AMBER) -> str:
    """Return a message, such as a refusal."""
    if not text:
        return "<div></div>"
    return f"<div class=gfx style='color:{colour}'>{escape(text)}</div>"


def heading(text: str) -> str:
    """Return the heading of a section of the panel."""
    style = f"color:{INK};border-top:1px solid {GRID};padding-top:6px"
    return f"<div class=gfx style='{style}'><b>{escape(text)}</b></div>"
