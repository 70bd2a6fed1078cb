"""The results as tables: Table 1 of the paper beside ours, details by seed, and what had to be shown."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from dl2c.experiments.paper.criteria import Criterion
from dl2c.experiments.paper.experiments import Results
from dl2c.experiments.paper.safe_lock import Locked
from dl2c.experiments.paper.statistics import mean_over_seeds, rate_over_seeds
from dl2c.experiments.paper.waypoint import Driven
from dl2c.training.run import Estimate

NOTES = """\
Means over the seeds and 95 % intervals: the wider of Wilson's (or the normal) interval of all episodes and
Student's of the seeds. Safe: episodes in which no @safety predicate failed. In Test 3 a request whose guard
fails ends the episode without success. Optimum: the travel time of the only drive that the guards admit when
every decision holds for `ep`; fastest: the infimum over all runs of the model, with decisions of any length.

How to read Test 3: with masks the first enabled alternative, uniformly random ones and learned ones are the
same policy, since in nearly every state the guards enable exactly one alternative. The proof's author solved
the task, and learning adds nothing to it. What learning can do is seen without masks, where it finds the
guards from penalties alone; what it loses against the masked rows is what it costs not to use them.
"""


def markdown(results: Results, checks: Sequence[Criterion]) -> str:
    """The whole table.md."""
    met = [[c.name, c.wanted, c.found, "yes" if c.met else "**no**"] for c in checks]
    parts = [
        "# The paper's evaluation, reproduced\n",
        _table(("test", "of the paper: strategy", "safety", "success"), PAPER),
        _table(
            ("test", "here: strategy", "safe", "success", "time / optimum", "time / fastest"), _ours(results)
        ),
        NOTES,
        "## By seed\n",
        _table(("test", "policy", "seed", "safe", "success", "blocked", "time / optimum"), _by_seed(results)),
        "## What had to be shown\n",
        _table(("criterion", "wanted", "found", "met"), met),
        f"{results.seconds:.0f} s in all.\n",
    ]
    return "\n".join(parts)


PAPER = (
    ("1", "static: stays still", "absolute", "100 % (trivially)"),
    ("2", "aggressive: forced to accelerate", "failed", "0 % (violation)"),
    ("3", "optimal: trapezoidal", "verified", "68 %, 75 % at best"),
)
"""Table 1 of the paper, and what its text adds."""


def _ours(results: Results) -> list[Sequence[str]]:
    rows: list[Sequence[str]] = [
        _locked("1", "stands still", results.line),
        _locked("1, Dict to Box", "as learned in 10 000 steps", results.plane),
        _ended(results),
    ]
    for name, runs in _policies(results):
        rate, safe = rate_over_seeds([r.success for r in runs]), rate_over_seeds([~r.violated for r in runs])
        ratios = [mean_over_seeds([of(r) for r in runs]) for of in (Driven.of_optimum, Driven.of_infimum)]
        rows.append(("3", name, _percent(safe), _percent(rate), *(_number(r) for r in ratios)))
    return rows


def _policies(results: Results) -> list[tuple[str, Sequence[Driven]]]:
    rows: list[tuple[str, Sequence[Driven]]] = [(_named(run), [run]) for run in results.guards]
    return rows + [(_named(runs[0]), runs) for runs in (results.masked, results.unmasked)]


def _named(run: Driven) -> str:
    return f"{run.name}, {'masked' if run.masked else 'no masks'}"


def _locked(test: str, strategy: str, runs: Sequence[Locked]) -> Sequence[str]:
    safe = rate_over_seeds([~run.violated for run in runs])
    still = float(np.mean([run.standing.mean() for run in runs]))
    return test, f"{strategy}; at rest {still:.1%} of the time", _percent(safe), "no goal", "", ""


def _ended(results: Results) -> Sequence[str]:
    safe = rate_over_seeds([~run.violated for run in results.forced])
    steps = float(np.mean([run.steps.mean() for run in results.forced]))
    worst = max(run.error for run in results.forced)
    strategy = f"accelerates; ends after {steps:.0f} steps on average, within {worst:.0e} of the closed form"
    return "2", strategy, _percent(safe), "no goal", "", ""


def _by_seed(results: Results) -> list[Sequence[str]]:
    rows: list[Sequence[str]] = []
    for test, runs in (("1", results.line), ("1, Dict to Box", results.plane)):
        rows += [(test, "PPO", str(r.seed), f"{1 - r.violated.mean():.1%}", "", "", "") for r in runs]
    rows += [("2", "none", str(r.seed), f"{1 - r.violated.mean():.1%}", "", "", "") for r in results.forced]
    for run in (*results.masked, *results.unmasked):
        rates = (1 - run.violated.mean(), run.success.mean(), run.blocked.mean())
        ratio = f"{run.of_optimum().mean():.4f}" if run.success.any() else ""
        rows.append(("3", _named(run), str(run.seed), *(f"{r:.1%}" for r in rates), ratio))
    return rows


def _percent(e: Estimate) -> str:
    return f"{e.value:.1%} [{e.low:.1%}, {e.high:.1%}]"


def _number(e: Estimate) -> str:
    return "" if math.isnan(e.value) else f"{e.value:.4f} [{e.low:.4f}, {e.high:.4f}]"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def data(results: Results, checks: Sequence[Criterion]) -> dict[str, Any]:
    """The same for programs: every estimate, and every seed."""
    return {
        "test_1": {"line": _locked_data(results.line), "dict_to_box": _locked_data(results.plane)},
        "test_2": [
            {"seed": r.seed, "episodes": len(r.ended), "error": r.error, "steps": float(r.steps.mean())}
            for r in results.forced
        ],
        "test_3": [_driven_data(name, runs) for name, runs in _policies(results)],
        "criteria": [asdict(c) for c in checks],
        "seconds": results.seconds,
    }


def _locked_data(runs: Sequence[Locked]) -> dict[str, Any]:
    return {
        "safe": asdict(rate_over_seeds([~run.violated for run in runs])),
        "at_rest": asdict(mean_over_seeds([run.standing for run in runs])),
        "seeds": [
            {
                "seed": run.seed,
                "safe": float(1 - run.violated.mean()),
                "fastest_at_end": float(run.speed.max()),
                "at_rest": float(run.standing.mean()),
                "reward_per_step": float(run.per_step.mean()),
            }
            for run in runs
        ],
    }


def _driven_data(name: str, runs: Sequence[Driven]) -> dict[str, Any]:
    return {
        "policy": name,
        "masked": runs[0].masked,
        "episodes": sum(len(run.success) for run in runs),
        "safe": asdict(rate_over_seeds([~run.violated for run in runs])),
        "success": asdict(rate_over_seeds([run.success for run in runs])),
        "blocked": asdict(rate_over_seeds([run.blocked for run in runs])),
        "time_of_optimum": asdict(mean_over_seeds([run.of_optimum() for run in runs])),
        "time_of_fastest": asdict(mean_over_seeds([run.of_infimum() for run in runs])),
        "seeds": [{"seed": run.seed, "success": float(run.success.mean())} for run in runs],
    }
