"""Exceptions: one base class; an input error's message says what was given, what was expected and what to do."""

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

MOST_SHOWN = 50  # faults shown in the message of a SceneError
LONGEST_KEY = 200  # characters of a key shown in a message


class GraspFXError(Exception):
    """Base class of all exceptions that GraspFX defines."""


class InputError(GraspFXError, ValueError):
    """An argument is invalid. The message says what was given, what was expected and what to do.

    Args:
        name: Name of the argument, as the caller wrote it.
        given: Value that was given; the message abbreviates it.
        expected: Description of a valid value.
        do: Advice, if it does not follow from `expected`.
    """

    def __init__(self, name: str, given: object, expected: str, do: str = "") -> None:
        self.name, self.given, self.expected, self.do = name, given, expected, do
        text = f"{name}: given {abbreviate(given)}, expected {expected}"
        super().__init__(f"{text}; {do}" if do else text)


class KernelError(InputError):
    """A kernel has an error that compiled code would not detect.

    The message gives the file and the line.
    """


class NoRestError(InputError):
    """No rest configuration of the grasp was found, so the stability of the grasp cannot be judged."""


class UnknownNameError(GraspFXError, KeyError):
    """A name is unknown. The message lists the known names and suggests a close match."""

    def __init__(self, kind: str, name: object, known: Iterable[str], do: str = "") -> None:
        self.kind, self.name, self.known = kind, name, sorted(known)
        text = f"unknown {kind} {abbreviate(name)}"
        close = closest(name, self.known) if isinstance(name, str) and len(name) <= LONGEST_KEY else None
        if close:
            text += f"; did you mean {close!r}?"
        if self.known:
            text += f" (known: {', '.join(self.known)})"
        super().__init__(f"{text}; {do}" if do else text)

    def __str__(self) -> str:
        return str(self.args[0])  # a KeyError shows its `repr`


class MissingPackageError(GraspFXError, ImportError):
    """A required package is not installed."""

    def __init__(self, package: str, wanted_by: str, do: str) -> None:
        self.package, self.wanted_by, self.do = package, wanted_by, do
        super().__init__(f"{wanted_by} needs the package {package!r}, which is not installed; {do}")

    @classmethod
    def of_extra(cls, package: str, wanted_by: str, extra: str) -> Self:
        """Return the error for a package that an extra of GraspFX installs."""
        return cls(package, wanted_by, installation(extra))


def installation(extra: str) -> str:
    """Return the command that installs an extra of GraspFX."""
    return f"pip install 'graspfx[{extra}]', or '.[{extra}]' in a checkout"


class DeviceError(GraspFXError):
    """A device cannot continue. In a run, all forces become zero and the fault is recorded."""


class RecordingError(GraspFXError):
    """A recording cannot be read or written."""


@dataclass(frozen=True)
class Fault:
    """Fault in a scene: key, description, and line in the file (None for a scene without a file)."""

    key: str
    message: str
    line: int | None = None

    def text(self, source: str) -> str:
        """Return the fault as one line: source and line, key, message."""
        place = source if self.line is None else f"{source}:{self.line}"
        key = self.key if len(self.key) <= LONGEST_KEY else f"{self.key[: LONGEST_KEY - 3]}..."
        key = key if key.isprintable() else repr(key)[1:-1]
        return f"{place}: {key}: {self.message}" if key else f"{place}: {self.message}"


class SceneError(GraspFXError, ValueError):
    """A scene has faults.

    The error contains all faults with their lines; the message shows the first 50 faults and the number of all faults.
    """

    def __init__(self, source: str, faults: Sequence[Fault]) -> None:
        self.source, self.faults = source, tuple(faults)
        lines = [fault.text(source) for fault in self.faults[:MOST_SHOWN]]
        if len(self.faults) > MOST_SHOWN:
            lines.append(f"{source}: and {len(self.faults) - MOST_SHOWN} more faults, {len(self.faults)} in all")
        super().__init__("\n".join(lines))


def __dir__() -> list[str]:
    return sorted(__all__)


def closest(name: str, names: Iterable[str], likeness: float = 0.6) -> str | None:
    """Return the name that is closest to a misspelt name, or None if no name is close.

    If `likeness` is 1, only the name itself matches.

    Two names match if one contains the other, if one contains all dot-separated parts of the other in any order, or if
    their edit distance is at most one plus one per three letters. Words that merely share letters do not match.
    """
    from difflib import get_close_matches  # imported only for errors

    for match in get_close_matches(name, list(names), n=3, cutoff=likeness):
        if holds(match, name) or holds(name, match) or slips(name, match) <= 1 + len(name) // 3:
            return match
    return None


def holds(name: str, other: str) -> bool:
    """Return whether `name` contains `other` as a substring, or contains all dot-separated parts of `other`."""
    return other in name or {*other.split(".")} <= {*name.split(".")}


def slips(name: str, other: str) -> int:
    """Compute the Levenshtein distance of two words."""
    row = list(range(len(other) + 1))
    for i, letter in enumerate(name, start=1):
        last, row[0] = row[0], i
        for j, each in enumerate(other, start=1):
            last, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, last + (letter != each))
    return row[-1]


def message(error: BaseException, limit: int = 500) -> str:
    """Return the message of an exception on one line, in printable characters, shortened to `limit` characters."""
    try:
        text = " ".join(str(error).split())
    except Exception:  # noqa: BLE001 - `str` of an exception may itself fail
        return "no message"
    text = "".join(letter if letter.isprintable() else "?" for letter in text)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def abbreviate(value: object, limit: int = 60) -> str:
    """Abbreviate a value for an error message: an array by its shape, a long text by its beginning."""
    shape = getattr(value, "shape", None)
    if shape:
        return f"an array of shape {tuple(shape)}"
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - user code may raise anything, and Python refuses to write 5000 digits
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= limit else text[: limit - 3] + "..."
