"""What `dl2c sample` and `dl2c check --prove-coverage` do."""

import csv
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dl2c.commands.failures import CommandError, to_json
from dl2c.env.opening import build, compilation_of, source_of
from dl2c.native.manifest import Manifest
from dl2c.outputs import output_file

if TYPE_CHECKING:
    from dl2c.ir.model import Formula
    from dl2c.sampling.tables import SamplingPlan
    from dl2c.smt.coverage import Region

LARGEST_BATCH = 4096
CELL = 1.6
"""Width and height of a cell of a corner plot in inches."""


@dataclass(frozen=True, slots=True)
class Sample:
    """Initial states: `rows` (n, names) of variables and constants; resets per second of one core."""

    manifest: Manifest
    names: tuple[str, ...]
    rows: NDArray[np.float64]
    rate: float


def draw(model: str, options: Mapping[str, Any], count: int, seed: int) -> Sample:
    """Draw `count` initial states as resets with the seeds from `seed` on give them.

    Raises `CommandError` where none can be drawn.
    """
    library = build(source_of(model), options).library
    manifest = library.manifest
    if manifest.certificate == "none":
        raise CommandError(f"initial states of {manifest.name} cannot be sampled: `dl2c check` says why")
    names = tuple(q.name for q in (*manifest.variables, *manifest.constants))
    size = min(count, LARGEST_BATCH)
    batch = library.batch(size)
    rows = np.empty((count, len(names)))
    seconds = 0.0
    for first in range(0, count, size):
        begun = time.perf_counter()
        batch.reset(seeds=np.arange(seed + first, seed + first + size, dtype=np.uint64))
        seconds += time.perf_counter() - begun
        rows[first : first + size] = batch.states(range(min(size, count - first)))
    return Sample(manifest, names, rows, -(-count // size) * size / seconds)


def summary(sample: Sample) -> dict[str, Any]:
    """What is printed, as data for JSON."""
    sampler = sample.manifest.sampler
    columns = zip(sample.names, sample.rows.T, strict=True)
    return {
        "model": sample.manifest.name,
        "states": len(sample.rows),
        "certificate": sample.manifest.certificate,
        "error_bound": sampler["error_bound"],
        "acceptance": sampler["acceptance"],
        "blocks": sampler["blocks"],
        "boxes": sampler["boxes"],
        "charts": sampler["charts"],
        "resets_per_second": sample.rate,
        "names": {
            n: {"min": float(c.min()), "mean": float(c.mean()), "max": float(c.max())} for n, c in columns
        },
    }


def present(sample: Sample, table: Path | None, picture: Path | None, json: bool) -> None:
    """Write the files that were asked for and print a summary."""
    if table is not None:
        write_csv(sample, table)
    if picture is not None:
        corner_plot(sample, picture)
    data = summary(sample)
    if json:
        print(to_json(data))
    else:
        show(data)


def show(data: Mapping[str, Any]) -> None:
    """Print a summary."""
    proved = {
        "exact": "the doubles satisfy the precondition",
        "witness": f"a real solution lies within {data['error_bound']:.1e} of the doubles",
    }
    print(f"{data['states']} initial states of {data['model']}: {proved[data['certificate']]}")
    print(
        f"{data['acceptance']:.1%} of draws from {data['boxes']} boxes are kept, "
        f"{data['resets_per_second']:,.0f} resets/s"
    )
    width = max(map(len, data["names"]), default=0)
    for name, found in data["names"].items():
        print(f"  {name:<{width}}  {found['min']:>12.6g} .. {found['max']:<12.6g} mean {found['mean']:.6g}")


def write_csv(sample: Sample, path: Path) -> None:
    """One state a line, exact."""
    with output_file(path) as fresh, fresh.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(sample.names)
        writer.writerows(sample.rows.tolist())


def corner_plot(sample: Sample, path: Path) -> None:
    """Histograms of each name that varies, and of each pair, as a picture."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    from dl2c.picture.figure import save

    varying = [k for k in range(len(sample.names)) if np.ptp(sample.rows[:, k]) > 0]
    if not varying:
        raise CommandError("nothing to plot: no name varies")
    n = len(varying)
    figure: Any
    axes: Any
    figure, axes = plt.subplots(n, n, figsize=(CELL * n + 1, CELL * n + 1), squeeze=False)
    for i, below in enumerate(varying):
        for k, across in enumerate(varying):
            _cell(axes[i][k], sample, i, k, (below, across), n)
    figure.tight_layout(pad=0.3)
    plt.close(figure)
    save(figure, path)


def _cell(ax: Any, sample: Sample, i: int, k: int, names: tuple[int, int], n: int) -> None:
    below, across = names
    if k > i:
        ax.remove()
        return
    if k == i:
        ax.hist(sample.rows[:, across], bins=40, color="0.4")
    else:
        ax.hist2d(sample.rows[:, across], sample.rows[:, below], bins=40, cmap="Greys")
    ax.tick_params(labelsize=0.7 * _points(n), labelleft=k == 0 and i > 0, labelbottom=i == n - 1)
    ax.tick_params("x", labelrotation=90)
    ax.locator_params(nbins=2)
    for direction, name, outer in (("x", across, i == n - 1), ("y", below, k == 0)):
        if outer:
            text = sample.names[name]
            size = min(_points(n), 0.9 * CELL * 72 / (0.6 * len(text)))  # a letter is 0.6 as wide as high
            getattr(ax, f"set_{direction}label")(text, fontsize=size)


def _points(n: int) -> float:
    """How large letters are, so that they can be read where all of the picture is on a screen."""
    return 8.0 + n


def report_coverage(model: str, options: Mapping[str, Any], quietly: bool) -> bool:
    """Print what Z3 says about the boxes, to stderr if `quietly`; whether it proves them."""
    verdict, proved = coverage_of(model, options)
    print(verdict, file=sys.stderr if quietly else sys.stdout)
    return proved


def coverage_of(model: str, options: Mapping[str, Any]) -> tuple[str, bool]:
    """What Z3 says about the boxes that initial states are drawn from, and whether it proves them."""
    from dl2c.sampling.plan import NoSampler
    from dl2c.smt.coverage import Covered, Outside, coverage

    found = compilation_of(model, options)
    drawn, plan = found.lowered.drawn, found.sampling
    if isinstance(plan, NoSampler):
        return f"initial states are not sampled: {plan.diagnostic.label}", False
    seconds = 0.0
    for around, boxes, region in regions(plan):
        match coverage(replace(drawn, precondition=plan.precondition), around, boxes, region):
            case Covered(taken):
                seconds += taken
            case Outside(state):
                listed = ", ".join(f"{name} = {value}" for name, value in state.items())
                return f"an initial state lies outside of the boxes: {listed}", False
            case unknown:
                return f"not proved: {unknown.reason}", False
    of = f" of {len(plan.charts)} charts" if len(plan.charts) > len(plan.blocks) else ""
    proof = f"Z3 proves that no initial state lies outside of the {len(plan.boxes)} boxes{of}"
    return f"{proof} ({seconds:.2f} s)", True


def regions(plan: "SamplingPlan") -> Iterator[tuple["Region", list["Region"], "Formula"]]:
    """Of each chart: what limits its names, its boxes, and which states it holds."""
    from dl2c.smt.coverage import EVERYWHERE

    for block in plan.blocks:
        for k, chart in enumerate(block.charts):
            own = [box for box in block.boxes if box.chart == k]
            limits = [zip(box.low, box.high, strict=True) for box in own]
            parts = {name: (0.0, 1.0) for name in chart.free if name not in plan.names}
            whole = len(block.charts) == 1 and not chart.between
            boxes: list[Region] = [dict(zip(chart.free, box, strict=True)) for box in limits]
            yield {**plan.around, **parts}, boxes, EVERYWHERE if whole else chart.region
