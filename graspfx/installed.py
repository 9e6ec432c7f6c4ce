"""Versions and entry points of installed distributions, read from metadata folders faster than importlib.metadata."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from functools import lru_cache
from importlib.machinery import PathFinder
from pathlib import Path
from stat import S_ISDIR
from time import time_ns
from typing import NamedTuple

ENDINGS = (".dist-info", ".egg-info")
SETTLED = 2_000_000_000  # age from which a folder's time tells whether it has changed [ns]
GROUP = re.compile(rb"\[([^\]\r\n]*)\]")
VERSION = re.compile(r"^Version: *(\S+)", re.MULTILINE)


class Distribution(NamedTuple):
    """Metadata folder of an installed distribution, and the time at which the folder was last changed."""

    folder: str
    installed: int  # [ns]


class EntryPoint(NamedTuple):
    """Name and module of an entry point, and the name and version of the distribution that provides it."""

    name: str
    module: str
    owner: str


def _looks_in_path(finder: object) -> bool:
    """Return whether a finder looks for distributions in `sys.path` only."""
    return finder is PathFinder or type(finder).__module__ == "importlib_metadata"


def distributions() -> tuple[Distribution, ...] | None:
    """List the distributions in the folders of `sys.path`, in the order of `sys.path`.

    The result is None if other distributions may exist, because packages are also imported from archives or by custom
    finders.
    """
    if any(hasattr(finder, "find_distributions") and not _looks_in_path(finder) for finder in sys.meta_path):
        return None
    found: list[Distribution] = []
    for place in sys.path:
        try:
            status = os.stat(place or ".")  # noqa: PTH116 (at every lookup)
            if not S_ISDIR(status.st_mode):
                return None
            changed = status.st_mtime_ns
            # A folder that has just changed may change again within the resolution of its time.
            look = _in_folder if time_ns() - changed > SETTLED else _in_folder.__wrapped__
            found += look(os.path.abspath(place or "."), changed)  # noqa: PTH100 (of the place "")
        except OSError:  # the folder does not exist
            continue
    return tuple(found)


@lru_cache(64)
def _in_folder(place: str, changed: int) -> tuple[Distribution, ...]:
    """List the distributions in a folder; the result is cached until the folder's modification time changes."""
    with os.scandir(place) as entries:
        own = [(entry.path, entry.stat().st_mtime_ns) for entry in entries if entry.name.endswith(ENDINGS)]
    return tuple(Distribution(*each) for each in sorted(own))


def entry_points(group: str) -> tuple[EntryPoint, ...]:
    """List the entry points of a group in all installed distributions."""
    all_ = distributions()
    return tuple(_announced(group)) if all_ is None else _read(all_, group)


@lru_cache(16)
def _read(all_: tuple[Distribution, ...], group: str) -> tuple[EntryPoint, ...]:
    """List the entry points of a group; the result is cached for these distributions."""
    groups = _groups(all_)
    return tuple(_announced(group)) if groups is None or group in groups else ()


@lru_cache(16)
def _groups(all_: tuple[Distribution, ...]) -> frozenset[str] | None:
    """List the groups of all entry points; return None if a file of entry points cannot be read."""
    groups = set[str]()
    for each in all_:
        try:
            with open(os.path.join(each.folder, "entry_points.txt"), "rb") as file:  # noqa: PTH118, PTH123 (hundreds)
                content = file.read()
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError:  # importlib.metadata will report the reason
            return None
        groups.update(match.decode(errors="replace") for match in GROUP.findall(content))
    return frozenset(groups)


def _announced(group: str) -> Iterator[EntryPoint]:
    from importlib.metadata import entry_points  # takes 20 ms, because it reads archives and headers

    for point in entry_points(group=group):
        owner = f"{point.dist.name} {point.dist.version}" if point.dist else "an unnamed distribution"
        yield EntryPoint(point.name, point.module, owner)


def version(package: str) -> str | None:
    """Return the version of an installed distribution, or None if it is not installed."""
    return _version(package, distributions() or ())


@lru_cache(256)
def _version(package: str, all_: tuple[Distribution, ...]) -> str | None:
    """Read the version of a package; the result is cached for these distributions."""
    start = f"{re.sub(r'[-_.]+', '_', package).lower()}-"
    for each in all_:
        name = Path(each.folder).name.lower()
        if name.startswith(start) and name.endswith(".dist-info"):
            try:
                match = VERSION.search((Path(each.folder) / "METADATA").read_text(encoding="utf-8"))
            except (OSError, UnicodeDecodeError):
                break
            if match:
                return match[1]
    from importlib import metadata

    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
