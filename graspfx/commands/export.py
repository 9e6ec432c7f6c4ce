"""graspfx export: write a recording as CSV, netCDF or a ROS bag."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from graspfx.commands.arguments import add_options
from graspfx.commands.arguments import recording as recording_argument
from graspfx.commands.destination import add_file, file_in, name_files, require_room
from graspfx.commands.output import SUCCESS, say_source
from graspfx.errors import InputError, UnknownNameError
from graspfx.recording.files import placing

ENDINGS = {"csv": ".csv", "nc": ".nc", "bag": ".bag", "mcap": ".mcap", "db3": ".db3"}
FORMATS = ENDINGS | {"rosbag": ".mcap"}
RECORDINGS = ("h5", "hdf5", "part")  # endings of recordings: another format must not use them
EXAMPLE = """  graspfx export out/latest --format nc --out waving.nc
  graspfx export out/latest --out waving.mcap"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("recording", metavar="RECORDING", type=recording_argument, help="recording, or its folder")
    formats = "csv: one row per recorded tick, one column per component (default); nc: netCDF, for xarray and others"
    bags = "mcap (or rosbag), db3: ROS 2 bag; bag: ROS 1 bag"
    add_options(parser, ("--format FORMAT", f"{formats}; {bags}. The ending of FILE sets the default"))
    add_file(parser, "output file, or its folder (default: recording.csv, recording.nc, ... beside the recording)")


def execute(options: Namespace) -> int:
    from graspfx.recording.files import make_folder, recording_file
    from graspfx.recording.record import Recording

    source = recording_file(options.recording)
    kind = _format(options)
    path = file_in(options, source.parent, f"recording{FORMATS[kind]}")
    _require_ending(path, kind)
    require_room(options, [path])
    recording = Recording.load(source)
    say_source(options.recording, source, recording)
    make_folder(path.parent)
    if kind == "csv":
        recording.to_csv(path, overwrite=True)
    elif kind != "nc":
        from graspfx.show.ros_bag import write_bag

        write_bag(recording, path, FORMATS[kind][1:], overwrite=True)
    else:
        data = recording.to_xarray()
        with placing(path) as file:
            data.to_netcdf(file, engine="h5netcdf")
    name_files([path])
    return SUCCESS


def _require_ending(path: Path, kind: str) -> None:
    """Raise an InputError if the path has the ending of another format than `kind`, or of a recording."""
    ending = path.suffix[1:].lower()
    if f".{ending}" != FORMATS[kind] and (ending in ENDINGS or ending in RECORDINGS):
        raise InputError("--out", str(path), f"a file that ends in {FORMATS[kind]}", "or choose another --format")


def _format(options: Namespace) -> str:
    """Return the format: that of --format or, without --format, that of the ending of --out; csv for other endings."""
    ending = Path(options.out or "").suffix[1:]
    kind: str = options.format or (ending if ending in ENDINGS else "csv")
    if kind not in FORMATS:
        raise UnknownNameError("format", kind, FORMATS)
    return kind
