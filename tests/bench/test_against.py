"""What `make bench AGAINST=REV` says is true of trees that differ by a known factor."""

import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from bench import against, limits
from bench.against import OVERHEADS, ROUNDS, Rates, missing, ratio_of, ratios, required_of, with_all
from bench.processes import OWN, commands_of, with_another_reward
from bench.worker import DOPRI, calls_of

from dl2c.resolve.unreadable import read_file
from dl2c.source import Source


def rounds(faster: float, seed: int = 1) -> tuple[list[float], list[float]]:
    """Rates of a row in two trees on a machine whose speed changes from round to round."""
    rng = random.Random(seed)
    machine = [rng.uniform(0.3, 1.0) for _ in range(ROUNDS)]
    here = [faster * speed * rng.uniform(0.99, 1.01) for speed in machine]
    return here, [speed * rng.uniform(0.99, 1.01) for speed in machine]


def test_what_slows_both_alike_does_not_count() -> None:
    found = ratio_of("row", *rounds(1.4), 1.4)
    assert found.low < 1.4 < found.high < 1.45 and found.met
    assert not ratio_of("row", *rounds(1.4), 1.5).met


def test_the_interval_holds_the_truth_nineteen_times_of_twenty() -> None:
    inside = 0
    for seed in range(400):
        found = ratio_of("row", *rounds(2.0, seed), None)
        inside += found.low <= 2.0 <= found.high
    assert 360 <= inside <= 396


def test_what_is_done_once_does_not_shorten_what_is_measured() -> None:
    lasts = iter([0.05])

    def run(calls: int) -> None:
        until = time.process_time() + calls * 1e-3 + next(lasts, 0.0)
        while time.process_time() < until:
            pass

    assert calls_of(run) >= 40


def test_what_is_required_of_one_example_goes_before_what_is_of_all() -> None:
    required = {"batch1024": 1.4, "acc/batch1024": 1.0}
    assert required_of("acc/batch1024", required) == 1.0
    assert required_of("waypoint/batch1024", required) == 1.4
    assert required_of("waypoint/gym", required) is None


def test_only_rows_of_both_are_compared() -> None:
    def measured() -> Iterator[tuple[str, Rates, Rates]]:
        here, there = rounds(1.1)
        yield "acc", {"gym": here, "new": here}, {"gym": there}

    assert [r.row for r in ratios(measured(), {})] == ["acc/gym"]


def test_what_is_required_and_not_measured_is_named() -> None:
    found = [ratio_of("acc/gym", *rounds(1.1), None)]
    required = {"acc/gym": 1.0, "acc/vector1024-batch1024": 4.0, "dubins/gym": 1.0, "check": 2.0}
    assert missing(required, found, ["acc"]) == ["acc/vector1024-batch1024"]


def test_all_examples_together_take_the_sum_of_their_times() -> None:
    def measured() -> Iterator[tuple[str, Rates, Rates]]:
        yield "acc", {"cold": [1.0, 0.5]}, {"cold": [0.5, 0.25]}
        yield "etcs", {"cold": [0.5, 1.0]}, {"cold": [0.25, 0.5]}

    rows = list(with_all(measured()))
    assert [name for name, _, _ in rows] == ["acc", "etcs", "all"]
    assert rows[-1][1:] == ({"cold": [1 / 3, 1 / 3]}, {"cold": [1 / 6, 1 / 6]})


def test_each_limit_is_that_of_a_row() -> None:
    examples = {model.stem for model in against.ROOT.glob("examples/*.kyx")}
    commands = {command.row for command in commands_of("", "", "")} | {"/".join(pair) for pair in OWN}
    environments = {"batch1", "batch1024", DOPRI, *OVERHEADS}
    for required, rows in ((limits.COMMANDS, commands), (limits.ENVIRONMENTS, environments)):
        for name in required:
            example, _, row = name.partition("/")
            assert name in rows or (example in examples | {"all"} and row in rows), name


def test_every_example_has_a_reward_to_edit() -> None:
    for model in sorted(against.ROOT.glob("examples/*.kyx")):
        text = model.read_text(encoding="utf-8")
        edited = with_another_reward(text, 123)
        assert len(edited) == len(text) + 4 and edited != text
        assert read_file(Source(model.name, edited), None)


@pytest.mark.slow
def test_a_tree_is_as_fast_as_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows of one example, by two processes each."""
    monkeypatch.setattr(against, "ROUNDS", 3)
    here, there = against.rates_of("watertank", [against.ROOT, against.ROOT])
    found = [ratio_of(row, here[row], there[row], None) for row in here]
    assert {"gym", "batch1024", "vector1024", "shared1024"} <= {r.row for r in found}
    assert all(0.7 < r.mean < 1.4 for r in found if "-" not in r.row)
    assert Path(against.WORKER).exists()
