"""What the results have to show, and whether they do."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dl2c.experiments.paper.experiments import Results
from dl2c.experiments.paper.statistics import mean_over_seeds
from dl2c.experiments.paper.waypoint import Driven

CLOSED_FORM = 1e-9
"""How far an end may be from its prediction, relative: rounding."""


@dataclass(frozen=True, slots=True)
class Criterion:
    """Something that has to hold; `wanted` and `found` in words."""

    name: str
    wanted: str
    found: str
    met: bool


def criteria(results: Results, proper: bool) -> list[Criterion]:
    """Every criterion; those about what was learned only after `proper` training."""
    found = [*_test_1_safety(results), *_test_2(results), _no_violations(results), _guards(results)]
    if proper:
        found += [_settled(results), *_test_3(results)]
    return found


def _test_1_safety(results: Results) -> list[Criterion]:
    return [
        _violations(f"Test 1 {where} is safe", np.concatenate([run.violated for run in runs]))
        for where, runs in (("on a line", results.line), ("with Dict to Box", results.plane))
    ]


def _settled(results: Results) -> Criterion:
    still = float(np.mean([run.standing.mean() for run in results.line]))
    wanted = "v = 0 in at least 99 % of the second half of the steps"
    return Criterion("Test 1 settles", wanted, f"{still:.2%}", still >= 0.99)


def _test_2(results: Results) -> list[Criterion]:
    return [
        Criterion(
            f"Test 2 ends as predicted, seed {run.seed}",
            f"within {CLOSED_FORM:g} of the closed form, all by a violation",
            f"within {run.error:.1e}, {run.violated.mean():.0%}",
            run.error <= CLOSED_FORM and bool(run.violated.all()),
        )
        for run in results.forced
    ]


def _no_violations(results: Results) -> Criterion:
    runs = (*results.masked, *results.unmasked, *results.guards)
    return _violations("Test 3 is safe", np.concatenate([run.violated for run in runs]))


def _guards(results: Results) -> Criterion:
    """The derivation of the optimum says that masks leave one drive only; so do the episodes."""
    masked = [run for run in results.guards if run.masked]
    worst = max(float(abs(run.of_optimum() - 1).max()) for run in masked)
    return Criterion(
        "Test 3: the guards admit one drive", "the closed form's time", f"within {worst:.1e}", worst <= 1e-6
    )


def _test_3(results: Results) -> list[Criterion]:
    return [
        _success("Test 3 masked", results.masked, 0.99),
        _success("Test 3 without masks", results.unmasked, 0.95),
        _time("Test 3 masked", results.masked),
        _time("Test 3 without masks", results.unmasked),
    ]


def _violations(name: str, violated: "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]") -> Criterion:
    count = int(violated.sum())
    return Criterion(name, "no violation", f"{count} in {len(violated)} episodes", count == 0)


def _success(name: str, runs: Sequence[Driven], least: float) -> Criterion:
    rate = float(np.concatenate([run.success for run in runs]).mean())
    return Criterion(f"{name} succeeds", f"at least {least:.0%}", f"{rate:.1%}", rate >= least)


def _time(name: str, runs: Sequence[Driven]) -> Criterion:
    ratio = mean_over_seeds([run.of_optimum() for run in runs]).value
    return Criterion(
        f"{name} is fast", "travel time within 5 % of the optimum", f"{ratio - 1:+.2%}", ratio <= 1.05
    )
