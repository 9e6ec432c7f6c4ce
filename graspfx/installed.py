"""Installed distributions: versions and entry points, without importlib.metadata where folders say it as well."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from functools import lru_cache
from importlib.machinery import PathFinder
from pathlib import Path
from typing import NamedTuple

ENDINGS = (".dist-info", ".egg-info")
VERSION = re.compile(r"^Version: *(\S+)", re.MULTILINE)


class Distribution(NamedTuple):
    """The folder in which an installer left what it knows of a distribution, and when it did."""

    folder: str
    installed: int  # [ns]


class EntryPoint(NamedTuple):
    """An object that a distribution announces under a name, and the distribution with its version."""

    name: str
    module: str
    owner: str


def distributions() -> tuple[Distribution, ...] | None:
    """List every distribution in the order in which imports would find it; None where folders do not tell.

    They do not where packages come from archives, or by other finders than Python's own.
    """
    if any(hasattr(finder, "find_distributions") and finder is not PathFinder for finder in sys.meta_path):
        return None
    folders = []
    for place in sys.path:
        try:
            with os.scandir(place or ".") as entries:
                own = [(entry.path, entry.stat().st_mtime_ns) for entry in entries if entry.name.endswith(ENDINGS)]
        except NotADirectoryError:
            return None
        except OSError:  # a place that is not there
            continue
        folders += [Distribution(*each) for each in sorted(own)]
    return tuple(folders)


def entry_points(group: str) -> tuple[EntryPoint, ...]:
    """List the entry points of a group that all installed distributions announce."""
    all_ = distributions()
    return tuple(_announced(group)) if all_ is None else _read(all_, group)


@lru_cache(16)
def _read(all_: tuple[Distribution, ...], group: str) -> tuple[EntryPoint, ...]:
    """Read entry points once for as long as the installed distributions stay."""
    return tuple(_announced(group)) if any(_mentions(each.folder, group) for each in all_) else ()


def _mentions(folder: str, group: str) -> bool:
    path = Path(folder)
    try:
        return f"[{group}]".encode() in (path / "entry_points.txt").read_bytes()
    except FileNotFoundError:
        return False
    except OSError:  # who reads it may say why
        return True


def _announced(group: str) -> Iterator[EntryPoint]:
    from importlib.metadata import entry_points  # reads archives and mail headers: 20 ms

    for point in entry_points(group=group):
        owner = f"{point.dist.name} {point.dist.version}" if point.dist else "an unnamed distribution"
        yield EntryPoint(point.name, point.module, owner)


def version(package: str) -> str | None:
    """Read the version of an installed distribution; None for one that is not installed."""
    start = f"{re.sub(r'[-_.]+', '_', package).lower()}-"
    for each in distributions() or ():
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
