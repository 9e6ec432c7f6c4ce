"""The README: what its commands print is what they print here, and every link leads somewhere."""

from __future__ import annotations

import doctest
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[[^\]]*\]\(([^)#\s]*)(#[^)]*)?\)")
SHELVES = ("decisions/0", "examples/0", "examples/1", "examples/2")  # of pages that a page of theirs lists
PAGES = [README, ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(language: str) -> list[str]:
    text = README.read_text(encoding="utf-8")
    return [body for kind, body in FENCE.findall(text) if kind == language]


def commands() -> list[tuple[str, str]]:
    """List the README's commands, in their order, each with what it prints as far as the README says."""
    pairs = []
    for block in blocks("console"):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, _, output = part.partition("\n")
            pairs.append((command.partition("  #")[0].strip(), output))
    return pairs


def test_commands_print_what_the_readme_says(tmp_path: Path) -> None:
    """Each runs in a shell, in a folder with the scenes of a checkout."""
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    scripts = sysconfig.get_path("scripts")
    environment = os.environ | {"PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    graspfx = f"'{sys.executable}' -m graspfx"
    checker = doctest.OutputChecker()
    every = commands()
    assert len(every) == 8
    for command, expected in every:
        line = re.sub(r"^graspfx\b", lambda _: graspfx, command)
        done = subprocess.run(
            line, shell=True, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        said = done.stdout + done.stderr
        if expected:
            assert checker.check_output(expected, said, doctest.ELLIPSIS), (command, said)
        else:
            assert done.returncode == 0, (command, said)
    assert {"recording.h5", "figure.png", "figure.svg"} <= {path.name for path in (tmp_path / "out/mine").iterdir()}
    assert (tmp_path / "out/sphere-three-fingers/picture.png").is_file()


def test_make_demo_shows_what_the_readme_tells(tmp_path: Path) -> None:
    """The recipe of `make demo`, run without an environment of its own: the numbers of the caption are its table's."""
    if shutil.which("make") is None:
        pytest.skip("make is not installed here")
    graspfx = f"'{sys.executable}' -m graspfx"
    plan = subprocess.run(
        ["make", "--dry-run", "--silent", "-W", "pyproject.toml", "demo", f"OUT={tmp_path}/out", "BIN=BIN"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    lines = [line for line in plan.splitlines() if line.startswith(("echo", "BIN/graspfx"))]
    recipe = "\n".join(re.sub(r"^BIN/graspfx", lambda _: graspfx, line) for line in lines)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "100", "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(
        f"set -e\n{recipe}", shell=True, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    rows = {line.split("│")[0].strip(): line.split("│")[1:4] for line in done.stdout.splitlines() if "│" in line}
    depth, force = (
        [float(cell) for cell in done_row]
        for done_row in (_first(done.stdout, "depth of a finger, mean"), _first(done.stdout, "force vibration"))
    )
    assert rows
    assert [round(each, 1) for each in depth] == [6.5, 4.6, 4.5]
    assert [round(force[0], 1), round(force[1]), round(force[2], 1)] == [0.2, 108, 0.7]
    caption = README.read_text(encoding="utf-8").partition("## ")[0]
    for number in ("6.5 mm", "4.6 mm", "4.5 mm", "108 mN", "0.7 mN"):
        assert number in caption
    files = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*") if path.is_file()}
    folders = ["light-hand/too-soft", "light-hand/unstable", "light-hand/both-good", "conventional", "proposed"]
    assert {f"{folder}/recording.h5" for folder in folders} <= files
    assert {"comparison.png", "light-hand/comparison.png", "conventional/figure.png", "proposed/figure.png"} <= files
    assert len(done.stdout.splitlines()) < 40  # a minute's reading


def _first(text: str, name: str) -> list[str]:
    """The cells of the first row of that name."""
    line = next(line for line in text.splitlines() if line.startswith(name))
    return line.split("│")[1:4]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    lost = []
    for place, anchor in LINK.findall(page.read_text(encoding="utf-8")):
        if "://" in place:
            continue
        target = (page.parent / place).resolve() if place else page
        heads = _anchors(target) if anchor and target.suffix == ".md" and target.is_file() else {anchor}
        if not target.exists() or anchor not in heads:
            lost.append(place + anchor)
    assert lost == []


def _anchors(page: Path) -> set[str]:
    heads = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {"#" + re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


def test_the_list_of_pages_has_every_page() -> None:
    text = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    pages = [path.relative_to(ROOT / "docs").as_posix() for path in PAGES if path.is_relative_to(ROOT / "docs")]
    listed = [page for page in pages if page not in ("README.md", "index.md") and not page.startswith(SHELVES)]
    assert [page for page in listed if f"({page})" not in text] == []
    assert "(docs/README.md)" in README.read_text(encoding="utf-8")
