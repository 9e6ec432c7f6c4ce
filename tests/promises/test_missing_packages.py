"""Without PyBullet, matplotlib or LLVM everything works that does not need it, and the rest says what is missing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RUN = """
import contextlib, io, json, sys, traceback
from pathlib import Path
sys.modules[sys.argv[1]] = None
folder = Path(sys.argv[2])
other = folder / "site" / "other-0.dist-info"  # what is installed has changed: answers kept from before do not count
other.mkdir(parents=True)
(other / "METADATA").write_text("Name: other", "utf-8")
sys.path.append(str(other.parent))
from graspfx.__main__ import main
run, recording = folder / "waving", str(folder / "waving" / "recording.h5")
answers = {}
for words in (
    ["run", "paper-waving", "--duration", "0.1", "--out", str(run)],
    ["run", "two-objects", "--duration", "0.02", "--out", str(folder / "two"), "--no-figure"],
    ["check", "paper-waving"],
    ["check", "two-objects"],
    ["plot", recording, "--out", str(folder / "figures")],
    ["picture", "paper-waving", "--out", str(folder / "waving.png")],
    ["export", recording, "--out", str(folder / "waving.csv")],
    ["replay", recording],
    ["stability", "paper-waving"],
    ["warmup", "--kernels"],
    ["list"],
    ["schema"],
    ["devices"],
):
    shown, said = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(said):
            code = main(words)
    except SystemExit as end:
        code = end.code
    except Exception:
        code = traceback.format_exc()
    answers[" ".join(words[:2]) if words[0] in ("run", "check") else words[0]] = code, shown.getvalue(), said.getvalue()
json.dump([answers, sorted(each.name for each in run.iterdir())], sys.__stdout__)
"""
REFUSALS = {
    "pybullet": {"run two-objects", "check two-objects"},
    "matplotlib": {"plot", "picture"},
    "llvmlite": {"warmup"},
}


@pytest.mark.parametrize("package", REFUSALS)
def test_what_does_not_need_a_package_works_without_it(package: str, tmp_path: Path) -> None:
    """No traceback, the code of success or of an error, and in the words of an error the package and the way to it."""
    done = subprocess.run(
        [sys.executable, "-c", RUN, package, str(tmp_path)], capture_output=True, text=True, cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    answers, files = json.loads(done.stdout)
    import_of_bullet = package == "pybullet" or sys.version_info >= (3, 12)
    refused = REFUSALS[package] | (REFUSALS["pybullet"] if import_of_bullet else set())
    for name, (code, _, said) in answers.items():
        assert code == (2 if name in refused else 0), (name, code, said)
        if name in REFUSALS[package]:
            assert package in said and "not installed" in said and "install" in said.partition("not installed")[2]
    assert files == (["recording.h5"] if package == "matplotlib" else ["figure.png", "recording.h5"])
    said = "".join(said for _, _, said in answers.values())
    shown = "".join(shown for _, shown, _ in answers.values())
    if package == "matplotlib":
        assert "no figure: the package 'matplotlib' is not installed" in said
    if package == "llvmlite":
        assert "ticks are interpreted, with equal results: the package 'llvmlite' is not installed" in said
        assert "interpreted" in shown
