"""The Dockerfile and the conda recipe name files that are there, and the versions and packages of pyproject.

Neither is built by a test: that takes a Docker engine, or conda's channels.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

import graspfx

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CONDA = {"matplotlib": "matplotlib-base", "tree-sitter": "py-tree-sitter"}  # other names there
INSTRUCTIONS = {"FROM", "WORKDIR", "COPY", "RUN", "USER", "ENTRYPOINT", "CMD"}


def test_the_dockerfile_copies_what_is_there() -> None:
    text = (ROOT / ".ci" / "Dockerfile").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert {line.split()[0] for line in lines} == INSTRUCTIONS
    for line in lines:
        words = line.split()
        if words[0] == "COPY" and not words[1].startswith("--from"):
            assert [name for name in words[1:-1] if not (ROOT / name).exists()] == []
    copied = {name.removeprefix("./") for line in lines if line.startswith("COPY") for name in line.split()[1:]}
    included = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]
    assert {*included["targets"]["wheel"]["only-include"], "pyproject.toml", PROJECT["readme"], "LICENSE"} <= copied


def test_the_recipe_is_of_this_version_and_asks_for_the_same_packages() -> None:
    text = (ROOT / ".ci" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    assert f"\n  version: {graspfx.__version__}\n" in text
    run = text.partition("\n  run:\n")[2].partition("\n\n")[0]
    packages = dict(re.findall(r"- ([\w-]+) >=([\d.]+)", run))
    assert packages.pop("python") == PROJECT["requires-python"].removeprefix(">=")
    expected = {}
    for each in map(Requirement, PROJECT["dependencies"]):
        if each.name != "pybullet":
            expected[CONDA.get(each.name, each.name)] = str(each.specifier).removeprefix(">=")
    assert packages == expected
    assert f"graspfx = {PROJECT['scripts']['graspfx']}" in text
