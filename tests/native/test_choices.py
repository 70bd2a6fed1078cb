"""What is requested of many environments means what it means one by one, also where no alternative has it."""

from collections.abc import Collection
from typing import Any

import numpy as np
import pytest

from dl2c.env.opening import batch_options, open_library, source_of
from dl2c.native.binding import Library
from dl2c.source import Source

ODD = (
    -(2**31),
    -129,
    -128,
    -1,
    0,
    1,
    2,
    126,
    127,
    128,
    129,
    255,
    256,
    257,
    2**15,
    2**16,
    2**16 + 1,
    2**31 - 1,
)
"""Numbers that another type would take for one of an alternative."""


def of_many_alternatives(count: int, possible: Collection[int]) -> Source:
    """A choice between `count`, of which the other ones are never open."""
    tests = ("true" if k in possible else "1 = 0" for k in range(count))
    choices = " ++ ".join(f"{{ ?{test}; x := {k}; }}" for k, test in enumerate(tests))
    names = "ProgramVariables\n  /* @var: bound=[0:200] */ Real x;\nEnd.\n"
    return Source("many.kyx", f"{names}Problem\n  x = 0 -> [{{ {choices} }}*]true\nEnd.\n")


MODELS = {
    "waypoint": source_of("example:waypoint"),
    "acc": source_of("example:acc"),
    "many": of_many_alternatives(131, (0, 1, 127, 128, 129)),
    "many_paths": of_many_alternatives(131, range(131)),
    "many_short_paths": of_many_alternatives(40, range(40)),
}


def after_a_step(library: Library, choices: list[int], options: dict[str, Any]) -> list[list[bytes]]:
    """Every buffer by environment, all of which begin alike."""
    n = len(choices)
    batch = library.batch(n, **(batch_options(library.manifest) | options))
    batch.reset(seeds=np.full(n, 7, np.uint64))
    batch.choices[:] = np.array(choices, np.int32)[:, None]
    batch.step()
    return [[array[i].tobytes() for array in batch.arrays()] for i in range(n)]


@pytest.mark.usefixtures("unoptimised")
@pytest.mark.parametrize("on_blocked", ["fallback", "truncate"])
@pytest.mark.parametrize("name", MODELS)
def test_odd_requests(name: str, on_blocked: str) -> None:
    library = open_library(MODELS[name], {})
    choices = [*ODD, *ODD, *ODD, *ODD]
    together = after_a_step(library, choices, {"on_blocked": on_blocked})
    alone = [after_a_step(library, [choice], {"on_blocked": on_blocked})[0] for choice in ODD]
    assert together == alone * 4


@pytest.mark.usefixtures("unoptimised")
def test_alternatives_beyond_a_byte_are_taken() -> None:
    library = open_library(MODELS["many"], {})
    batch = library.batch(len(ODD), **batch_options(library.manifest))
    batch.reset(seeds=np.zeros(len(ODD), np.uint64))
    batch.choices[:] = np.array(ODD, np.int32)[:, None]
    batch.step()
    taken = {k: batch.get_state(i)[0][0] for i, k in enumerate(ODD)}
    assert all(taken[k] == k for k in (0, 1, 127, 128, 129))
    assert all(taken[k] in (0, 1, 127, 128, 129) for k in ODD)
