"""Words of commands beside their answers: -v and -vv on standard error, -q errors alone; and Python's logging."""

from __future__ import annotations

import logging
import subprocess
import sys
from pathlib import Path

import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.compile.native import compiled

RUN = ("run", "paper-waving", "--duration", "0.1", "--no-figure", "--overwrite")


pytestmark = pytest.mark.usefixtures("new_cache")


def test_a_run_says_what_it_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [*RUN, "--out", str(tmp_path / "out"), "--set", "engine=interpreted"]
    assert main([*words, "-v"]) == 0
    said = capsys.readouterr()
    for part in ("skipped: pads:", "engine interpreted", "20 ticks in", f"wrote {tmp_path / 'out' / 'recording.h5'}"):
        assert part in said.err, part
    assert "lowered" not in said.err  # a detail
    assert main(words) == 0
    plain = capsys.readouterr()
    assert "engine" not in plain.err and plain.out.splitlines()[-1] == said.out.splitlines()[-1]
    assert logging.getLogger("graspfx").level == logging.NOTSET


def test_programs_are_said_to_be_compiled_or_in_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "cache"))
    text = "def run(A, n):\n    A[0] = A[0] + n\n    return n\n"
    for part in ("compiled in", "of machine code from the cache"):
        caplog.clear()
        with caplog.at_level(logging.INFO, "graspfx"):
            compiled(text)
        assert any(part in message for message in caplog.messages)


def test_what_a_run_loads_is_said_with_its_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [*RUN, "--out", str(tmp_path / "out"), "--set", "engine=compiled", "-vv"]
    assert main(words) == 0
    said = capsys.readouterr().err
    assert "engine compiled" in said and " ms  " in said


def test_a_cache_that_cannot_be_written_is_said_to_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "file" / "cache"))
    from graspfx.compile import cache as disk

    with caplog.at_level(logging.INFO, "graspfx"):
        assert disk.store("key", b"content")
        assert disk.load("key") is None
    assert any("cannot write to the cache" in message for message in caplog.messages)


def test_settling_is_logged_from_python(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "graspfx"):
        gx.certify("paper-spring")
    assert any(message.startswith("settling: at rest in") for message in caplog.messages)
    assert logging.getLogger("graspfx").handlers


def test_a_quiet_run_says_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [*RUN, "--out", str(tmp_path / "out"), "--set", "coupling.internal.stiffness=900"]
    assert main(words) == 0
    said = capsys.readouterr()
    assert "note: " in said.err and "wrote" in said.out
    assert main([*words, "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["check", "paper-spring", "--brief", "--quiet"]) == 0
    assert capsys.readouterr().out.startswith("stable: ")
    assert main(["run", "paper-wavin", "-q"]) == 2
    assert "unknown scene" in capsys.readouterr().err


def test_nothing_is_logged_before_somebody_listens() -> None:
    """To import GraspFX does not load `logging`, and a message finds it once it is there."""
    code = (
        "import sys, graspfx, graspfx.log as log\n"
        "log.info('nobody hears')\n"
        "assert 'logging' not in sys.modules and not log.is_heard()\n"
        "import logging\n"
        "assert not log.is_heard()\n"
        "logging.basicConfig(level=logging.INFO, format='%(name)s %(message)s', stream=sys.stdout)\n"
        "log.debug('a detail'); log.info('%d of %s', 2, 'these')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "graspfx 2 of these\n" and done.stderr == ""
