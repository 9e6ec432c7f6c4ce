"""How much a command says beside its answer: -v, -vv and -q, which every command takes."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from graspfx.log import DEBUG, INFO, NAME

_quiet: ContextVar[bool] = ContextVar("quiet", default=False)


def add_loudness(parser: ArgumentParser) -> None:
    """Add -v and -q."""
    group = parser.add_mutually_exclusive_group()
    meaning = "say on standard error what is done: the engine, programs compiled or from the cache, files; -vv: details"
    group.add_argument("-v", "--verbose", action="count", default=0, help=meaning)
    meaning = "no notes, warnings or names of files, and of a run no summary: errors, and answers that are asked for"
    group.add_argument("-q", "--quiet", action="store_true", help=meaning)


def is_quiet() -> bool:
    """Tell whether the command that runs is to be quiet."""
    return _quiet.get()


@contextmanager
def loudness(options: Namespace) -> Iterator[None]:
    """Say as much as was asked for, within."""
    token = _quiet.set(bool(getattr(options, "quiet", False)))
    try:
        with _listening(int(getattr(options, "verbose", 0))):
            yield
    finally:
        _quiet.reset(token)


@contextmanager
def _listening(verbose: int) -> Iterator[None]:
    if not verbose:
        yield
        return
    import logging

    logger = logging.getLogger(NAME)
    handler, level = logging.StreamHandler(sys.stderr), logger.level
    handler.setFormatter(logging.Formatter("%(message)s" if verbose == 1 else "%(relativeCreated)6d ms  %(message)s"))
    logger.addHandler(handler)
    logger.setLevel(INFO if verbose == 1 else DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
