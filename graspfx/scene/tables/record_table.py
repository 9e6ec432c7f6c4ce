"""Table `record` of a scene: columns and ticks of a recording, and compression of its file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from graspfx.scene.tables.fields import Table


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


class Record(Table):
    """Columns and ticks of a recording; a list is short for a table with these columns."""

    columns: Annotated[tuple[str, ...], BeforeValidator(_listed)] = Field(
        default=(), description="names of the file's variables, or of groups of them; all if not given"
    )
    every: Annotated[int, Field(strict=True, ge=1)] = Field(default=1, description="ticks from one row to the next")
    compression: Literal["none", "lzf", "gzip"] = Field(default="none", description="compression when the run ends")
