"""The log of orders: each with its number, what it asked for, the tick from which it held, and what became of it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from graspfx.screen.touch_orders import Kind, Order

HEADER = "client,number,kind,finger,x,y,tick,fate"
NAME = "touches.csv"


class Entry(NamedTuple):
    """An order of a client, and the newest tick when it came."""

    client: int
    order: Order
    tick: int
    fate: str


class TouchLog:
    """A log in memory, or none; `save` writes it beside a recording.

    Args:
        is_on: whether orders are noted.
    """

    def __init__(self, *, is_on: bool) -> None:
        self.is_on = is_on
        self.entries: list[Entry] = []

    def note(self, client: int, order: Order, tick: int, fate: str) -> None:
        """Note an order."""
        if self.is_on:
            self.entries.append(Entry(client, order, tick, fate))

    def fates(self) -> list[str]:
        """List what became of each order.

        "applied", "superseded" if another place for the finger came before a tick could take it, or why it was dropped.
        """
        fates, newest = [each.fate for each in self.entries], dict[int, int]()
        for k, each in enumerate(self.entries):
            if each.fate != "taken" or each.order.kind == Kind.ALIVE:
                continue
            before = newest.get(each.order.finger)
            if before is not None and self.entries[before].tick == each.tick:
                fates[before] = "superseded"
            newest[each.order.finger], fates[k] = k, "applied"
        return ["applied" if fate == "taken" else fate for fate in fates]

    def save(self, folder: Path) -> Path:
        """Write the log as comma-separated text; give its file."""
        lines = [HEADER]
        for (client, order, tick, _), fate in zip(self.entries, self.fates(), strict=True):
            x, y = order.place
            lines.append(f"{client},{order.number},{order.kind.name.lower()},{order.finger},{x!r},{y!r},{tick},{fate}")
        file = folder / NAME
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return file
