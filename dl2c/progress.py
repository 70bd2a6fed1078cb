"""What is being done, and how long it took: for whoever watches, and for the logger `dl2c`.

Stages are logged at level INFO when they end, with their seconds; compiler commands at DEBUG.
Python programs see them with `logging.basicConfig(level="INFO")`, the command line with -v.
"""

import logging
from collections.abc import Callable, Generator
from contextlib import contextmanager
from time import perf_counter
from typing import TypeAlias

from dl2c.work import at_stage

LOG = logging.getLogger("dl2c")

Progress: TypeAlias = Callable[[str], None]
"""Called with what is about to be done."""


def silent(_what: str) -> None:
    """Progress that nobody watches."""


@contextmanager
def stage(name: str, progress: Progress = silent) -> Generator[None]:
    """What is done inside is the stage of this name."""
    at_stage(name)
    progress(name)
    began = perf_counter()
    try:
        yield
    finally:
        LOG.info("%8.3f s  %s", perf_counter() - began, name)
