"""`dl2c bench --verify`: the rows bound the same numbers, and what it reports. No times are asserted."""

import json
from fractions import Fraction

import numpy as np
import pytest
from policy_proof.questions import layers, question
from typer.testing import CliRunner

from dl2c.experiments.bench.boxes import random_boxes, rows
from dl2c.experiments.bench.numpy_boxes import NumpyBounds
from dl2c.experiments.commands import app
from dl2c.ir.model import TRUE
from dl2c.native.boxes import Judge
from dl2c.policy.network import Activation, Scaling
from dl2c.policy_proof.question import Arithmetic
from dl2c.policy_proof.tables import tables_of

TWO = ((Fraction(-2), Fraction(2)), (Fraction(0), Fraction(3)))


@pytest.mark.parametrize("activation", ["relu", "tanh"])
@pytest.mark.parametrize("arithmetic", ["real", "double", "float32"])
@pytest.mark.parametrize("scaled", [False, True])
def test_numpy_bounds_what_c_bounds(activation: Activation, arithmetic: Arithmetic, scaled: bool) -> None:
    """All but the last bits, in which sums are added in another order."""
    rng = np.random.default_rng(3)
    scalings = (Scaling(np.array([0.3, 1.0]), np.array([0.5, 2.0]), 1.5),) if scaled else ()
    network = layers(rng, [2, 24, 17, 1], activation)
    asked = question(network, TWO, TRUE, arithmetic=arithmetic, scalings=scalings, rounded=True)
    tables, boxes = tables_of(asked), random_boxes(asked, 999)
    ours, theirs = Judge(tables).ranges(boxes), NumpyBounds(tables).ranges(boxes)
    assert np.abs(ours - theirs).max() <= 1e-9 * np.abs(theirs).max()
    assert (ours[:, :, 0] <= ours[:, :, 1]).all()


def test_random_boxes_are_states_of_many_widths() -> None:
    asked = question(layers(np.random.default_rng(1), [2, 4, 1], "relu"), TWO, TRUE)
    boxes = random_boxes(asked, 500)
    for (low, high), of_one in zip(TWO, np.moveaxis(boxes, 1, 0), strict=True):
        assert (float(low) <= of_one[:, 0]).all() and (of_one[:, 1] <= float(high)).all()
    widths = boxes[:, 0, 1] - boxes[:, 0, 0]
    assert (widths > 0.1).any() and (widths < 1e-4).any() and (widths > 0.0).all()


def test_every_row_looks_at_all_boxes() -> None:
    asked = question(layers(np.random.default_rng(1), [2, 4, 1], "relu"), TWO, TRUE)
    for row in rows(tables_of(asked), random_boxes(asked, 300)):
        row.run(2)


def test_command() -> None:
    arguments = ["bench", "example:watertank", "--verify", "--seconds", "0.3", "--json"]
    done = CliRunner().invoke(app, [*arguments, "--require", "bounds=0.001", "--require", "judge=1e9"])
    assert done.exit_code == 1
    found = json.loads(done.stdout)
    assert [row["key"] for row in found["rows"]] == ["numpy", "numpy_few", "bounds", "contraction", "judge"]
    assert [r["met"] for r in found["requirements"]] == [True, False]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--policy", "run"], "--policy goes with --verify"),
        (["--verify", "--seconds", "0.1", "--require", "gym=1"], "no row `gym` here"),
        (["--verify", "--policy", "nowhere.json"], "nowhere.json"),
    ],
)
def test_mistakes(arguments: list[str], said: str) -> None:
    done = CliRunner().invoke(app, ["bench", "example:watertank", *arguments])
    assert done.exit_code in (1, 2)
    assert said in done.output or said in str(done.exception)
