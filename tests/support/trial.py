"""Tries each of many damaged files in a process of its own kind: with little memory, a budget of time, and no mercy.

Run as a script it tries files one after the other, a line of JSON each; `outcomes` runs it, and goes on after a crash.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

MEMORY = 3_000_000_000  # [bytes] of addresses, of which most are never touched
SECONDS = 20.0  # of processor time for a case; thrice that on a clock, and it hangs
LONGEST = 20_000  # letters of an error


@dataclass(frozen=True)
class Outcome:
    """How a case ended.

    Attributes:
        error: the name of the exception's type; "" for success, "died" for a process that did, "late" for one stopped.
        text: of the error.
        ours: whether it is an error of GraspFX.
        seconds: processor time.
        megabytes: most memory of the process so far.
    """

    error: str
    text: str = ""
    ours: bool = False
    seconds: float = 0.0
    megabytes: float = 0.0

    @property
    def is_sound(self) -> bool:
        """Success, or one error of ours."""
        return not self.error or (self.ours and 0 < len(self.text) < LONGEST)


def outcomes(kind: str, files: Sequence[Path]) -> list[Outcome]:
    """The outcome of each file, tried as "scene" or "mesh"."""
    found: list[Outcome] = []
    while len(found) < len(files):
        rest = [str(file) for file in files[len(found) :]]
        command = [sys.executable, "-X", "faulthandler", str(Path(__file__).resolve()), kind]
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as child:
            try:
                out, err = child.communicate("\n".join(rest), timeout=3.0 * SECONDS + 2.0 * len(rest))
                code = child.returncode
            except subprocess.TimeoutExpired:
                child.kill()
                out, err = child.communicate()
                code = 0
        found += [Outcome(**json.loads(line)) for line in out.splitlines()]
        if len(found) < len(files):
            found.append(Outcome("died" if code else "late", f"exit code {code}: {err[-400:]}"))
    return found


class Late(BaseException):
    """Raised in a case that takes too long."""


def _late(*_: object) -> None:
    raise Late


def _scene(file: str) -> None:
    import graspfx as gx

    scene = gx.load(file)
    gx.run(scene, duration=min(scene.duration, 4.0 * scene.period))


def _mesh(file: str) -> None:
    import numpy as np

    from graspfx.surfaces.triangles.mesh import load_mesh

    mesh = load_mesh(file, shell="shell" in Path(file).name)
    weight = mesh.mass_properties(mass=0.1)
    assert np.isfinite(weight.inertia).all() and weight.moments.min() > 0.0, "moments that are no body's"
    assert 2.0 * weight.moments.max() <= weight.moments.sum() * (1.0 + 1e-6), "moments that are no body's"
    contacts = mesh.contact(mesh.vertices[:1] + 1e-3)
    assert np.isfinite(contacts.point).all() and np.isfinite(contacts.normal).all(), "contacts that are nowhere"


def _try(call: Any, file: str) -> dict[str, Any]:
    from graspfx.errors import GraspFXError

    began = time.process_time()
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    error, text, ours = "", "", False
    try:
        call(file)
    except Late:
        error = "late"
    except Exception as fault:  # noqa: BLE001 - whatever it is, is what is looked for
        error, text, ours = type(fault).__name__, str(fault), isinstance(fault, GraspFXError)
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    words = Path("/proc/self/status").read_text().split()  # getrusage tells the parent's before the fork
    memory = int(words[words.index("VmHWM:") + 1]) * 1024 / 1e6
    took = time.process_time() - began
    return {"error": error, "text": text, "ours": ours, "seconds": took, "megabytes": memory}


def _main() -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGVTALRM, _late)
    warnings.simplefilter("ignore")
    if sys.argv[1] == "scene":  # what is compiled once, and kept, counts for no case
        import graspfx as gx

        gx.run("reference-1dof", duration=0.02)
    call = {"scene": _scene, "mesh": _mesh}[sys.argv[1]]
    for file in sys.stdin.read().splitlines():
        print(json.dumps(_try(call, file)), flush=True)


if __name__ == "__main__":
    _main()
