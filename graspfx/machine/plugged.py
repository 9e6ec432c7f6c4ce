"""Search for the ports, libraries and services that device drivers need, by names of files; no device is opened."""

from __future__ import annotations

import os
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from graspfx.installed import version
from graspfx.plugins import names, source_of

HINTS = "hints.toml"  # beside a driver's __init__.py
SERIAL = "dev/serial/by-id"
BARE = ("ttyACM*", "ttyUSB*")  # names in /dev of serial ports over USB
INPUT = "dev/input/by-id"
FOLDERS = ("usr/lib", "usr/lib64", "usr/local/lib", "lib", "lib64", "opt/lib")
PATHS = {"win32": "PATH", "darwin": "DYLD_LIBRARY_PATH"}  # environment variables with folders of libraries
ELSEWHERE = "LD_LIBRARY_PATH"
PRINTABLE = 200  # longest name of a port that is listed


@dataclass(frozen=True)
class Sighting:
    """Result of the search for one driver.

    Attributes:
        driver: Name of the driver; "-" for a port that matches no driver.
        sight: Port, library or service that was found, or a description of what is missing.
        device: Device table for a scene, in TOML; empty if nothing was found.
    """

    driver: str
    sight: str
    device: str = ""


def sightings(root: Path = Path("/")) -> list[Sighting]:
    """Return the results of the search for all drivers, followed by the serial ports that match no driver.

    Args:
        root: Root of the file system.
    """
    serial, inputs = _links(root / SERIAL), _links(root / INPUT)
    bare = [path for pattern in BARE for path in sorted((root / "dev").glob(pattern))]
    behind = {path.resolve() for path in serial}
    serial += [path for path in bare if path.resolve() not in behind]
    matches: set[Path] = set()
    listing: list[Sighting] = []
    for driver in names("devices"):
        hints = hints_of(driver)
        ports = [path for path in (*serial, *inputs) if _fits(path, hints)]
        matches |= set(ports)
        listing += [_port(driver, path, root) for path in ports] or list(_rest(driver, hints, root))
    others = [path for path in serial if path not in matches]
    return listing + [Sighting("-", f"{_name(path, root)}: matches no driver", "") for path in others]


def hints_of(driver: str) -> Mapping[str, object]:
    """Read the file hints.toml of a driver without importing the driver; return an empty mapping if there is none."""
    source = source_of("devices", driver)
    if source is None or source.name != "__init__.py":
        return {}
    try:
        return tomllib.loads((source.parent / HINTS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def _links(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if path.name.isprintable() and len(path.name) < PRINTABLE)
    except OSError:
        return []


def _patterns(hints: Mapping[str, object], key: str) -> Sequence[str]:
    value = hints.get(key, [])
    return [each for each in value if isinstance(each, str)] if isinstance(value, list) else []


def _fits(path: Path, hints: Mapping[str, object]) -> bool:
    key = "input" if path.parent.name == "by-id" and path.parent.parent.name == "input" else "serial"
    return any(fnmatch(path.name.lower(), pattern.lower()) for pattern in _patterns(hints, key))


def _port(driver: str, path: Path, root: Path) -> Sighting:
    port = _name(path, root)
    return Sighting(driver, port, f'{{ name = "{driver}", port = "{port}" }}')


def _name(path: Path, root: Path) -> str:
    return f"/{path.relative_to(root)}"


def _rest(driver: str, hints: Mapping[str, object], root: Path) -> Iterator[Sighting]:
    """Yield the result of the search for a driver that matches no port."""
    package, extra = hints.get("package"), hints.get("extra")
    if isinstance(package, str) and isinstance(extra, str) and version(package) is None:
        yield Sighting(driver, f"the package {package} is not installed: pip install 'graspfx[{extra}]'")
    elif hints.get("simulated") is True:
        yield Sighting(driver, "a simulation", f'{{ name = "{driver}" }}')
    elif libraries := _patterns(hints, "libraries"):
        place = library_at(libraries, root)
        if place is None:
            yield Sighting(driver, f"no {' or '.join(libraries)}: install the vendor's SDK")
        else:
            yield Sighting(driver, str(place), f'{{ name = "{driver}" }}')
    elif isinstance(service := hints.get("service"), str):
        yield Sighting(driver, f"a service at {service}, not queried", f'{{ name = "{driver}" }}')
    elif hints:
        yield Sighting(driver, "no matching device is connected")
    else:
        yield Sighting(driver, "not searched: the driver has no hints.toml")


def library_at(libraries: Sequence[str], root: Path = Path("/")) -> Path | None:
    """Return the path of the first library found by its file name in the loader's folders; None if there is none."""
    variable = os.environ.get(PATHS.get(sys.platform, ELSEWHERE), "")
    folders = [Path(each) for each in variable.split(os.pathsep) if each]
    for place in FOLDERS:
        folders += [root / place, *sorted((root / place).glob("*-linux-*"))]
    return next((folder / name for name in libraries for folder in folders if (folder / name).is_file()), None)
