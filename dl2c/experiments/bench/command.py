"""What `dl2c bench` prints: how fast a model steps in C, in multiples of the same model in Python."""

import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from dl2c.commands.failures import CommandError
from dl2c.env.opening import Model, source_of

if TYPE_CHECKING:
    from dl2c.experiments.bench.measure import Result

BASELINE = "solve_ivp"
"""The row that all others are compared with, as in `bench.rows`, which needs scipy."""

PIPED_WIDTH = 120
"""Columns of output that is not a terminal's."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """A row should have at least this ratio to another, by default the baseline."""

    key: str
    of: str
    least: float

    @property
    def text(self) -> str:
        """As `--require` takes it, without the ratio."""
        return self.key if self.of == BASELINE else f"{self.key}/{self.of}"


@dataclass(frozen=True, slots=True)
class Comparison:
    """One run. `deviation` is how far Python and C differ over some steps, infinite if they disagree;
    `growth` how much faster a batch's environment step is than that of the smallest batch, by size;
    `sizes` how much longer one takes in larger models, by number of variables, where that was asked for.
    `counted` is what rows do, compared with the row `baseline`.
    """

    model: str
    results: tuple["Result", ...]
    growth: Mapping[int, float]
    sizes: Mapping[int, float]
    deviation: float | None
    notes: tuple[str, ...]
    requirements: tuple[Requirement, ...]
    counted: str = "environment step"
    baseline: str = BASELINE

    def met(self, requirement: Requirement) -> bool:
        """Whether a required ratio was reached."""
        return self.reached(requirement) >= requirement.least

    def reached(self, requirement: Requirement) -> float:
        """The ratio that is asked for, as measured: in the median of the rounds."""
        from dl2c.experiments.bench.measure import ratios

        rates = {r.key: r.rates for r in self.results}
        return median(ratios(rates[requirement.key], rates[requirement.of]))


def compare(
    model: Model,
    options: Mapping[str, Any],
    seconds: float,
    required: Iterable[str],
    note: Callable[[str], None],
    with_sizes: bool = False,
) -> Comparison:
    """Build and measure a model. Raises `CommandError` where that cannot be done as asked.

    `with_sizes` builds and measures models of growing size too.
    """
    if find_spec("scipy") is None:
        raise CommandError("the comparison is with scipy; install it with `pip install scipy`")
    from dl2c.experiments.bench.measure import growth, measure
    from dl2c.experiments.bench.rows import deviation, rows, subject
    from dl2c.experiments.bench.sizes import size_growth

    what = subject(source_of(model), options)
    found, notes = rows(what)
    requirements = _requirements(required, [row.key for row in found], BASELINE)
    furthest = deviation(what)
    results = measure(found, seconds, note=note)
    sizes = size_growth(seconds / 10, note) if with_sizes else {}
    name = what.library.manifest.name
    return Comparison(name, tuple(results), growth(results), sizes, furthest, tuple(notes), requirements)


def compare_boxes(
    model: str, policy: Path | None, options: Mapping[str, Any], seconds: float, required: Iterable[str]
) -> Comparison:
    """Measure how fast boxes of states are judged for the proof of a policy. Raises `CommandError` where that
    cannot be done as asked, and what verifying raises.
    """
    from dl2c.experiments.bench.boxes import BASELINE as NUMPY
    from dl2c.experiments.bench.boxes import measured

    name, results = measured(model, policy, options, seconds)
    requirements = _requirements(required, [r.key for r in results], NUMPY)
    return Comparison(name, tuple(results), {}, {}, None, (), requirements, "box of states", NUMPY)


def _requirements(texts: Iterable[str], keys: Sequence[str], baseline: str) -> tuple[Requirement, ...]:
    found = tuple(_requirement(text, baseline) for text in texts)
    for requirement in found:
        if unknown := [key for key in (requirement.key, requirement.of) if key not in keys]:
            raise CommandError(f"no row `{unknown[0]}` here; there is {', '.join(keys)}")
    return found


def _requirement(text: str, baseline: str) -> Requirement:
    keys, _, least = text.partition("=")
    key, _, of = keys.partition("/")
    try:
        return Requirement(key, of or baseline, float(least))
    except ValueError:
        raise CommandError(
            f"--require takes ROW=RATIO or ROW/ROW=RATIO, such as gym=100, not {text!r}"
        ) from None


def show_comparison(comparison: Comparison) -> None:
    """Print the table, then how the batch grows, then whether each requirement is met."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=PIPED_WIDTH)
    title = f"{comparison.model}: CPU time of a {comparison.counted}"
    table = Table(title=title, title_justify="left", box=None)
    table.add_column("row")
    table.add_column("what")
    for column in ("ns each", f"times {comparison.baseline}", "lowest", "highest"):
        table.add_column(column, justify="right")
    for r in comparison.results:
        ratios = (f"{value:,.4g}" if value < 1000 else f"{value:,.0f}" for value in (r.ratio, r.low, r.high))
        table.add_row(r.key, r.title, f"{1e9 / r.rate:,.0f}", *ratios)
    console.print(table)
    if comparison.growth:
        sizes = ", ".join(f"n = {n}: {times:.2f}" for n, times in comparison.growth.items())
        print(f"\nsteps per second of a batch in C, times those of n = 1: {sizes}")
    if comparison.sizes:
        times = ", ".join(f"{n} variables: {longer:.2f}" for n, longer in comparison.sizes.items())
        print(f"time of a step in models of growing size, times that of the smallest: {times}")
    if comparison.deviation is not None:
        print(_agreement(comparison.deviation))
    for text in comparison.notes:
        print(f"note: {text}")
    for requirement in comparison.requirements:
        verdict = "pass" if comparison.met(requirement) else "FAIL"
        reached = f"{comparison.reached(requirement):,.4g} times {requirement.of}"
        print(f"{verdict}  {requirement.text}: {reached}, at least {requirement.least:,g} wanted")


def _agreement(deviation: float) -> str:
    if math.isinf(deviation):
        return "solve_ivp and C disagree on where an episode ends: the comparison is not of the same motion"
    return f"solve_ivp and C agree to {deviation:.1g} over 200 steps from the same initial states"


def draw_comparison(comparison: Comparison, path: Path) -> None:
    """Every row's ratio to the baseline as a bar, with its range, and how speed and time grow."""
    from dl2c.picture.figure import save
    from dl2c.training.plots import speeds

    rows = [(r.title, r.ratio, r.low, r.high) for r in comparison.results]
    title = f"{comparison.model}: speed of a {comparison.counted}, times {comparison.baseline}"
    growths: list[tuple[str, str, Mapping[int, float]]] = []
    if comparison.growth:
        growths.append(("environments of a batch", "speed, times that of one", comparison.growth))
    if comparison.sizes:
        growths.append(("variables of a model", "time, times the smallest's", comparison.sizes))
    save(speeds(rows, title, growths), path)
    print(f"wrote {path}", file=sys.stderr)


def comparison_data(comparison: Comparison) -> dict[str, Any]:
    """The same for scripts; `deviation` is null where the two disagree on the end of an episode."""
    return {
        "model": comparison.model,
        "rows": [
            {
                "key": r.key,
                "title": r.title,
                "n": r.n,
                "steps_per_second": r.rate,
                "ratio": r.ratio,
                "ratio_range": [r.low, r.high],
            }
            for r in comparison.results
        ],
        "growth": {str(n): times for n, times in comparison.growth.items()},
        "sizes": {str(n): longer for n, longer in comparison.sizes.items()},
        "deviation": None if comparison.deviation in (None, math.inf) else comparison.deviation,
        "notes": list(comparison.notes),
        "requirements": [
            {
                "key": r.key,
                "of": r.of,
                "least": r.least,
                "ratio": comparison.reached(r),
                "met": comparison.met(r),
            }
            for r in comparison.requirements
        ],
    }
