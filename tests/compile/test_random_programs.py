"""Random programs give the bits that Python gives, linked and compiled."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from graspfx.compile.machine import compiled
from tests.support.random_programs import ENTRIES, random_module

FUNCTIONS = 8  # of a module, which is compiled at once


def module_of(folder: Path, seed: int) -> ModuleType:
    """A random module in a file, since the source is read."""
    file = folder / f"random_{seed}.py"
    file.write_text(random_module(seed, FUNCTIONS))
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def compared(folder: Path, seed: int) -> int:
    """Run a module interpreted and compiled on several inputs; count how many Python could compute."""
    pytest.importorskip("llvmlite")
    module = module_of(folder, seed)
    machine, rng, count = compiled(module.entry), np.random.default_rng(seed), 0
    for _ in range(5):
        A, B = rng.normal(size=ENTRIES), rng.normal(size=4 * FUNCTIONS) * 3
        ours, theirs = (A.copy(), np.zeros(2 * FUNCTIONS)), (A.copy(), np.zeros(2 * FUNCTIONS))
        try:
            module.entry(memoryview(theirs[0]), memoryview(B), memoryview(theirs[1]))
        except (ArithmeticError, ValueError):
            continue  # what Python refuses: docs/development/records-and-kernels.md says what a compiled kernel does
        machine(ours[0], B, ours[1])
        assert all(one.tobytes() == other.tobytes() for one, other in zip(ours, theirs, strict=True)), seed
        count += 1
    return count


def test_random_programs_give_the_bits_of_python(tmp_path: Path) -> None:
    """Five modules of eight functions; `make test` has them all."""
    counts = [compared(tmp_path, seed) for seed in range(5)]
    assert sum(counts) >= 15, counts


@pytest.mark.stress
@pytest.mark.parametrize("first", range(0, 160, 20))
def test_many_random_programs(tmp_path: Path, first: int) -> None:
    counts = [compared(tmp_path, 1000 + seed) for seed in range(first, first + 20)]
    assert sum(counts) >= 60, counts
