"""Drivers for scenes with libraries that no scene can name: what LLVM has loaded into this process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

LIBRARIES: list[Any] = []  # the newest last
DRIVER = '''
"""A driver with the newest of the libraries."""
from graspfx.testing import driver
from tests.support.wired_drivers import LIBRARIES

def connect(**settings):
    return driver("{name}").connect(library=LIBRARIES[-1], **settings)
'''


def wired_driver(folder: Path, name: str, library: Any) -> str:
    """Write a driver that connects those of a name to a library; give its path."""
    LIBRARIES.append(library)
    file = folder / f"wired_{name.replace('-', '_')}.py"
    file.write_text(DRIVER.format(name=name))
    return str(file)
