"""The columns and ticks that a scene asks to be recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import UnknownNameError
from graspfx.loop.recording.layout import Layout

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Selection:
    """Cuts rows of all columns and ticks down to those that are recorded.

    Args:
        whole: the layout of all columns.
        layout: of those that are recorded.
        every: ticks from one row to the next.
    """

    whole: Layout
    layout: Layout
    every: int = 1

    @cached_property
    def numbers(self) -> NDArray[np.intp]:
        """Places in a whole row of the numbers of a recorded one."""
        places = np.arange(self.whole.width)
        return np.concatenate([places[:0], *(places[self.whole.columns[name].where] for name in self.layout.columns)])

    @property
    def is_whole(self) -> bool:
        """True where every number of every tick is recorded."""
        return self.every == 1 and self.layout == self.whole

    def cut(self, rows: FloatArray, tick: int = 0) -> FloatArray:
        """Copy what is recorded of whole rows (r, width) of ticks from `tick` on."""
        if self.is_whole:
            return rows
        return np.asarray(rows[-tick % self.every :: self.every][:, self.numbers])


def chosen_layout(whole: Layout, names: Sequence[str]) -> Layout:
    """Lay out the columns of these names alone; all where there is no name.

    A name is that of a column, of a group of them (`objects/bar`, `objects/bar/energy`), or of a variable that follows
    from columns (`internal_force`), which are recorded then.

    Raises:
        UnknownNameError: with the names that come close.
    """
    if not names:
        return whole
    columns_: set[str] = set()
    for name in names:
        columns = columns_of(whole, name)
        if not columns:
            groups = {column.rpartition("/")[0] for column in whole.columns if "/" in column}
            raise UnknownNameError("column", name, {*whole.columns, *(each.name for each in whole.derived), *groups})
        columns_.update(columns)
    return replace(whole, omitted=tuple(name for name in whole.columns if name not in columns_))


def columns_of(whole: Layout, name: str) -> list[str]:
    """List the columns that a name stands for; none for a name that nothing has."""
    group = name.rstrip("/") + "/"
    inside = [column for column in whole.columns if column == name or column.startswith(group)]
    if not inside and name in [column.name for column in whole.derived]:
        inside = list(whole.sources_of(name))
    return inside
