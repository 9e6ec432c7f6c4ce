"""Errors: one base class, and errors that make their own message, which says what to do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self

__all__ = [  # noqa: RUF022 (the base, then as users meet them)
    "GraspFXError",
    "InputError",
    "KernelError",
    "UnknownNameError",
    "SceneError",
    "Fault",
    "DeviceError",
    "RecordingError",
    "MissingPackageError",
]

MOST_SHOWN = 50  # faults of a scene
LONGEST_KEY = 200  # letters of a key in a message


class GraspFXError(Exception):
    """Every error that GraspFX raises on purpose."""


class InputError(GraspFXError, ValueError):
    """An argument that cannot be used: says what was given, what was expected and what to do.

    Args:
        name: the argument, as its caller wrote it.
        given: what came in (shown shortened).
        expected: what would have been right.
        do: the next step, if it does not follow from `expected`.
    """

    def __init__(self, name: str, given: object, expected: str, do: str = "") -> None:
        self.name, self.given, self.expected, self.do = name, given, expected, do
        text = f"{name}: given {abbreviate(given)}, expected {expected}"
        super().__init__(f"{text}; {do}" if do else text)


class KernelError(InputError):
    """A fault of a kernel by which machine code would read or write what is not its own; it names the file and line."""


class NoRestError(InputError):
    """A grasp for which no rest was found: nothing is known of its stability."""


class UnknownNameError(GraspFXError, KeyError):
    """A name that nothing answers to, with the names that come close."""

    def __init__(self, kind: str, name: str, known: Iterable[str], do: str = "") -> None:
        self.kind, self.name, self.known = kind, name, sorted(known)
        text = f"unknown {kind} {abbreviate(name)}"
        close = closest(name, self.known) if len(name) <= LONGEST_KEY else None
        if close:
            text += f"; did you mean {close!r}?"
        if self.known:
            text += f" (known: {', '.join(self.known)})"
        super().__init__(f"{text}; {do}" if do else text)

    def __str__(self) -> str:
        return str(self.args[0])  # a KeyError shows its `repr`


class MissingPackageError(GraspFXError, ImportError):
    """A package that this scene names is not installed."""

    def __init__(self, package: str, wanted_by: str, do: str) -> None:
        self.package, self.wanted_by, self.do = package, wanted_by, do
        super().__init__(f"{wanted_by} needs the package {package!r}, which is not installed; {do}")

    @classmethod
    def of_extra(cls, package: str, wanted_by: str, extra: str) -> Self:
        """Make the error of a package that comes with an extra of GraspFX."""
        return cls(package, wanted_by, installation(extra))


def installation(extra: str) -> str:
    """Say how the packages of an extra of GraspFX are installed."""
    return f"pip install 'graspfx[{extra}]', or '.[{extra}]' in a checkout"


class DeviceError(GraspFXError):
    """A device that cannot go on: in a run it means zero force and a recorded fault."""


class RecordingError(GraspFXError):
    """A recording that cannot be read or written."""


@dataclass(frozen=True)
class Fault:
    """One fault of a scene: the key, what is wrong with it, and the line where it stands (None outside a file)."""

    key: str
    message: str
    line: int | None = None

    def text(self, source: str) -> str:
        """Write the fault with where it stands in a source, its key, and what is wrong."""
        place = source if self.line is None else f"{source}:{self.line}"
        key = self.key if len(self.key) <= LONGEST_KEY else f"{self.key[: LONGEST_KEY - 3]}..."
        key = key if key.isprintable() else repr(key)[1:-1]
        return f"{place}: {key}: {self.message}" if key else f"{place}: {self.message}"


class SceneError(GraspFXError, ValueError):
    """Every fault of a scene at once, each with its line; its text shows the first 50, and how many there are."""

    def __init__(self, source: str, faults: Sequence[Fault]) -> None:
        self.source, self.faults = source, tuple(faults)
        lines = [fault.text(source) for fault in self.faults[:MOST_SHOWN]]
        if len(self.faults) > MOST_SHOWN:
            lines.append(f"{source}: and {len(self.faults) - MOST_SHOWN} more faults, {len(self.faults)} in all")
        super().__init__("\n".join(lines))


def __dir__() -> list[str]:
    return sorted(__all__)


def closest(name: str, names: Iterable[str], likeness: float = 0.6) -> str | None:
    """Find the name nearest to a misspelt one, or None; a likeness of 1 takes the name itself only.

    A name is near that holds the other one, or all of its parts between dots in whatever order, or is a slip or two of
    the pen away: one, and one more for every three letters. Letters that two words happen to share make them no
    misspelling of one another.
    """
    from difflib import get_close_matches  # only where there is something to blame

    for match in get_close_matches(name, list(names), n=3, cutoff=likeness):
        if holds(match, name) or holds(name, match) or slips(name, match) <= 1 + len(name) // 3:
            return match
    return None


def holds(name: str, other: str) -> bool:
    """Tell whether a name holds another one: its letters in a row, or as a key with dots all of its parts."""
    return other in name or {*other.split(".")} <= {*name.split(".")}


def slips(name: str, other: str) -> int:
    """Count the letters that are to be put in, left out or exchanged to make one word of another (Levenshtein)."""
    row = list(range(len(other) + 1))
    for i, letter in enumerate(name, start=1):
        last, row[0] = row[0], i
        for j, each in enumerate(other, start=1):
            last, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, last + (letter != each))
    return row[-1]


def message(error: BaseException, limit: int = 500) -> str:
    """Write an exception's message on one line, in letters that every file takes; others' code may raise anything."""
    try:
        text = " ".join(str(error).split())
    except Exception:  # noqa: BLE001 - an exception may fail to be written too
        return "no message"
    text = "".join(letter if letter.isprintable() else "?" for letter in text)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def abbreviate(value: object, limit: int = 60) -> str:
    """Abbreviate a value for an error message: arrays by their shape, anything long cut short."""
    shape = getattr(value, "shape", None)
    if shape:
        return f"an array of shape {tuple(shape)}"
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - others' code may raise anything, and Python does not write 5000 digits
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= limit else text[: limit - 3] + "..."
