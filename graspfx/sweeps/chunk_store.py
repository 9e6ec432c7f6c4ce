"""The folder of a sweep: what it is a sweep of, and a file for each chunk, which is there whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from graspfx import log
from graspfx.card import counted
from graspfx.errors import InputError, RecordingError
from graspfx.recording.files import LENGTH, WHOLE, claim, make_folder, seal, sync_folder
from graspfx.sweeps.chunk import ChunkResult
from graspfx.sweeps.identity import differences, identity_of
from graspfx.sweeps.scene_order import SweepError

MANIFEST, CHUNKS, FINAL, LOCK = "sweep.json", "chunks", "sweep.nc", ".lock"
DRAFT = ".draft"  # ending of a file that is being written
FORMAT = 1


class ChunkStore:
    """Files of a sweep in a folder that this process has for itself.

    Args:
        folder: which is there.
        manifest: what sweep.json says.
        removal: what was removed to begin anew, in words; empty for nothing.
    """

    def __init__(self, folder: Path, manifest: Mapping[str, Any], removal: str = "") -> None:
        self.folder, self.manifest, self.removal = folder, dict(manifest), removal
        self.damaged: list[Path] = []

    @property
    def identity(self) -> str:
        """The digest of all that the results depend on."""
        return str(self.manifest["identity"])

    @property
    def size(self) -> int:
        """Variants in a chunk; the last may have fewer."""
        return int(self.manifest["chunk"])

    @property
    def final(self) -> Path:
        """The file of all results."""
        return self.folder / FINAL

    def place(self, number: int) -> Path:
        """Name the file of a chunk."""
        return self.folder / CHUNKS / f"{number:06d}.npz"

    def save(self, number: int, result: ChunkResult) -> None:
        """Write a chunk beside its place, make the disk keep it, and move it there.

        Raises:
            RecordingError: the disk does not take it.
        """
        arrays = {f"{k}": values for k, values in enumerate(_values(result))}
        content = BytesIO()
        about = json.dumps([self.identity, number, list(result.notes), result.seconds])
        np.savez(content, faults=result.faults, failures=np.array(result.failures), about=np.array(about), **arrays)
        body = content.getvalue()
        write_whole(self.place(number), body + seal(content, len(body)))

    def load(self, number: int, blank: ChunkResult) -> ChunkResult | None:
        """Read a chunk into the result of variants that have not run; None where it is not there, or is damaged."""
        place = self.place(number)
        try:
            content = place.read_bytes()
        except OSError:
            return None
        try:
            return _read(content, (self.identity, number), blank)
        except (ValueError, KeyError, OSError, EOFError, BadZipFile) as error:
            log.info("%s: %s", place, error)
            self.damaged.append(place)
            return None


def _values(result: ChunkResult) -> list[Any]:
    return [values for by_name in result.measures.values() for values in by_name.values()]


def _read(content: bytes, about: tuple[str, int], blank: ChunkResult) -> ChunkResult:
    """Read a chunk's bytes.

    Raises:
        ValueError, KeyError, OSError, EOFError, BadZipFile: they are not what was written, or another chunk's.
    """
    body, line = content[:-LENGTH], content[-LENGTH:]
    if not line.startswith(WHOLE) or line != seal(BytesIO(body), len(body)):
        raise ValueError("its bytes are not what was written")
    with np.load(BytesIO(body), allow_pickle=False) as file:
        identity, number, notes, seconds = json.loads(str(file["about"]))
        if (identity, number) != about:
            raise ValueError("it is another sweep's, or another chunk")
        for k, values in enumerate(_values(blank)):
            if file[f"{k}"].shape != values.shape:
                raise ValueError("its arrays have other shapes")
            values[...] = file[f"{k}"]
        blank.faults[...] = file["faults"]
        blank.failures = [str(text) for text in file["failures"]]
    blank.notes, blank.seconds = tuple(notes), float(seconds)
    return blank


def write_whole(place: Path, content: bytes) -> None:
    """Write a file beside its place, make the disk keep it, and move it there: it is there whole or not at all.

    Raises:
        RecordingError: the disk does not take it.
    """
    draft = place.with_name(f".{place.name}{DRAFT}")
    try:
        with draft.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(place)
    except OSError as error:
        with suppress(OSError):  # where the disk is full its bytes are wanted
            draft.unlink()
        raise RecordingError(f"{place}: cannot be written; {error.strerror}: what is done so far stays") from error
    sync_folder(place.parent)


# The folder -----------------------------------------------------------------------------------------------------------


@contextmanager
def open_store(
    path: Path, parts: Mapping[str, Any], size: int, *, resume: bool, overwrite: bool
) -> Iterator[ChunkStore]:
    """Have a folder for a sweep, for oneself alone within the block; what is done of the same sweep is there.

    Args:
        path: of the folder, which is made if need be.
        parts: all that the results depend on.
        size: variants in a chunk, where the sweep is new.
        resume: whether a sweep that is there, if it is the same, goes on.
        overwrite: whether the sweep that is there is removed, whatever it is.

    Raises:
        SweepError: another sweep is there, the same one without `resume`, or another process is at it.
        RecordingError: the folder or a file in it cannot be written.
    """
    make_folder(path)
    try:
        file = claim(path / LOCK)
    except RecordingError:
        text = f"{path}: another process is at this sweep; wait for its end, or choose another --out"
        raise SweepError(text) from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written; {error.strerror}") from error
    _locks.add(file)
    try:
        yield _store(path, parts, size, resume=resume, overwrite=overwrite)
    finally:
        _locks.discard(file)
        file.close()


def _store(path: Path, parts: Mapping[str, Any], size: int, *, resume: bool, overwrite: bool) -> ChunkStore:
    identity, removal = identity_of(parts), _remove(path) if overwrite else ""
    there = manifest_of(path)
    if there is None and (results := _results(path)):
        text = f"{path}: has {results} of a sweep, but no {MANIFEST} that can be read"
        raise SweepError(f"{text}; choose another --out, or begin again with --overwrite (overwrite=True)")
    if there is None:
        about = {"format": FORMAT, "identity": identity, "chunk": size, "created": now(), "parts": dict(parts)}
        write_whole(path / MANIFEST, json.dumps(about, indent=1).encode())
        make_folder(path / CHUNKS)
        return ChunkStore(path, about, removal)
    if there["identity"] != identity:
        lines = differences(there.get("parts", {}), parts)
        more = f"; and {len(lines) - 5} more differences" if len(lines) > 5 else ""
        text = f"{path}: is the folder of another sweep: {'; '.join(lines[:5])}{more}"
        raise SweepError(f"{text}. Choose another --out, or write over it with --overwrite (overwrite=True)")
    if not resume:
        done = len(_chunks(path))
        how = "go on with --resume (resume=True), or begin again with --overwrite (overwrite=True)"
        raise SweepError(f"{path}: has {counted(done, 'chunk')} of this very sweep; {how}")
    make_folder(path / CHUNKS)
    for draft in (path / CHUNKS).glob(f".*{DRAFT}"):
        with suppress(OSError):
            draft.unlink()
    return ChunkStore(path, there)


def manifest_of(path: Path) -> dict[str, Any] | None:
    """Read what a folder is a sweep of; None where it says nothing that can be read.

    Raises:
        SweepError: it is of a later GraspFX.
    """
    try:
        about: dict[str, Any] = json.loads((path / MANIFEST).read_bytes())
        kind = about["format"], str(about["identity"]), str(about["created"])
        if int(about["chunk"]) < 1:
            return None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    if kind[0] != FORMAT:
        raise SweepError(f"{path}: is a sweep of format {kind[0]}, this GraspFX reads {FORMAT}; choose another --out")
    return about


def now() -> str:
    """Write the time in UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def _chunks(path: Path) -> list[Path]:
    """List the files of chunks, and no others."""
    return list((path / CHUNKS).glob(f"{'[0-9]' * 6}.npz"))


def _results(path: Path) -> str:
    """Say which results of a sweep a folder has; empty for none."""
    count = len(_chunks(path))
    names = [counted(count, "chunk")] * bool(count) + [FINAL] * (path / FINAL).is_file()
    return " and ".join(names)


def _remove(path: Path) -> str:
    """Remove the files of a sweep, and nothing else; that which says what they are goes last. Say what that was."""
    try:
        there = manifest_of(path)
        title = f"the sweep of {there['created']}" if there is not None else f"a sweep whose {MANIFEST} cannot be read"
    except SweepError:
        title = "a sweep of a later GraspFX"
    results = _results(path)
    try:
        for each in _chunks(path):
            each.unlink()
        (path / FINAL).unlink(missing_ok=True)
        (path / MANIFEST).unlink(missing_ok=True)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written over; {error.strerror}") from error
    return f"{path}: {title} was removed to begin again, with {results}" if results else ""


def folder_of(out: object) -> Path:
    """Take the path of a sweep's folder.

    Raises:
        InputError: no path, or that of a file.
    """
    from graspfx.environment import to_path

    path = to_path("out", out, "the path of a folder")
    if path.is_file():
        raise InputError("out", str(path), "the path of a folder", "there is a file of that name")
    return path


_locks: set[Any] = set()  # of folders that this process has


def _let_go() -> None:
    for file in _locks:
        with suppress(OSError):
            file.close()
    _locks.clear()


if hasattr(os, "register_at_fork"):  # a worker that a pool forks would have the lock for as long as it lives
    os.register_at_fork(after_in_child=_let_go)
