"""Opening of a session: a run that its caller steps, or one that goes on by the wall's clock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, overload

from graspfx.assembly.real_time_session import RealTimeSession
from graspfx.assembly.session import Session
from graspfx.errors import InputError
from graspfx.scene.load import to_scene

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


@overload
def open(
    scene: Scene | str | PathLike[str],
    overrides: Mapping[str, Any] | None = None,
    *,
    live: Iterable[str] = (),
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
    real_time: Literal[False] = False,
) -> Session: ...


@overload
def open(
    scene: Scene | str | PathLike[str],
    overrides: Mapping[str, Any] | None = None,
    *,
    live: Iterable[str] = (),
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
    real_time: Literal[True],
) -> RealTimeSession: ...


def open(
    scene: Scene | str | PathLike[str],
    overrides: Mapping[str, Any] | None = None,
    *,
    live: Iterable[str] = (),
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
    real_time: bool = False,
) -> Session:
    """Open a scene as a run that goes on tick by tick: `with gx.open("paper-waving") as session: session.step(100)`.

    For any division into steps the recording is that of `gx.run`, bit by bit.

    With `real_time` it goes on by itself, on the wall's clock and in a process of its own, from here on until it is
    closed: a `RealTimeSession`, whose scene may have hardware. Forces come as soon as it is open.

    Args:
        scene: a scene, its name or its path.
        overrides: values by dotted key.
        live: keys that `Session.set` may change in mid-run, such as "coupling.internal.stiffness"; `*` stands for
            all of a list.
        out: a folder in which recording.h5 is written; it may exist. While the session is open its rows are there in
            recording.h5.part too.
        overwrite: whether a recording that is there already, or the part of a run that was killed, is replaced.
        real_time: whether ticks come by the wall's clock.

    Raises:
        InputError, UnknownNameError: no scene; a live key that cannot change in mid-run; an `out` that is no path;
            hardware without `real_time`, or with a finger inside its object.
        SceneError: with every fault of the scene at once.
        DeviceError: a device that does not open, or is not at rest.
        RecordingError: `out` has a recording already, another run is writing there, or it cannot be written.
    """
    if not isinstance(real_time, bool):
        raise InputError("real_time", real_time, "True for the wall's clock, or False for steps")
    kind = RealTimeSession if real_time else Session
    return kind(to_scene(scene, overrides), live=live, out=out, overwrite=overwrite)
