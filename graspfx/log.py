"""Messages about what is done, to Python's `logging` under the name `graspfx`; nobody is told unless he asks.

A handler can only be there once `logging` is loaded, which takes as long as a short run: until then nothing is logged.
"""

from __future__ import annotations

import sys
import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from logging import Logger

NAME = "graspfx"
OWN = ("graspfx", "contextlib", "functools")  # packages whose lines are nobody's call of ours
INFO, DEBUG = 20, 10  # as `logging` numbers them


def info(text: str, *values: object) -> None:
    """Log what a user who asks for more wants to know; `values` are put into the text by %."""
    _log(INFO, text, values)


def debug(text: str, *values: object) -> None:
    """Log a detail."""
    _log(DEBUG, text, values)


def warn(text: str, category: type[Warning] = UserWarning) -> None:
    """Warn at the line that called GraspFX: the nearest one outside of it."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] in OWN:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)


def is_heard(level: int = INFO) -> bool:
    """Tell whether anybody listens, so that a message may cost something."""
    logger = _logger()
    return logger is not None and logger.isEnabledFor(level)


def _log(level: int, text: str, values: tuple[object, ...]) -> None:
    logger = _logger()
    if logger is not None:
        logger.log(level, text, *values)


def _logger() -> Logger | None:
    logging = sys.modules.get("logging")
    if logging is None or not hasattr(logging, "NullHandler"):  # or in the middle of being loaded
        return None
    logger: Logger = logging.getLogger(NAME)
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    return logger
