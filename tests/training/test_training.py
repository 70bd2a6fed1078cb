"""Policies, measurements and training."""

import csv
import json
import math
import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generators.toy_library import toy_manifest, use_toy
from hypothesis import given
from hypothesis import strategies as st

from dl2c.env.actions import encoding
from dl2c.training.evaluation import evaluate, mean, outcomes, rate
from dl2c.training.policies import policy_of
from dl2c.training.rollout import COLUMNS, rollout

MODEL = "a model\nof two lines"
DECISIONS = [((3,), 0), ((3, 2), 0), ((), 2), ((), 0), ((2, 3), 1)]

MKL = re.compile("a?(cos|sin|tan)|erf(c|inv)?|exp|log(2|10)?|sqrt|tanh|trunc")
"""What PyTorch leaves to MKL where it has that."""
SHARED = 2048
"""From so many elements on, PyTorch's threads share what they leave to MKL."""


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes every model the toy library, with these decisions."""
    use_toy(monkeypatch)
    return partial(use_toy, monkeypatch)


@given(st.lists(st.booleans(), min_size=1, max_size=400))
def test_the_wilson_interval_holds_the_rate(hits: list[bool]) -> None:
    estimate = rate(np.array(hits))
    assert 0 <= estimate.low <= estimate.value + 1e-12
    assert estimate.value <= estimate.high + 1e-12 <= 1 + 2e-12
    assert estimate.low < estimate.high


def test_published_intervals() -> None:
    """Brown, Cai, DasGupta 2001, section 3: x = 0, n = 20 gives an upper limit of z^2/(n + z^2)."""
    z2 = 1.959963984540054**2
    assert rate(np.zeros(20, bool)).high == pytest.approx(z2 / (20 + z2))
    estimate = mean(np.array([1.0, 2.0, 3.0]))
    assert (estimate.value, estimate.high) == (2.0, pytest.approx(2 + 1.959963984540054 / math.sqrt(3)))
    assert math.isnan(mean(np.zeros(0)).value) and math.isnan(rate(np.zeros(0, bool)).value)


@pytest.mark.parametrize(("counts", "inputs"), DECISIONS)
@pytest.mark.parametrize("policy", ["random", "first"])
def test_evaluation_is_reproducible(toy: Any, counts: Any, inputs: int, policy: str) -> None:
    toy(counts, inputs)
    first = outcomes(policy, MODEL, 6, 10, True)
    again = outcomes(policy, MODEL, 6, 10, True)
    assert first.total.tolist() == again.total.tolist()
    assert evaluate(policy, MODEL, 6).episodes == 6


def test_evaluation_counts_what_happened() -> None:
    up = evaluate(lambda obs, _: np.full(len(obs), 2), MODEL, 10)
    assert (up.success.value, up.violations.value) == (1, 0)
    assert 0.4 < up.travel_time.value < 0.6
    still = evaluate("first", MODEL, 10)
    assert (still.success.value, math.isnan(still.travel_time.value)) == (0, True)


def test_violations_are_seen(toy: Any) -> None:
    toy((), 1)
    down = evaluate(lambda obs, _: np.full((len(obs), 1), -1.5), MODEL, 5)
    assert (down.violations.value, down.success.value) == (1, 0)


@given(st.lists(st.lists(st.booleans(), min_size=5, max_size=5), min_size=1, max_size=5), st.booleans())
def test_masked_policies_obey_the_mask(rows: list[list[bool]], random: bool) -> None:
    masks = np.array([[*r[:2], not any(r[:2]), *r[3:4], not r[3]] for r in rows])
    act = policy_of("random" if random else "first", encoding(toy_manifest((3, 2))), True, 0)
    actions = act(np.zeros((len(masks), 1)), masks)
    for mask, action in zip(masks, actions, strict=True):
        assert mask[action[0]] and mask[3 + action[1]]
        assert random or (action[0] == mask[:3].argmax())


def test_an_unmasked_random_policy_tries_everything() -> None:
    act = policy_of("random", encoding(toy_manifest((3,))), False, 0)
    assert set(act(np.zeros((99, 1)), np.zeros((99, 3), bool)).tolist()) == {0, 1, 2}


@pytest.mark.parametrize(("counts", "inputs"), DECISIONS)
def test_a_rollout_tells_every_step(toy: Any, counts: Any, inputs: int, tmp_path: Path) -> None:
    toy(counts, inputs)
    rows = list(rollout("random", MODEL, 3, seed=5))
    chosen = tuple(spec.key for spec in toy_manifest(counts, inputs).inputs)
    assert all(tuple(row) == (*COLUMNS, "x", "k", *chosen) for row in rows) and len(chosen) == inputs
    assert [row["step"] for row in rows if row["episode"] == 1] == list(
        range(sum(row["episode"] == 1 for row in rows))
    )
    ends = [row for row in rows if row["terminated"] or row["truncated"]]
    assert [row["episode"] for row in ends] == [0, 1, 2]
    assert rows == list(rollout("random", MODEL, 3, seed=5))
    with (tmp_path / "rows.csv").open("w", newline="") as file:
        csv.DictWriter(file, tuple(rows[0])).writerows(rows)


def test_a_file_that_is_no_policy_is_refused(tmp_path: Path) -> None:
    (tmp_path / "p.zip").write_text("no")
    with pytest.raises(ValueError, match="not a policy"):
        policy_of(tmp_path / "p.zip", encoding(toy_manifest()), True, 0)
    with pytest.raises(OSError, match="missing"):
        policy_of("missing.zip", encoding(toy_manifest()), True, 0)


@pytest.mark.parametrize(("algo", "counts", "inputs"), [("ppo", (3,), 1), ("maskable-ppo", (3, 2), 0)])
def test_a_trained_policy_can_be_read_back(
    toy: Any, algo: Any, counts: Any, inputs: int, tmp_path: Path
) -> None:
    pytest.importorskip("sb3_contrib")
    from dl2c.training.learning import train
    from dl2c.training.plots import plot_curves, plot_trajectory
    from dl2c.training.run import Settings

    toy(counts, inputs)
    hyper = {"n_steps": 16, "batch_size": 32, "n_epochs": 1, "net_arch": [8, 8]}
    small = Settings(steps=128, n_envs=4, hyper=hyper)
    seen: list[int] = []
    run = train(
        MODEL, algo, directory=tmp_path, settings=small, progress=lambda p: seen.append(p.steps), seed=1
    )
    assert seen == [p.steps for p in run.curve] == [64, 128]
    assert json.loads((tmp_path / "run.json").read_text())["algo"] == algo
    assert evaluate(run.policy, MODEL, 5) == evaluate(run.policy, MODEL, 5)
    plot_curves({"one": [run.curve]}, tmp_path / "curve.png")
    rows = list(rollout(run.policy, MODEL))
    plot_trajectory(rows, {"x": "position / m"}, tmp_path / "trajectory.png", "toy")
    assert (tmp_path / "curve.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("algo", "counts", "inputs", "hyper", "used"),
    [
        ("ppo", (3,), 0, {"n_steps": 1, "n_epochs": 1}, {"exp"}),
        ("sac", (), 1, {"learning_starts": 0, "gradient_steps": 1}, {"exp", "log", "tanh"}),
    ],
)
def test_mkl_is_called_by_one_thread_first(
    algo: Any, counts: Any, inputs: int, hyper: dict[str, Any], used: set[str], toy: Any, tmp_path: Path
) -> None:
    """Versions before 2025 can lose digits where several threads call a function for the first time."""
    pytest.importorskip("torch")
    from torch.utils._python_dispatch import TorchDispatchMode

    from dl2c.training.learning import train
    from dl2c.training.run import Settings

    sizes: dict[str, list[int]] = {}

    class Calls(TorchDispatchMode):
        def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
            if MKL.fullmatch(name := func.overloadpacket.__name__.rstrip("_")):
                sizes.setdefault(name, []).append(args[0].numel())
            return func(*args, **(kwargs or {}))

    toy(counts, inputs)
    hyper = {"batch_size": SHARED, "net_arch": [8, 8], **hyper}
    with Calls():
        train(MODEL, algo, directory=tmp_path, settings=Settings(steps=SHARED, n_envs=SHARED, hyper=hyper))
    assert used <= {name for name, called in sizes.items() if max(called) >= SHARED}
    assert all(called[0] < SHARED for called in sizes.values()), sizes


def test_maskable_ppo_refuses_continuous_actions(toy: Any, tmp_path: Path) -> None:
    pytest.importorskip("sb3_contrib")
    from dl2c.training.learning import train

    toy((), 1)
    with pytest.raises(ValueError, match="discrete"):
        train(MODEL, "maskable-ppo", directory=tmp_path)
