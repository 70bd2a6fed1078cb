"""What is compared by `dl2c bench --verify`: judging boxes of states in C, part by part, and in numpy.

All rows run in a process of their own, in which numpy's linear algebra has one thread, as C has here.
"""

import multiprocessing
import os
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dl2c.commands.policy import Asked, questions_of
from dl2c.experiments.bench.measure import Result, measure
from dl2c.experiments.bench.numpy_boxes import NumpyBounds
from dl2c.experiments.bench.rows import Row
from dl2c.native.boxes import Doubles, Judge, Tables
from dl2c.policy.network import Interface, Layer, Network
from dl2c.policy_proof.question import NotCovered, Question
from dl2c.policy_proof.tables import outputs_of, tables_of

BASELINE = "numpy"
"""The row that others are compared with: the faster one of numpy's."""

MANY, FEW = 2048, 128
"""Boxes of a call. Few fit into caches, of which numpy makes use."""

HIDDEN = (64, 64, 64, 64)
"""Of the network that is made up where no policy is given."""

NARROWEST = 1e-6
"""Width of the narrowest boxes, as a share of that of all states."""

ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "MKL", "OMP", "VECLIB", "BLIS")}


def measured(
    model: str, policy: Path | None, options: Mapping[str, Any], seconds: float
) -> tuple[str, list[Result]]:
    """The model's name, and the rows: of the first alternative of the environment, where that decides before
    the policy. Raises what `questions_of` raises, `NotCovered` and `NativeError`.
    """
    network = None if policy is not None else random_network
    name, (question, *_) = questions_of(model, Asked(policy or Path(".")), options, network)
    if not question.dimensions or not outputs_of(question):
        raise NotCovered("there is nothing to measure: no name of the states matters, or nothing is decided")
    tables, boxes = tables_of(question), random_boxes(question, MANY)
    Judge(tables)  # compiled here, where the progress of it shows
    context = multiprocessing.get_context("spawn")
    with _environment(ONE_THREAD), ProcessPoolExecutor(1, mp_context=context) as other:
        return name, other.submit(_measured, tables, boxes, seconds).result()


def random_network(interface: Interface) -> Network:
    """The same for every model with these observations and actions."""
    rng = np.random.default_rng(1)
    layers: list[Layer] = []
    for inputs, outputs in pairwise((len(interface.observations), *HIDDEN, interface.outputs)):
        weight = rng.normal(size=(outputs, inputs)) * np.sqrt(2.0 / inputs)
        layers.append(Layer(weight, rng.normal(size=outputs) / 4.0, "relu"))
    return Network((), (*layers[:-1], Layer(layers[-1].weight, layers[-1].bias, "identity")))


def random_boxes(question: Question, count: int) -> Doubles:
    """Boxes within the states of a question, of many widths: (count, dimensions, 2)."""
    rng = np.random.default_rng(2)
    low, high = np.array([[float(a), float(b)] for a, b in question.box]).reshape(-1, 2).T
    share = rng.uniform(size=(count, len(low)))
    half = 0.5 * (high - low) * NARROWEST ** rng.uniform(size=(count, 1))
    middle = low + share * (high - low)
    return np.stack([np.maximum(middle - half, low), np.minimum(middle + half, high)], axis=2)


def rows(tables: Tables, boxes: Doubles) -> list[Row]:
    """Each judges or bounds all boxes, in one thread."""
    judge, arrays = Judge(tables), NumpyBounds(tables)
    few, verdicts = boxes[:FEW], partial(judge.verdicts, threads=1)

    def repeated(call: Callable[[Doubles], object], given: Doubles) -> Callable[[int], None]:
        def run(calls: int) -> None:
            for _ in range(calls):
                call(given)

        return run

    return [
        Row("numpy", f"bounds of outputs, numpy, {MANY} boxes", MANY, repeated(arrays.ranges, boxes)),
        Row("numpy_few", f"bounds of outputs, numpy, {FEW} boxes", FEW, repeated(arrays.ranges, few)),
        Row("bounds", "bounds of outputs, C", MANY, repeated(judge.ranges, boxes)),
        Row("contraction", "contraction by the hypothesis, C", MANY, repeated(judge.inside, boxes)),
        Row(
            "judge",
            "verdict and split, all parts, C",
            MANY,
            repeated(verdicts, boxes),
        ),
    ]


def _measured(tables: Tables, boxes: Doubles, seconds: float) -> list[Result]:
    return measure(rows(tables, boxes), seconds, baseline=BASELINE)


@contextmanager
def _environment(settings: Mapping[str, str]) -> Generator[None]:
    """Variables that processes which are started here see."""
    before = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
