"""`dl2c sample` and `dl2c check --prove-coverage` say what is true of the sampler."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from generators.ir_builder import PAPER, model
from native.test_native_sampling import ROBOT
from sampling.test_sampling import planned
from typer.testing import CliRunner

from dl2c import make
from dl2c.cli import app
from dl2c.commands.sample import regions
from dl2c.smt.coverage import Covered, Outside, coverage


def run(*words):
    return CliRunner().invoke(app, list(words))


def boxes_of(plan):
    free = plan.blocks[-1].charts[0].free
    return [dict(zip(free, zip(b.low, b.high, strict=True), strict=True)) for b in plan.blocks[-1].boxes]


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / "robot.kyx"
    path.write_text(ROBOT.text)
    return str(path)


def test_samples_are_those_of_resets(tmp_path):
    table = tmp_path / "states.csv"
    result = run("sample", "example:waypoint", "-n", "5", "--seed", "3", "--csv", str(table), "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["certificate"] == "exact"
    rows = list(csv.DictReader(table.open()))
    env = make("example:waypoint")
    for k, row in enumerate(rows):
        env.reset(seed=3 + k)
        assert {n: float(v) for n, v in row.items()} == env.state


def test_a_witness_is_reported_with_its_error(robot):
    result = run("sample", robot, "-n", "50")
    assert result.exit_code == 0, result.output
    assert "a real solution lies within" in result.stdout


def test_a_corner_plot_is_written(robot, tmp_path):
    pytest.importorskip("matplotlib")
    picture = tmp_path / "corner.png"
    assert run("sample", robot, "-n", "200", "--plot", str(picture)).exit_code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_z3_proves_the_papers_boxes():
    result = run("check", "example:waypoint", "--prove-coverage")
    assert result.exit_code == 0, result.output
    assert "no initial state lies outside of the 65 boxes" in result.stdout


def test_a_missing_box_is_noticed():
    plan = planned(PAPER)
    assert isinstance(coverage(PAPER, plan.around, boxes_of(plan)), Covered)
    heaviest = int(np.argmax([b.weight for b in plan.blocks[-1].boxes]))
    boxes = [b for k, b in enumerate(boxes_of(plan)) if k != heaviest]
    assert isinstance(coverage(PAPER, plan.around, boxes), Outside)


CHARTED = [
    model("x*x + y*y == 1 and x >= -0.5", {"x": "-1:1", "y": "-1:1"}),
    model("x == 1 or x == y", {"x": "-1:1", "y": "-1:3"}),
    model("(x - c)*(x - c) + y*y == r*r", {"x": "-2:2", "y": "-2:2", "r": "-2:2", "c": "-1:1"}),
    model("x <= y + 0.001 and x >= y - 0.001 and x <= z and z <= 3*y", {"x": "0:1", "y": "0:1", "z": "0:3"}),
]


@pytest.mark.parametrize("m", CHARTED, ids=lambda m: m.source[:30])
def test_z3_proves_the_boxes_of_charts(m):
    """And notices it where the heaviest box of one is missing."""
    for block in planned(m).blocks:
        heaviest = max(block.boxes, key=lambda box: box.weight)
        for boxes, verdict in ((block.boxes, Covered), (set(block.boxes) - {heaviest}, Outside)):
            plan = replace(planned(m), blocks=(replace(block, boxes=tuple(boxes)),))
            found = [coverage(m, *region) for region in regions(plan)]
            assert any(isinstance(f, verdict) for f in found)
            assert verdict is Outside or all(isinstance(f, Covered) for f in found)


def test_definitions_do_not_hinder_the_proof():
    m = model("x == 2*y + z and x > 0.3 and y*z > 0.1", {"x": "0:1", "y": "-5:5", "z": "0.1:3"})
    plan = planned(m)
    assert isinstance(coverage(m, plan.around, boxes_of(plan)), Covered)


def test_a_corner_plot_has_every_name_that_varies(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    drawn = []
    monkeypatch.setattr("dl2c.picture.figure.save", lambda figure, path: drawn.append(figure))
    arguments = ("-n", "50", "--plot", str(tmp_path / "corner.png"))
    assert run("sample", "example:passive_safety", *arguments).exit_code == 0
    below = [axes.get_xlabel() for axes in drawn[0].axes if axes.get_xlabel()]
    assert len(below) == 16 and {"x", "vx", "gy", "V"} <= set(below)
