"""Log messages, sent to Python's logger `graspfx`, which shows no messages by default.

This module does not import `logging`, because the import is slow. Nothing is logged before another module imports
`logging`; until then, no handler exists that could show a message.
"""

from __future__ import annotations

import sys
import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from logging import Logger

NAME = "graspfx"
OWN = ("graspfx", "contextlib", "functools")  # packages skipped in search of the caller's line
INFO, DEBUG = 20, 10  # levels of `logging`


def info(text: str, *values: object) -> None:
    """Log a message for users, which the option -v shows; the message is `text % values`."""
    _log(INFO, text, values)


def debug(text: str, *values: object) -> None:
    """Log a detail, which the option -vv shows; the message is `text % values`."""
    _log(DEBUG, text, values)


def warn(text: str, category: type[Warning] = UserWarning) -> None:
    """Issue a warning that shows the line of the user's code from which GraspFX was called."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] in OWN:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)


def is_heard(level: int = INFO) -> bool:
    """Return whether messages of this level are logged; check this before composing an expensive message."""
    logger = _logger()
    return logger is not None and logger.isEnabledFor(level)


def _log(level: int, text: str, values: tuple[object, ...]) -> None:
    logger = _logger()
    if logger is not None:
        logger.log(level, text, *values)


def _logger() -> Logger | None:
    logging = sys.modules.get("logging")
    if logging is None or not hasattr(logging, "NullHandler"):  # the latter while it is being imported
        return None
    logger: Logger = logging.getLogger(NAME)
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    return logger
