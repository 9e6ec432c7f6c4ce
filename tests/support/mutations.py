"""Mutation check: put seeded mistakes into a copy of the sources, one at a time, and run the tests (`make mutations`).

Each mistake is a sign, an off by one, a dropped term or a swapped axis in a kernel, a recording, a certificate or the
safety chain. The tests of its room run first, then those of `make fast`, the slow ones of the room, and all: the table
says which found it. What `room` finds is found by `make fast`, and what `slow-room` finds by `make test`.
"""

from __future__ import annotations

import argparse
import ast
import random
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PLACES = {  # where mistakes are made, and the tests that run first
    "kernels": ("graspfx/coupling", "graspfx/cones", "graspfx/grasp", "graspfx/objects", "graspfx/surfaces"),
    "recordings": ("graspfx/recording",),
    "certificate": ("graspfx/certificate", "graspfx/analysis"),
    "safety": ("graspfx/loop/safety", "graspfx/loop/energy"),
}
LAWS = ("tests/laws", "tests/oracles", "tests/paper")
LONG = "large or stress or faults or rest"
STAGES = {
    "room": f"not (alone or slow or {LONG})",
    "fast": f"not (alone or slow or {LONG})",
    "slow-room": f"slow and not (alone or {LONG})",
    "test": f"not (alone or {LONG})",
}
PATIENCE = 3600.0  # of tests that a mistake may keep from ending [s]
AXES = {"x": "y", "y": "z", "z": "x"}


class Mutation(NamedTuple):
    """A mistake: what stands at a place of a file, and what comes instead."""

    place: str
    file: str
    kind: str
    start: int
    old: str
    new: str

    def text(self, source: str) -> str:
        """Make the mistake in the file's text."""
        assert source[self.start : self.start + len(self.old)] == self.old
        return source[: self.start] + self.new + source[self.start + len(self.old) :]


def mistakes(source: str) -> Iterator[tuple[str, int, str, str]]:
    """List the mistakes that a source offers: kind, place, old and new text."""
    starts, lines = [0], source.splitlines(keepends=True)
    for line in lines:
        starts.append(starts[-1] + len(line))

    def span(node: ast.expr) -> tuple[int, str]:
        line = lines[node.lineno - 1].encode()
        end = node.end_col_offset if node.end_lineno == node.lineno else node.col_offset  # none over several lines
        return starts[node.lineno - 1] + len(line[: node.col_offset].decode()), line[node.col_offset : end].decode()

    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef):
            continue
        for node in (each for statement in function.body for each in ast.walk(statement)):
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
                start, old = span(node)
                left, right = span(node.left)[1], span(node.right)[1]
                if not old or '"' in old or "'" in old:
                    continue  # joined texts
                between = old[len(left) : len(old) - len(right)]
                if re.fullmatch(r" [+-] ", between):
                    yield "sign", start, old, f"{left} {'-' if '+' in between else '+'} {right}"
                    yield "dropped term", start, old, left
            elif isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.Lt | ast.Gt) and len(node.ops) == 1:
                start, old = span(node)
                sign = "<" if isinstance(node.ops[0], ast.Lt) else ">"
                if old.count(f" {sign} ") == 1 and isinstance(node.comparators[0], ast.Name | ast.Attribute):
                    yield "off by one", start, old, old.replace(f" {sign} ", f" {sign}= ")
            elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
                if isinstance(index := node.slice.value, int):
                    start, old = span(node.slice)
                    yield "off by one", start, old, str(index + 1)
            elif isinstance(node, ast.Attribute) and node.attr in AXES:
                start, old = span(node)
                if old:
                    yield "swapped axis", start, old, old[:-1] + AXES[node.attr]
            elif isinstance(node, ast.keyword) and node.arg == "axis" and isinstance(node.value, ast.Constant):
                start, old = span(node.value)
                if old in ("0", "1"):
                    yield "swapped axis", start, old, "10"[int(old)]


def choose(count: int, seed: int) -> list[Mutation]:
    """Choose so many mistakes, as many of each place as of the others, and of each kind as far as there are any."""
    found = defaultdict[str, defaultdict[str, list[Mutation]]](lambda: defaultdict(list))
    for place, folders in PLACES.items():
        for file in sorted(file for folder in folders for file in (ROOT / folder).rglob("*.py")):
            name = file.relative_to(ROOT).as_posix()
            for kind, start, old, new in mistakes(file.read_text("utf-8")):
                found[place][kind].append(Mutation(place, name, kind, start, old, new))
    draw, chosen = random.Random(seed), list[Mutation]()
    while len(chosen) < count:
        for place in PLACES:
            kinds = sorted(found[place])
            kind = kinds[len(chosen) // len(PLACES) % len(kinds)]
            chosen.append(found[place][kind].pop(draw.randrange(len(found[place][kind]))))
    return chosen[:count]


def failing(copy: Path, workers: str, mark: str, *folders: str) -> str:
    """Run the tests on a copy; give the first that fails, or the last line where they do not run; "" if they pass."""
    words = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "--tb=no", "-n", workers, "-m", mark]
    words += ["--dist", "worksteal", "-p", "no:cacheprovider", *folders]
    try:
        out = subprocess.run(words, cwd=copy, capture_output=True, text=True, timeout=PATIENCE).stdout
    except subprocess.TimeoutExpired:
        return f"no end within {PATIENCE:g} s"
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", out, re.MULTILINE)
    if failed is not None:
        return failed.group(1)
    return "" if " passed" in out else out.strip().splitlines()[-1][:80]


def verdict(mutation: Mutation, copy: Path, workers: str, stages: Sequence[str]) -> tuple[str, str]:
    """Run the tests on a copy with a mistake; give the stage that found it, and the first test that failed."""
    file = copy / mutation.file
    source = file.read_text("utf-8")
    file.write_text(mutation.text(source), "utf-8")
    folders = Path("tests", *Path(mutation.file).parts[1:]).parents
    room = next(folder for folder in folders if (copy / folder).is_dir())
    try:
        for stage in stages:
            folders_of_stage = {"room": [str(room), *LAWS], "slow-room": [str(room)]}.get(stage, [])
            if test := failing(copy, workers, STAGES[stage], *folders_of_stage):
                return stage, test
        return "", ""
    finally:
        file.write_text(source, "utf-8")


def main() -> None:
    """Try the mistakes and print a table of what found them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=25)
    parser.add_argument("--workers", default="auto")
    parser.add_argument("--stages", nargs="+", choices=STAGES, default=[*STAGES], help="which tests, in this order")
    parser.add_argument("--only", nargs="+", type=int, help="numbers of the mistakes to try, as those that were left")
    parser.add_argument("--list", action="store_true", help="list the mistakes and run nothing")
    options = parser.parse_args()
    chosen = dict(enumerate(choose(options.count, options.seed)))
    if options.only:
        chosen = {k: chosen[k] for k in options.only}
    with TemporaryDirectory() as folder:
        copy = Path(folder, "copy")
        if not options.list:
            files = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
            for name in files.splitlines():
                (copy / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(ROOT / name, copy / name)
        if not (options.list or options.only) and (test := failing(copy, options.workers, STAGES[options.stages[-1]])):
            sys.exit(f"without a mistake in it, the copy fails: {test}")
        print("| # | mistake | where | was | is | found by |\n|---|---|---|---|---|---|", flush=True)
        left = 0
        for k, each in chosen.items():
            stage, test = ("", "") if options.list else verdict(each, copy, options.workers, options.stages)
            left += not stage
            line = (ROOT / each.file).read_text("utf-8").count("\n", 0, each.start) + 1
            where = f"{each.file.removeprefix('graspfx/')}:{line}"
            print(f"| {k} | {each.kind} | {where} | `{each.old}` | `{each.new}` | {stage}: {test} |", flush=True)
    print(f"{len(chosen) - left} of {len(chosen)} found")


if __name__ == "__main__":
    main()
