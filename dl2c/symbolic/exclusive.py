"""CasADi for one thread at a time.

Other threads go on while CasADi computes, and all its expressions share one table of constants, which nothing
guards. Threads that make or drop expressions at once break the memory of the process, even where each has
expressions of its own.
"""

import os
from collections.abc import Callable
from functools import wraps
from threading import RLock
from traceback import clear_frames
from typing import ParamSpec, TypeVar

CASADI = RLock()
"""Whoever makes, uses or drops an expression has it; the collector of garbage may drop some meanwhile."""

os.register_at_fork(before=CASADI.acquire, after_in_parent=CASADI.release, after_in_child=CASADI.release)

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def exclusive(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """A function whose expressions no other thread's work meets, and which keeps none when it fails."""

    @wraps(function)
    def alone(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        with CASADI:
            try:
                return function(*args, **kwargs)
            except BaseException as failure:
                clear_frames(failure.__traceback__)
                raise

    return alone
