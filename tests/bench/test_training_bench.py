"""What `make bench-train AGAINST=REV` says is true of trainings that differ by known amounts."""

import subprocess
from pathlib import Path

import pytest
from bench.trainings import ROOT, TOLERATED, Trained, better, faster, trained

SPREAD = (0.98, 1.01, 1.0, 1.02, 0.99)


def trainings(rate: float, learned: float) -> list[Trained]:
    """Five seeds around these numbers; a random policy earns 10."""
    return [
        Trained(rate * s, 10.0 + (learned - 10.0) * t, 10.0)
        for s, t in zip(SPREAD, SPREAD[1:] + SPREAD[:1], strict=True)
    ]


def test_speed_is_a_ratio() -> None:
    found = faster(trainings(60.0, 50.0), trainings(20.0, 50.0))
    assert found.low <= 3.0 <= found.high
    assert abs(found.mean - 3.0) < 0.05


def test_what_is_lost_is_a_share_of_what_was_learned() -> None:
    same = better(trainings(1.0, 50.0), trainings(1.0, 50.0))
    less = better(trainings(1.0, 46.0), trainings(1.0, 50.0))
    assert (same.mean, same.high) == (0.0, 0.0)
    assert abs(less.mean + 0.1) < 0.01 and less.high < -TOLERATED


def test_nothing_is_lost_where_nothing_is_learned() -> None:
    assert better(trainings(1.0, 10.0), trainings(1.0, 10.0)).mean == 0.0


@pytest.mark.slow
def test_a_tree_is_measured() -> None:
    pytest.importorskip("stable_baselines3")
    found = trained(ROOT, "static_safety_line", "ppo", 30_000, 1)
    assert found.rate > 0 and found.learned != found.random
    with pytest.raises(subprocess.CalledProcessError):
        trained(Path(ROOT), "no_such_example", "ppo", 1_000, 1)
