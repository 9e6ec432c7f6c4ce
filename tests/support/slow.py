"""Cases that `make fast` and `make test` leave out, by the time that each took when all were measured.

`make durations` measures and writes the list: the mean seconds of a function's cases, for each function whose cases
take longer together than `BUDGET`. Of these the first ones that fit into the budget are run, the others are marked
`slow`. `make test` runs of each function a case, and more while they fit into `MORE`; the others are marked `rest`.
These are chosen by a sum of their names, so that the cases of one scene are not the ones that every function leaves
out. Seconds are those of the processor, which are the same on a busy machine.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Generator, Iterable
from pathlib import Path
from zlib import crc32

import pytest

ROOT = Path(__file__).parents[2]
LIST = ROOT / "tests" / "slow.txt"
BUDGET = 0.05  # of a function's cases together, in `make fast` [s]
MORE = 0.3  # in `make test` [s]
USED = "processor_seconds"  # of a report

seconds: defaultdict[str, defaultdict[str, float]] = defaultdict(lambda: defaultdict(float))  # by function and case
began = 0.0  # the case at hand [s]


def function(case: str) -> str:
    """Return the function of a case, or the document."""
    return case.partition("[")[0]


def means() -> dict[str, float]:
    """Return the mean time of a case by function [s], as it is listed."""
    rows = (row.split(maxsplit=1) for row in LIST.read_text(encoding="utf-8").splitlines())
    return {name: float(mean) for mean, name in rows}


def mark(cases: Iterable[pytest.Item]) -> None:
    """Mark what does not fit into its function's budget."""
    costs = means()
    groups: defaultdict[str, list[pytest.Item]] = defaultdict(list)
    for case in cases:
        groups[function(case.nodeid)].append(case)
    for name in costs.keys() & groups.keys():
        group, cost = groups[name], max(costs[name], 1e-3)
        for case in group[int(BUDGET / cost) :]:
            case.add_marker(pytest.mark.slow)
        group.sort(key=lambda case: crc32(case.nodeid.encode()))
        for case in group[max(1, int(MORE / cost)) :]:
            case.add_marker(pytest.mark.rest)


def clock() -> float:
    """Return the processor time of this process and those that it started and that ended [s]."""
    return sum(os.times()[:4])


def pytest_collection_finish() -> None:
    """Start the clock of the first case."""
    global began
    began = clock()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Write the time since the last report into a report: a process that shares the tests sends it on."""
    global began
    report = yield
    now = clock()
    setattr(report, USED, now - began)
    began = now
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add up set-up, call and tear-down of a case."""
    seconds[function(report.nodeid)][report.nodeid] += getattr(report, USED)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the list, unless this process is one of several that share the tests."""
    if hasattr(session.config, "workerinput"):
        return
    rows = [(sum(cases.values()) / len(cases), name) for name, cases in seconds.items() if sum(cases.values()) > BUDGET]
    text = "".join(f"{mean:.3f} {name}\n" for mean, name in sorted(rows, key=lambda row: row[1]))
    LIST.write_text(text, encoding="utf-8")
