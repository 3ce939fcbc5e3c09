"""Silences the log of Dask; users get clrender's own messages instead."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

__all__ = ["quiet_logs"]

_LOGGERS: Final = ("distributed", "tornado", "asyncio", "bokeh")
_SILENT: Final = logging.CRITICAL + 1


@contextmanager
def quiet_logs() -> Iterator[None]:
    """Disable the logs of Dask and of the libraries that it uses, while the block runs."""
    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] in _LOGGERS]
    loggers = [logging.getLogger(name) for name in {*names, *_LOGGERS}]
    before = [(logger, logger.level) for logger in loggers]
    for logger in loggers:
        logger.setLevel(_SILENT)
    try:
        yield
    finally:
        for logger, level in before:
            logger.setLevel(level)
