"""How the cost of a step and of a build grow with the size of a model: `python tests/bench/growth.py`.

Rows of the families in `families.py`: processor time of a step, of one environment and of each of 1024, and
of a build, of Python and of the C compiler apart. For each curve the exponent: the slope of the logarithm of
the cost over that of the size, by least squares, over the larger half of the sizes, where what does not
depend on the size counts less. Each round measures all sizes in turn and gives one slope; the interval holds
95 % of Student's t. Exit 1 where the lower end of an interval is above what is required.
"""

import argparse
import os
import resource
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from bench import families
from bench.intervals import Interval, interval

from dl2c.configuration import resolve_options
from dl2c.emit.names import file_stem
from dl2c.env.opening import batch_options, open_library
from dl2c.experiments.bench.rows import POLICY
from dl2c.native.compile import compile_library
from dl2c.pipeline import Compilation
from dl2c.source import Source

ROUNDS, BUILDS = 7, 3

SLICE = 0.02
"""Seconds of processor time in which a step is repeated."""

MANY = 1024
SEED = 1

Family = Callable[[int], str]


@dataclass(frozen=True, slots=True)
class Growing:
    """A family, the sizes at which it is measured, and by cost the greatest exponent."""

    family: Family
    sizes: tuple[int, ...]
    most: Mapping[str, float]


BUILD = {"python": 2.1, "compiler": 2.1}
GROWING = (
    Growing(families.variables, (2, 4, 8, 16, 32, 64), BUILD | {"step": 1.3, "batch": 1.3}),
    Growing(families.paths, (2, 4, 8, 16, 32, 64, 128, 256), BUILD | {"step": 1.1, "batch": 1.1}),
    Growing(families.degree, (1, 2, 3, 4, 6, 8), BUILD | {"step": 1.1, "batch": 1.1}),
)
COSTS = ("step", "batch", "python", "compiler")

Curve = dict[int, list[float]]
"""By size, what each round measured, in seconds."""


def exponent(curve: Curve) -> Interval:
    """The exponent over the larger half of the sizes, with its interval over the rounds."""
    sizes = sorted(curve)[len(curve) // 2 - 1 :]
    logs = np.log(sizes)
    rounds = np.log([curve[size] for size in sizes]).T
    slopes = [float(np.polyfit(logs, values, 1)[0]) for values in rounds]
    return interval(slopes)


def built(text: str, folder: Path) -> tuple[float, float]:
    """Processor seconds of a build: those of Python with its solvers, and those of the compiler."""
    begun = time.process_time() + _children()
    compilation = Compilation(Source("growth.kyx", text), resolve_options({}))
    files = compilation.emitted(compilation.claim())
    written = time.process_time() + _children()
    compiled = _children()
    compile_library(files, file_stem(compilation.lowered.model.name), folder)
    return written - begun, _children() - compiled


def stepped(text: str, n: int) -> Callable[[], float]:
    """Measures seconds of processor time of a step of each of n environments, whose requests are random."""
    library = open_library(Source("growth.kyx", text), POLICY)
    batch: Any = library.batch(n, autoreset="same_step", **batch_options(library.manifest))
    batch.reset(seeds=np.arange(n, dtype=np.uint64))
    alternatives = batch.mask.shape[-1]
    batch.choices[:] = np.random.default_rng(SEED).integers(0, alternatives, batch.choices.shape)

    def measured() -> float:
        calls = 1
        while True:
            begun = time.process_time()
            for _ in range(calls):
                batch.step()
            if (took := time.process_time() - begun) >= SLICE:
                return took / calls / n
            calls *= 2

    return measured


def curves(
    family: Family, sizes: Sequence[int], steps: int = ROUNDS, builds: int = BUILDS
) -> dict[str, Curve]:
    """What members of a family cost, by cost, in rounds in which sizes take turns; no builds where 0."""
    texts = {size: family(size) for size in sizes}
    found: dict[str, Curve] = {cost: {size: [] for size in sizes} for cost in COSTS}
    with TemporaryDirectory(prefix="dl2c-growth-") as folder:
        for turn in range(-1 if builds else 0, builds):
            for size in sizes if turn >= 0 else sizes[:1]:  # the first build of a process imports modules
                python, compiler = built(texts[size], Path(folder))
                if turn >= 0:
                    found["python"][size].append(python)
                    found["compiler"][size].append(compiler)
    runs = {size: (stepped(text, 1), stepped(text, MANY)) for size, text in texts.items()}
    for _ in range(steps):
        for size, (one, many) in runs.items():
            found["step"][size].append(one())
            found["batch"][size].append(many())
    return {cost: curve for cost, curve in found.items() if curve[sizes[0]]}


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def told(name: str, found: Mapping[str, Curve], most: Mapping[str, float]) -> bool:
    """Prints the curves of a family and their exponents; whether these are as required."""
    sizes = sorted(found["step"])
    print(f"\n{name:12}{'step / us':>12}{'batch / ns':>12}{'Python / s':>12}{'compiler / s':>14}")
    scales = {"step": 1e6, "batch": 1e9, "python": 1.0, "compiler": 1.0}
    for size in sizes:
        print(f"{size:<12}" + "".join(f"{scales[c] * median(found[c][size]):12.3g}" for c in COSTS))
    well = True
    for cost in COSTS:
        slope = exponent(found[cost])
        verdict = "pass" if slope.low <= most[cost] else "FAIL"
        well &= verdict == "pass"
        interval = f"[{slope.low:.2f}, {slope.high:.2f}]"
        print(f"  exponent of {cost:10}{slope.mean:6.2f}  {interval:16}{verdict}: {most[cost]:g}", flush=True)
    return well


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    names = [growing.family.__name__ for growing in GROWING]
    parser.add_argument(
        "families", nargs="*", metavar="FAMILY", help="Of variables, paths, degree; without one, all."
    )
    asked: list[str] = parser.parse_args().families or names
    if unknown := set(asked) - set(names):
        parser.error(f"no family {', '.join(sorted(unknown))}")
    chosen = [growing for growing in GROWING if growing.family.__name__ in asked]
    with TemporaryDirectory(prefix="dl2c-growth-") as cache:
        os.environ["DL2C_CACHE_DIR"] = cache
        results = [told(g.family.__name__, curves(g.family, g.sizes), g.most) for g in chosen]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
