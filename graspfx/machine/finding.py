"""A finding about a machine: what was looked at, what there is, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass


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
