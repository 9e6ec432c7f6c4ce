"""Folder of a sweep: a description (sweep.json), a netCDF file for each chunk, and a netCDF file with all results."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx import __version__, log
from graspfx.assembly.provenance import brief, by_name, file_changes, scene_changes
from graspfx.card import counted
from graspfx.environment import to_path
from graspfx.errors import InputError, RecordingError
from graspfx.recording.files import LENGTH, claim, make_folder, seal, sync_folder
from graspfx.recording.header import now
from graspfx.show.conversions import Labels
from graspfx.sweeps.chunk import ChunkResult, SweepError
from graspfx.sweeps.swept_values import VariantGrid

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

MANIFEST, CHUNKS, FINAL, LOCK = "sweep.json", "chunks", "sweep.nc", ".lock"
DRAFT = ".draft"  # suffix of an incomplete file
FORMAT = 2  # format of the folder; from 2 on, chunks are netCDF
RESULTS = 1  # version of the meaning of numbers in a sweep's files
FEW = 6  # largest number of values to list one by one
LEAST = 4096  # variables with more entries are compressed
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable."


class SweepFolder:
    """Files of a sweep in a folder that this process has locked.

    Args:
        path: Path of the existing folder.
        manifest: Content of sweep.json.
        removal: Description of the sweep that was removed from the folder; empty if none was removed.
    """

    def __init__(self, path: Path, manifest: Mapping[str, Any], removal: str = "") -> None:
        self.path, self.manifest, self.removal = path, dict(manifest), removal
        self.damaged: list[Path] = []

    @property
    def identity(self) -> str:
        """Digest of everything on which the results of the sweep depend."""
        return str(self.manifest["identity"])

    @property
    def size(self) -> int:
        """Number of variants per chunk; the last chunk may have fewer."""
        return int(self.manifest["chunk"])

    @property
    def final(self) -> Path:
        """Path of the file with all results (sweep.nc)."""
        return self.path / FINAL

    def save(self, number: int, result: ChunkResult, dimensions: Mapping[str, tuple[str, ...]]) -> None:
        """Write the file of a chunk.

        Args:
            number: Index of the chunk.
            result: Result of the variants in the chunk.
            dimensions: Names of the axes of each array of the result, except the axis of variants.

        Raises:
            RecordingError: If the disk cannot be written.
        """
        variables: dict[str, Any] = {
            name: (("variant", *dimensions[name]), values, {}) for name, values in result.arrays.items()
        }
        variables["failure"] = (("variant",), np.array(result.failures, dtype=object), {})
        attributes = {"identity": self.identity, "chunk": number, "notes": json.dumps(result.notes)}
        body = netcdf(Labels(variables, {}, {**attributes, "seconds": result.seconds}))
        write_whole(self._place(number), body + seal(BytesIO(body), len(body)))

    def load(self, number: int, blank: ChunkResult) -> ChunkResult | None:
        """Read the file of a chunk into `blank` and return it; return None if the file is missing or damaged."""
        place = self._place(number)
        try:
            content = place.read_bytes()
        except OSError:
            return None
        try:
            self._read(content, number, blank)
        except (ValueError, LookupError, OSError, RuntimeError) as error:
            log.info("%s: %s", place, error)
            self.damaged.append(place)
            return None
        return blank

    def _place(self, number: int) -> Path:
        return self.path / CHUNKS / f"{number:06d}.nc"

    def _read(self, content: bytes, number: int, blank: ChunkResult) -> None:
        import h5py

        body = content[:-LENGTH]
        if content[-LENGTH:] != seal(BytesIO(body), len(body)):
            raise ValueError("its checksum does not match")
        with h5py.File(BytesIO(body), "r") as file:
            if (file.attrs["identity"], file.attrs["chunk"]) != (self.identity, number):
                raise ValueError("it belongs to another sweep or chunk")
            for name, values in blank.arrays.items():
                if file[name].shape != values.shape:
                    raise ValueError("its arrays have other shapes")
                values[...] = file[name][()]
            blank.failures = file["failure"].asstr()[()].tolist()
            blank.notes, blank.seconds = tuple(json.loads(file.attrs["notes"])), float(file.attrs["seconds"])

    @property
    def is_finished(self) -> bool:
        """Whether the file with all results exists, has valid checksums, and belongs to this sweep."""
        import h5py

        from graspfx.recording.file import require_contained

        try:
            with h5py.File(self.final, "r") as file:
                require_contained(file, self.final)
                for data in file.values():
                    data[()]
                return bool(file.attrs.get("identity") == self.identity)
        except (OSError, RuntimeError, LookupError, ValueError):
            return False

    def finish(self, labels: Labels) -> None:
        """Write the file with all results.

        Raises:
            RecordingError: If the disk cannot be written.
        """
        write_whole(self.final, netcdf(labels))


def write_whole(place: Path, content: bytes) -> None:
    """Write a file atomically: write a temporary file, flush it to disk, and rename it.

    Raises:
        RecordingError: If the disk cannot be written.
    """
    draft = place.with_name(f".{place.name}{DRAFT}")
    try:
        with draft.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(place)
    except OSError as error:
        with suppress(OSError):  # frees its bytes on a full disk
            draft.unlink()
        raise RecordingError(f"{place}: cannot be written; {error.strerror}: files written before are kept") from error
    sync_folder(place.parent)


# The folder -----------------------------------------------------------------------------------------------------------


@contextmanager
def open_folder(
    path: Path, parts: Mapping[str, Any], size: int, *, resume: bool, overwrite: bool
) -> Iterator[SweepFolder]:
    """Open the folder of a sweep, and lock it until the end of the `with` block.

    Args:
        path: Path of the folder, which is created if it does not exist.
        parts: Everything on which the results depend, from `sweep_parts`.
        size: Number of variants per chunk of a new sweep.
        resume: Whether to resume the sweep if the folder contains the same sweep.
        overwrite: Whether to remove any sweep in the folder first.

    Raises:
        SweepError: If the folder contains another sweep, or results without a readable description; the folder contains
            the same sweep and `resume` is False; or another process is running a sweep in the folder.
        RecordingError: If the folder or a file in it cannot be written.
    """
    make_folder(path)
    try:
        file = claim(path / LOCK)
    except RecordingError:
        text = f"{path}: another process is running a sweep in this folder; wait for its end, or choose another --out"
        raise SweepError(text) from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written; {error.strerror}") from error
    _locks.add(file)
    try:
        yield _folder(path, parts, size, resume=resume, overwrite=overwrite)
    finally:
        _locks.discard(file)
        file.close()


def _folder(path: Path, parts: Mapping[str, Any], size: int, *, resume: bool, overwrite: bool) -> SweepFolder:
    identity, removal = identity_of(parts), _remove(path) if overwrite else ""
    there = manifest_of(path)
    if there is None and (results := _results(path)):
        text = f"{path}: has {results} of a sweep, but no readable {MANIFEST}"
        raise SweepError(f"{text}; choose another --out, or start again with --overwrite (overwrite=True)")
    if there is None:
        about = {"format": FORMAT, "identity": identity, "chunk": size, "created": now(), "parts": dict(parts)}
        write_whole(path / MANIFEST, json.dumps(about, indent=1).encode())
        make_folder(path / CHUNKS)
        return SweepFolder(path, about, removal)
    if there["identity"] != identity:
        lines = _differences(there.get("parts", {}), parts)
        more = f"; and {len(lines) - 5} more" if len(lines) > 5 else ""
        text = f"{path} is the folder of another sweep: {'; '.join(lines[:5])}{more}"
        raise SweepError(f"{text}. Choose another --out, or replace it with --overwrite (overwrite=True)")
    if not resume:
        done = len(_chunks(path))
        how = "continue with --resume (resume=True), or start again with --overwrite (overwrite=True)"
        raise SweepError(f"{path} already contains {counted(done, 'chunk')} of this sweep; {how}")
    make_folder(path / CHUNKS)
    for draft in (path / CHUNKS).glob(f".*{DRAFT}"):
        with suppress(OSError):
            draft.unlink()
    return SweepFolder(path, there)


def manifest_of(path: Path) -> dict[str, Any] | None:
    """Read the description of the sweep in a folder; return None if it is missing or unreadable.

    Raises:
        SweepError: If the folder has another format than this version of GraspFX reads.
    """
    try:
        about: dict[str, Any] = json.loads((path / MANIFEST).read_bytes())
        kind = about["format"], str(about["identity"]), str(about["created"])
        if int(about["chunk"]) < 1:
            return None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    if kind[0] != FORMAT:
        how = "choose another --out, or start again with --overwrite (overwrite=True)"
        raise SweepError(f"{path}: is a sweep of format {kind[0]}, but this GraspFX reads {FORMAT}; {how}")
    return about


def _chunks(path: Path) -> list[Path]:
    """Return the paths of the files of chunks, including npz files of format 1."""
    return [each for kind in ("nc", "npz") for each in (path / CHUNKS).glob(f"{'[0-9]' * 6}.{kind}")]


def _results(path: Path) -> str:
    """Return a description of the results in a folder, such as "3 chunks and sweep.nc"; empty for no results."""
    count = len(_chunks(path))
    names = [counted(count, "chunk")] * bool(count) + [FINAL] * (path / FINAL).is_file()
    return " and ".join(names)


def _remove(path: Path) -> str:
    """Remove the files of a sweep, and only these, from a folder; the description is removed last.

    Returns:
        Text about the removed sweep; empty if there were no results.
    """
    try:
        there = manifest_of(path)
        title = f"the sweep of {there['created']}" if there is not None else f"a sweep with an unreadable {MANIFEST}"
    except SweepError:
        title = "a sweep of another format"
    results = _results(path)
    try:
        for each in (*_chunks(path), path / FINAL, path / MANIFEST):
            each.unlink(missing_ok=True)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be overwritten; {error.strerror}") from error
    return f"{path}: {title} was removed to start again, with {results}" if results else ""


def folder_of(out: object) -> Path:
    """Convert the argument `out` to the path of a folder, which need not exist.

    Raises:
        InputError: If the argument is not a path, or a file has this path.
    """
    path = to_path("out", out, "the path of a folder")
    if path.is_file():
        raise InputError("out", str(path), "the path of a folder", "a file of that name exists")
    return path


_locks: set[Any] = set()  # locks of this process's folders


def _let_go() -> None:
    for file in _locks:
        with suppress(OSError):
            file.close()
    _locks.clear()


if hasattr(os, "register_at_fork"):  # a forked worker would keep the lock for its lifetime
    os.register_at_fork(after_in_child=_let_go)


# Identity of a sweep -------------------------------------------------------------------------------------------------


def identity_of(parts: Mapping[str, Any]) -> str:
    """Compute the digest of everything on which the results of a sweep depend."""
    return sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def sweep_parts(
    scene: Scene,
    variants: VariantGrid,
    duration: float,
    measure: Sequence[str],
    statistics: Sequence[str],
    files: Mapping[str, str],
    engines: Mapping[str, str],
) -> dict[str, Any]:
    """Collect everything on which a sweep's results depend, as data for JSON."""
    lists = {key: [_written(each) for each in items] for key, items in variants.lists.items()}
    return {
        "scene": json.loads(json.dumps(scene.to_dict())),
        "files": by_name(files),
        "variants": {key: _brief(items) for key, items in lists.items()},
        "values": sha256(json.dumps([lists, list(variants.shape), variants.numbers.tolist()]).encode()).hexdigest(),
        "shape": list(variants.shape),
        "sample": [variants.sample, variants.seed] if variants.sample else [],
        "measure": list(measure),
        "statistics": list(statistics),
        "duration": duration,
        "version": [__version__, RESULTS, *(" ".join(each) for each in engines.items())],
    }


def _differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Describe the differences between the sweep in a folder (`there`) and the requested sweep (`here`)."""
    lines = [
        *scene_changes(there.get("scene", {}), here["scene"]),
        *file_changes(there.get("files", {}), here["files"]),
    ]
    values, here_values = there.get("variants", {}), here["variants"]
    for key in dict.fromkeys([*values, *here_values]):
        one, two = values.get(key, "not swept"), here_values.get(key, "not swept")
        if one != two:
            lines.append(f"{key}: {one} there, {two} here")
    for name in ("shape", "sample", "measure", "statistics", "duration", "version"):
        if there.get(name) != here[name]:
            lines.append(f"{name}: {brief(there.get(name))} there, {brief(here[name])} here")
    return lines or ["values of the keys differ in their last digits or in their order"]


def _written(value: Any) -> Any:
    """Convert a value to types of JSON or, if this is not possible, to its `repr`."""
    try:
        return json.loads(json.dumps(value))
    except (TypeError, ValueError):
        return repr(value)


def _brief(items: Sequence[Any]) -> str:
    if len(items) <= FEW:
        return ", ".join(brief(each) for each in items)
    return f"{len(items)} values from {brief(items[0])} to {brief(items[-1])}"


# NetCDF 4, which is HDF5 with scales: xarray, netCDF4, MATLAB, Julia and R read it ------------------------------------


def netcdf(labels: Labels) -> bytes:
    """Return the content of a netCDF file with labelled arrays."""
    import h5py

    content = BytesIO()
    with h5py.File(content, "w", libver=("earliest", "v110"), track_order=True) as file:
        scales = _scales(file, labels)
        auxiliary = [name for name in labels.coordinates if name not in scales]
        for name, (dimensions, values, about) in {**labels.coordinates, **labels.variables}.items():
            data = file[name] if name in scales else _variable(file, name, np.asarray(values))
            for key, text in about.items():
                data.attrs[key] = text
            if name in scales:
                continue
            for axis, dimension in enumerate(dimensions):
                data.dims[axis].attach_scale(scales[dimension])
            if auxiliary and name in labels.variables:
                data.attrs["coordinates"] = " ".join(auxiliary)
        for key, value in labels.attributes.items():
            file.attrs[key] = "\n".join(value) if isinstance(value, list) else value
    return content.getvalue()


def _scales(file: Any, labels: Labels) -> dict[str, Any]:
    """Create an HDF5 dimension scale for each dimension, with the dimension's coordinates if it has any."""
    sizes: dict[str, int] = {}
    for dimensions, values, _ in (*labels.coordinates.values(), *labels.variables.values()):
        sizes |= dict(zip(dimensions, np.shape(values), strict=True))
    scales = {}
    for name, size in sizes.items():
        if name in labels.coordinates:
            scales[name] = _variable(file, name, np.asarray(labels.coordinates[name][1]))
            scales[name].make_scale(name)
        else:
            scales[name] = file.create_dataset(name, (size,), np.float32)
            scales[name].make_scale(f"{NO_VARIABLE}{size:10d}")
    for number, scale in enumerate(scales.values()):
        scale.attrs["_Netcdf4Dimid"] = np.int32(number)
    return scales


def _variable(file: Any, name: str, values: Any) -> Any:
    import h5py

    if values.dtype.kind in "UO":
        data = file.create_dataset(name, values.shape, h5py.string_dtype())
        data[...] = values.astype(object)
        return data
    packing: Mapping[str, Any] = {"compression": "gzip", "shuffle": True} if values.size > LEAST else {}
    packing = {**packing, "fletcher32": True} if values.size and values.ndim else packing
    fill = {"fillvalue": np.nan} if values.dtype.kind == "f" else {}
    return file.create_dataset(name, data=values, **packing, **fill)
