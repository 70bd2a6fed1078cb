"""That cost grows with a model no faster than asked, and that large models step in lanes to the same bits."""

import random
from typing import Any

import numpy as np
import pytest
from bench import families
from bench.growth import BUILDS, GROWING, Curve, Family, curves, exponent

from dl2c.configuration import resolve_options
from dl2c.env.opening import batch_options, open_library
from dl2c.experiments.bench.rows import ONE_BY_ONE, POLICY
from dl2c.pipeline import Compilation, check_model
from dl2c.source import Source

BATCH = 64 + 4 + 2
"""A full block, a group of the last one, and lanes left over."""

STEPS = 40

RESULTS = ("obs", "rewards", "duration", "time", "executed_choices", "blocked", "mask", "truncated")


def grown(power: float, fixed: float = 0.0) -> Curve:
    """Costs of sizes 1 to 256 on a machine whose speed changes from round to round."""
    rng = random.Random(1)
    speeds = [rng.uniform(0.3, 1.0) for _ in range(7)]
    sizes = [2**k for k in range(9)]
    return {n: [(fixed + n**power) * s * rng.uniform(0.98, 1.02) for s in speeds] for n in sizes}


def test_an_exponent_is_that_of_the_curve() -> None:
    found = exponent(grown(1.5))
    assert found.low < 1.5 < found.high and found.high - found.low < 0.05


def test_what_does_not_grow_hides_little_of_an_exponent() -> None:
    assert exponent(grown(2.0, fixed=50.0)).mean > 1.8


@pytest.mark.parametrize("growing", GROWING, ids=lambda g: g.family.__name__)
def test_members_of_families_have_no_errors_and_no_doubts(growing: Any) -> None:
    for size in growing.sizes[::2]:
        assert check_model(Source("growth.kyx", growing.family(size)), resolve_options({})) == ()


def test_families_grow_in_what_they_are_called_after() -> None:
    def compiled(text: str) -> Compilation:
        return Compilation(Source("growth.kyx", text), resolve_options({}))

    assert len(compiled(families.paths(40)).paths.paths) == 40
    few, many = (compiled(families.variables(n)).lowered.model for n in (4, 32))
    assert len(many.variables) - len(few.variables) == 28


def states(family: Family, size: int, together: bool) -> list[Any]:
    """All results of some steps of a batch, or of its environments one by one."""
    library = open_library(Source("growth.kyx", family(size)), POLICY)
    options = {"autoreset": "same_step", **batch_options(library.manifest)}
    seeds = np.arange(BATCH, dtype=np.uint64)
    batches: list[Any] = [
        library.batch(BATCH if together else 1, **options) for _ in seeds[:: BATCH if together else 1]
    ]
    for i, batch in enumerate(batches):
        batch.reset(seeds=seeds if together else seeds[i : i + 1])
    requests = np.random.default_rng(1)
    found: list[Any] = []
    for _ in range(STEPS):
        chosen = requests.integers(0, batches[0].mask.shape[-1], (BATCH, 1))
        for i, batch in enumerate(batches):
            batch.choices[:] = chosen if together else chosen[i : i + 1]
            batch.step()
        found += [
            np.concatenate([np.array(getattr(b, name)) for b in batches])
            for name in (
                "obs",
                "rewards",
                "duration",
                "time",
                "executed_choices",
                "blocked",
                "mask",
                "truncated",
            )
        ]
    return found


@pytest.mark.parametrize("family, size", [(families.paths, 20), (families.variables, 16)])
def test_many_lanes_and_one_give_the_same_bits(
    family: Family, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    lanes = states(family, size, together=True)
    monkeypatch.setenv("CFLAGS", ONE_BY_ONE)
    alone = states(family, size, together=False)
    assert len(lanes) == len(alone)
    assert all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(lanes, alone, strict=True))
    blocked = lanes[RESULTS.index("blocked") :: len(RESULTS)]
    assert not any(a.all() for a in blocked) and not np.array_equal(lanes[0], lanes[-len(RESULTS)])


@pytest.mark.slow
@pytest.mark.parametrize(
    "family, sizes",
    [(families.variables, (8, 16, 32)), (families.paths, (16, 32, 64)), (families.degree, (2, 4, 8))],
)
def test_costs_grow_as_asked(family: Family, sizes: tuple[int, ...]) -> None:
    most = next(growing.most for growing in GROWING if growing.family is family)
    for cost, curve in curves(family, sizes, steps=7, builds=BUILDS).items():
        found = exponent(curve)
        assert found.low <= most[cost], (cost, found, curve)
