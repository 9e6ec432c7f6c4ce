"""A distribution of another's, built and installed: its driver, scenes and dynamics are found and used by name."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

FILES = {
    "pyproject.toml": """
        [build-system]
        requires = ["hatchling"]
        build-backend = "hatchling.build"

        [project]
        name = "acme-rig"
        version = "1.2"
        dependencies = ["graspfx"]

        [project.entry-points."graspfx.devices"]
        rail = "acme_rig.rail"

        [project.entry-points."graspfx.scenes"]
        acme-push = "acme_rig.push"
        acme-row = "acme_rig.row"

        [project.entry-points."graspfx.dynamics"]
        syrup = "acme_rig.syrup"
    """,
    "acme_rig/__init__.py": "",
    "acme_rig/rail.py": '''
        """A carriage on a rail, simulated: the point device with a limit of its own."""
        from dataclasses import replace
        from graspfx.devices import simulated

        def connect(*, carriage=0.2, dimensions=1):
            return simulated.connect(mass=carriage, damping=1.0, dimensions=dimensions)
    ''',
    "acme_rig/push.toml": """
        title = "Two rails push a block through syrup"
        dimensions = 1
        period = 0.005
        duration = 0.1

        [object]
        mass = 0.1
        viscosity = 0.8
        shape = { kind = "box", size = [0.04] }
        dynamics = "syrup"

        [coupling]
        external = { stiffness = 30.0 }
        internal = { stiffness = 70.0 }

        [[finger]]
        device = { name = "rail", carriage = 0.3 }
        hand = { stiffness = 50.0, rest = [-0.01] }
        start = [-0.019]

        [[finger]]
        device = { name = "rail" }
        hand = { stiffness = 50.0, rest = [0.01] }
        start = [0.019]
    """,
    "acme_rig/row.py": '''
        """The same from Python, with a parameter."""
        import graspfx as gx

        def scene(mass: float = 0.2) -> gx.Scene:
            return gx.load("acme-push", {"object.mass": mass})
    ''',
    "acme_rig/syrup.py": '''
        """The native body in a fluid in which it does not move."""
        from graspfx.protocols import NativeBody

        class Stuck:
            def __init__(self, state):
                self.real = NativeBody(state)

            def free_motion(self, T):
                self.real.free_motion(T)

            def step(self, T):
                pass

        def create(state):
            return Stuck(state)
    ''',
}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the built wheel is unpacked, which is what installing a pure one means."""
    source, built = tmp_path_factory.mktemp("acme-rig"), tmp_path_factory.mktemp("built")
    for name, text in FILES.items():
        (source / name).parent.mkdir(exist_ok=True)
        lines = text.strip("\n").splitlines()
        indent = len(lines[0]) - len(lines[0].lstrip()) if lines else 0
        (source / name).write_text("\n".join(line[indent:] for line in lines) + "\n")
    code = f"from hatchling.build import build_wheel; print(build_wheel({str(built)!r}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=source, capture_output=True, text=True, check=True)
    with zipfile.ZipFile(built / done.stdout.strip()) as wheel:
        wheel.extractall(built / "site")
    return built / "site"


def python(site: Path, cwd: Path, *arguments: str) -> str:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}
    done = subprocess.run([sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_they_are_listed_with_their_owner(site: Path, tmp_path: Path) -> None:
    lines = [line.split() for line in python(site, tmp_path, "-m", "graspfx", "list").splitlines()]
    seen = {line[0]: " ".join(line[1:]) for line in lines}
    for name, module in (("rail", "rail"), ("acme-push", "push"), ("acme-row", "row"), ("syrup", "syrup")):
        assert seen[name].endswith(f"[acme-rig 1.2 (acme_rig.{module})]")
    assert seen["syrup"].startswith("The native body in a fluid in which it does not move [")


@pytest.mark.parametrize("scene", ["acme-push", "acme-row"])
def test_a_plan_names_them_and_a_run_uses_them(site: Path, tmp_path: Path, scene: str) -> None:
    """In syrup the object stays exactly where it is, though the carriages differ and push it unevenly."""
    code = (
        "import graspfx as gx\n"
        "from graspfx.__main__ import main\n"
        f"assert main(['check', {scene!r}, '-v']) == 0 and main(['run', {scene!r}, '--json', '--no-figure']) == 0\n"
        f"rec = gx.testing.check_scene({scene!r}, energy=None)\n"
        "assert not rec.object_position.any() and rec.finger_position[-1].sum() != 0.0\n"
        "gx.testing.check_device(lambda: gx.testing.driver('rail').connect(carriage=0.3))\n"
    )
    plan, brace, table = python(site, tmp_path, "-c", code).partition("{")
    assert "2 x rail" in plan and "syrup" in plan
    summary = json.loads(brace + table)
    assert summary["ticks"] == 20 and summary["faults"] == 0 and min(summary["peak_force"]) > 0.05
