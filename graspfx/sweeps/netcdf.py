"""Labelled arrays as netCDF 4, which is HDF5 with scales: xarray, netCDF4, MATLAB, Julia and R read it."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from graspfx.show.labelled import Labels

LEAST = 4096  # numbers of a variable that is packed
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable."


def netcdf(labels: Labels) -> bytes:
    """Write labelled arrays as the bytes of a file."""
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
    """Make a scale for each dimension: with its entries where there are, else one that only counts."""
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


def is_whole(path: Path, identity: str) -> bool:
    """Tell whether a file of results is there, can be read with sums that check, and is this sweep's."""
    import h5py

    from graspfx.recording.file import require_contained

    try:
        with h5py.File(path, "r") as file:
            require_contained(file, path)
            for data in file.values():
                data[()]
            return bool(file.attrs.get("identity") == identity)
    except (OSError, RuntimeError, LookupError, ValueError):
        return False
