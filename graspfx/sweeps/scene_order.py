"""Orders to the processes of a sweep, in few bytes: the scene as data, what is measured, and how files look."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from graspfx import __version__, plugins
from graspfx.environment import granted
from graspfx.errors import GraspFXError
from graspfx.scene.source import Source

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


class SweepError(GraspFXError):
    """A sweep that cannot go on: its folder is another's, or a process of it has other files or another GraspFX."""


@dataclass(frozen=True)
class SceneOrder:
    """An order to run variants of a scene, which any process takes.

    Attributes:
        table: the scene as data.
        source: where it came from.
        trusted: whether it may name files outside of its folder.
        duration: instead of the scene's own [s].
        shapes: of the quantities that are measured, by name.
        statistics: of each.
        native: whether a first variant was native throughout.
        total: variants of the whole sweep.
        files: digests of the files that the scene names, by their path.
        engines: versions of the programs that move objects, by their distribution.
        home: the process that ordered.
        version: of GraspFX.
    """

    table: Mapping[str, Any]
    source: Source
    trusted: bool
    duration: float | None
    shapes: Mapping[str, tuple[int, ...]]
    statistics: tuple[str, ...]
    native: bool
    total: int
    files: Mapping[str, str]
    engines: Mapping[str, str]
    home: tuple[str, int]
    version: str = __version__

    @property
    def bytes(self) -> bytes:
        """The order as bytes."""
        return pickle.dumps(self, protocol=pickle.HIGHEST_PROTOCOL)


@lru_cache(maxsize=2)
def take_order(content: bytes) -> tuple[SceneOrder, Scene]:
    """Make the scene of an order, once in a process.

    Raises:
        SweepError: this process has another GraspFX or other files than the one that ordered.
    """
    from graspfx.assembly.provenance import digest_of, version_of
    from graspfx.scene.model import Scene

    order: SceneOrder = pickle.loads(content)
    if order.version != __version__:
        raise SweepError(f"a worker has GraspFX {__version__}, the sweep {order.version}: install the same one")
    for package, version in order.engines.items():
        if version_of(package) != version:
            have = f"{package} {version_of(package)}"
            raise SweepError(f"a worker has {have}, the sweep {version}: install the same one on all machines")
    for name, digest in order.files.items():
        own = digest_of(name)
        if own != digest:
            state = "is not there" if own is None else "is another"
            raise SweepError(f"{name} {state} where a worker runs: give all machines the same files by the same paths")
    with permitted(order):
        return order, Scene(order.source, **order.table)


@contextmanager
def permitted(order: SceneOrder) -> Iterator[None]:
    """Trust what the order's user trusts, and look once for what is installed."""
    with granted(order.trusted), plugins.unchanged():
        yield
