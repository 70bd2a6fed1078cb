"""The speed comparison: that its rows do the same work, and what it reports. No times are asserted."""

import json
import math
import sys
from fractions import Fraction
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from hypothesis import given
from hypothesis import strategies as st

import dl2c
import dl2c.cli
import dl2c.experiments.bench.rows
import dl2c.experiments.bench.sizes
import dl2c.experiments.commands  # adds its commands
from dl2c.env.opening import batch_options, source_of
from dl2c.env.single import Dl2cEnv
from dl2c.experiments.bench.hand_written import HandWritten, is_there
from dl2c.experiments.bench.measure import growth, measure
from dl2c.experiments.bench.python_source import NAMESPACE, formula_source, term_source
from dl2c.experiments.bench.rows import (
    BASELINE,
    EmptyEnv,
    Row,
    Subject,
    baseline_row,
    cartpole_row,
    deviation,
    empty_row,
    gym_row,
    infos_row,
    rows,
    sb3_row,
    starts,
    subject,
)
from dl2c.experiments.bench.sizes import vehicles
from dl2c.ir.evaluate import Undefined, evaluate, truth
from dl2c.ir.model import Add, And, Call, Compare, Div, Formula, Mul, Neg, Number, Or, Sub, Symbol, Term
from dl2c.native.stepping import stepping
from dl2c.source import Source

pytest.importorskip("scipy")

WAYPOINT = "example:waypoint"

SYMBOLS = [Symbol("x", "variable"), Symbol("A", "constant")]

MODEL = """
ArchiveEntry "Small"
ProgramVariables
  /* @var: bound=[0:4] */ Real x;
  /* @var: bound=[-2:2] */ Real v;
  /* @var: bound=[0:1] */ Real t;
End.
Problem
  x >= 0 & t = 0 -> [{%s}*]x >= -100
End.
End.
"""

BODIES = {
    "inputs": "v := *; ?(v >= x - 3 & v <= 2 & v > -1.5); t := 0; {x' = v, t' = 1 & t <= 0.5}",
    "a union": "v := *; ?(v >= x - 3 & v <= 2 & (v^2 >= 1 + x | v = x / 4)); t := 0;"
    "{x' = v, t' = 1 & t <= 0.5}",
    "joined inputs": "t := *; ?(0 <= t & t <= 1); v := *; ?(v * t >= x - 3 & v <= 2 & v > -1.5); t := 0;"
    "{x' = v, t' = 1 & t <= 0.5}",
    "events": "{?x > 1; v := -1; ++ v := 2;} t := 0; {x' = v, v' = -1, t' = 1 & t <= 2 & x <= 3.5}",
    "two flows": "t := 0; {x' = v, t' = 1 & t <= 1} {?x > 0; v := -1; ++ ?x <= 0; v := 1;}"
    "{x' = v, t' = 1 & t <= 2}",
    "marks": "{?x < 1; v := -1; ++ v := 1; ++ /* @fallback */ v := 0.5;} t := 0; {x' = v, t' = 1 & t <= 1}",
}


def terms() -> st.SearchStrategy[Term]:
    leaves = st.sampled_from(SYMBOLS) | st.integers(-3, 3).map(lambda n: Number(Fraction(n)))

    def extend(parts: st.SearchStrategy[Term]) -> st.SearchStrategy[Term]:
        pairs = st.tuples(parts, parts)
        binary = st.sampled_from([Add, Sub, Mul, Div])
        calls = st.tuples(st.sampled_from(["min", "max"]), pairs).map(lambda c: Call(c[0], c[1]))
        single = st.tuples(st.sampled_from(["abs", "sqrt"]), parts).map(lambda c: Call(c[0], (c[1],)))
        return st.tuples(binary, pairs).map(lambda b: b[0](*b[1])) | calls | single | parts.map(Neg)

    return st.recursive(leaves, extend, max_leaves=8)


def formulas() -> st.SearchStrategy[Formula]:
    atoms = st.builds(Compare, st.sampled_from(["=", "!=", "<", "<=", ">", ">="]), terms(), terms())
    return st.recursive(
        atoms,
        lambda parts: st.builds(lambda kind, a, b: kind((a, b)), st.sampled_from([And, Or]), parts, parts),
        max_leaves=4,
    )


def value_of(text: str, x: int, a: int) -> Any:
    return eval(text, NAMESPACE | {"X_x": float(x), "P_A": float(a)})


@given(terms(), st.integers(-3, 3), st.integers(-3, 3))
def test_printed_terms_have_the_value_of_terms(term: Term, x: int, a: int) -> None:
    found = value_of(term_source(term), x, a)
    try:
        assert found == evaluate(term, dict(zip(SYMBOLS, (float(x), float(a)), strict=True)))
    except Undefined:
        assert math.isnan(found)


@given(formulas(), st.integers(-3, 3), st.integers(-3, 3))
def test_printed_formulas_have_the_truth_of_formulas(formula: Formula, x: int, a: int) -> None:
    env = dict(zip(SYMBOLS, (float(x), float(a)), strict=True))
    assert value_of(formula_source(formula), x, a) == truth(formula, env)


@pytest.fixture(scope="module")
def waypoint() -> Subject:
    return subject(source_of(WAYPOINT), {})


def test_baseline_moves_like_the_c(waypoint: Subject) -> None:
    assert deviation(waypoint, 200) < 1e-6


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_baseline_moves_like_the_c_in_other_models(body: str) -> None:
    assert deviation(subject(Source("small.kyx", MODEL % body), {"max_episode_steps": 20}), 200) < 1e-6


def test_deviation_sees_a_difference(waypoint: Subject) -> None:
    other = subject(waypoint.source, {"dt": "0.05"})
    assert deviation(Subject(waypoint.source, waypoint.options, other.library)) > 1e-3


def test_hand_written_loop_does_what_the_batch_does(waypoint: Subject) -> None:
    n = 64
    batch = waypoint.library.batch(n, autoreset="same_step", **batch_options(waypoint.library.manifest))
    batch.reset(seeds=np.arange(n, dtype=np.uint64))
    loop = HandWritten(n)
    loop.state[:] = [x + p for x, p in starts(waypoint.library, n)]
    loop.refresh()
    names = ("duration", "status", "reason", "cost", "terminated", "truncated")
    names += ("blocked", "postcondition", "saturated")
    ended = 0
    for _ in range(100):
        batch.step()
        loop.step()
        results = {name: array.squeeze() for name, array in loop.results.items()}
        for name in names:
            assert np.allclose(results[name], getattr(batch, name), 1e-9, 1e-9), name
        assert np.allclose(results["reward"], batch.rewards)
        assert np.array_equal(results["choice"], batch.executed_choices[:, 0])
        assert np.array_equal(results["reset"], batch.began)
        over = batch.began
        assert np.allclose(results["final_obs"][over], batch.final_obs[over])
        assert np.allclose(results["obs"][~over], batch.obs[~over])
        assert np.array_equal(results["mask"][~over], batch.mask[~over])
        for i in np.flatnonzero(over):
            loop.state[i] = np.concatenate(batch.get_state(int(i)))
        loop.refresh()
        ended += over.sum()
    assert ended > 50


def test_hand_written_loop_begins_admissible_episodes(waypoint: Subject) -> None:
    loop = HandWritten(32)
    batch = waypoint.library.batch(1, **batch_options(waypoint.library.manifest))
    for row in loop.state:
        batch.reset_to(0, 0, row[:6], row[6:])


def test_rows_agree_on_their_keys_and_order(waypoint: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dl2c.experiments.bench.rows, "find_spec", lambda _: None)
    found, notes = rows(waypoint)
    assert [note for note in notes if "Stable-Baselines3" in note]
    results = measure(found, 0.5, rounds=3)
    by_key = {r.key: r for r in results}
    batches = [f"batch{n}" for n in (1, 8, 64, 1024, 16384)]
    assert list(by_key) == [
        *(BASELINE, "gym", *batches, "scalar1024", "vector64", "vector1024", "loop"),
        *("memory", "cartpole", "cartpole1024", "empty"),
    ]
    assert by_key[BASELINE].ratio == by_key[BASELINE].low == by_key[BASELINE].high == 1.0
    assert all(0 < r.low <= r.ratio <= r.high for r in results)
    assert by_key["memory"].ratio > by_key["batch1024"].ratio > by_key["gym"].ratio > 1
    assert by_key["batch1024"].ratio > by_key["scalar1024"].ratio
    assert list(growth(results)) == [1, 8, 64, 1024, 16384]
    assert growth(results)[1] == 1.0


def test_the_empty_environment_returns_what_the_model_does(waypoint: Subject) -> None:
    """The same objects, neither less nor more, and fresh: over two episodes and the resets between."""
    model = Dl2cEnv(waypoint.source, **waypoint.options)
    empty = EmptyEnv(model)
    first = []
    for _ in range(2):
        pairs = [(model.reset(seed=0), empty.reset())]
        while len(pairs) == 1 or not any(pairs[-1][0][2:4]):
            pairs.append((model.step(0), empty.step(0)))
        for left, right in pairs:
            assert data_equivalence(left, right, exact=True)
            assert list(left[-1]) == list(right[-1])
            assert [type(v) for v in left[-1].values()] == [type(v) for v in right[-1].values()]
        first.append(pairs)
    for (_, once), (_, again) in zip(*first, strict=True):
        assert not np.shares_memory(once[0], again[0])
        assert not np.shares_memory(once[-1]["action_mask"], again[-1]["action_mask"])


@pytest.mark.skipif(stepping() is None, reason="without Python's headers steps are made in Python")
def test_a_single_step_costs_little_more_than_its_objects(waypoint: Subject) -> None:
    """In the quietest of some rounds."""
    rows = [empty_row(waypoint), gym_row(waypoint), cartpole_row()]
    _, gym, cartpole = measure(rows, 2, rounds=9, baseline="empty")
    assert gym.high > 1 / 1.5
    assert max(a / b for a, b in zip(gym.rates, cartpole.rates, strict=True)) > 4


def test_sb3_rows_run(waypoint: Subject) -> None:
    pytest.importorskip("stable_baselines3")
    sb3_row(waypoint, 8).run(3)
    infos_row(waypoint, 8).run(3)


def test_other_models_have_no_hand_written_loop(waypoint: Subject) -> None:
    assert is_there(waypoint.source)
    assert not is_there(Source("small.kyx", MODEL % BODIES["inputs"]))


def test_models_grow_in_every_way() -> None:
    manifest = subject(vehicles(3), {}).library.manifest
    assert (len(manifest.variables), len(manifest.runs)) == (10, 4)


def test_slower_rows_have_smaller_ratios() -> None:
    def busy(amount: int) -> Row:
        key = BASELINE if amount == 4000 else f"row{amount}"
        return Row(key, key, 1, lambda k: [sum(range(amount)) for _ in range(k)] and None)

    slow, base, fast = measure([busy(16000), busy(4000), busy(1000)], 0.3, rounds=3)
    assert slow.ratio < base.ratio == 1.0 < fast.ratio


def test_baseline_row_goes_through_episodes(waypoint: Subject) -> None:
    baseline_row(waypoint).run(150)


def bench(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of `dl2c bench example:waypoint` without Stable-Baselines3."""
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as end:
        patch.setattr(dl2c.experiments.bench.rows, "find_spec", lambda _: None)
        patch.setattr(sys, "argv", ["dl2c", "bench", WAYPOINT, "--seconds", "0.1", *arguments])
        dl2c.cli.main()
    out, err = capsys.readouterr()
    return int(end.value.code or 0), out, err


def test_bench_prints_json(capsys: Any) -> None:
    code, out, _ = bench(capsys, "--json", "--require", "gym=0.1", "--require", "batch1024=1")
    data = json.loads(out)
    assert code == 0
    assert {row["key"] for row in data["rows"]} >= {BASELINE, "gym", "batch1024", "empty"}
    assert [r["met"] for r in data["requirements"]] == [True, True]
    assert data["deviation"] < 1e-6
    assert data["growth"]["1"] == 1.0


def test_bench_draws_its_table_and_how_speed_grows(
    capsys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(dl2c.experiments.bench.sizes, "SIZES", (1, 3))
    picture = tmp_path / "speed.png"
    code, out, err = bench(capsys, "--plot", str(picture), "--json")
    sizes = json.loads(out)["sizes"]
    assert code == 0 and str(picture) in err
    assert set(sizes) == {"4", "10"} and sizes["4"] == 1.0
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 10_000


def test_bench_fails_where_a_requirement_is_missed(capsys: Any) -> None:
    code, out, _ = bench(capsys, "--require", "gym=0.1", "--require", "batch1024=1e9")
    assert code == 1
    assert [line.split()[0] for line in out.splitlines()[-2:]] == ["pass", "FAIL"]


def test_requirements_may_compare_two_rows(capsys: Any) -> None:
    code, out, _ = bench(capsys, "--require", "batch64/gym=0.01", "--require", "gym/batch64=1e9")
    assert code == 1
    passed, failed = out.splitlines()[-2:]
    assert passed.startswith("pass  batch64/gym: ") and "times gym" in passed
    assert failed.startswith("FAIL  gym/batch64: ")


@pytest.mark.parametrize("wanted", ["nothing=1", "gym", "gym=fast", "gym/nothing=1"])
def test_bench_refuses_requirements_it_does_not_know(capsys: Any, wanted: str) -> None:
    code, _, err = bench(capsys, "--require", wanted)
    assert code == 1
    assert err.startswith("error: ")
    assert "Traceback" not in err


@pytest.mark.slow
@pytest.mark.parametrize(("package", "name"), [("stable_baselines3", "PPO"), ("sb3_contrib", "MaskablePPO")])
def test_environments_are_a_small_part_of_training(package: str, name: str) -> None:
    """With 256 of them, and batches so large that learning is quick."""
    algorithm = getattr(pytest.importorskip(package), name)
    from stable_baselines3.common.vec_env import VecEnvWrapper

    class Timed(VecEnvWrapper):
        """How long the steps of its environments take."""

        spent = 0.0

        def reset(self) -> Any:
            return self.venv.reset()

        def step_async(self, actions: Any) -> None:
            begun = perf_counter()
            self.venv.step_async(actions)
            self.spent += perf_counter() - begun

        def step_wait(self) -> Any:
            begun = perf_counter()
            results = self.venv.step_wait()
            self.spent += perf_counter() - begun
            return results

    envs = Timed(dl2c.make_sb3("example:waypoint", 256))
    model = algorithm("MlpPolicy", envs, n_steps=32, batch_size=8192, seed=0, device="cpu")
    model.learn(8192)
    envs.spent, begun = 0.0, perf_counter()
    model.learn(6 * 8192)
    assert 0.0 < envs.spent <= 0.03 * (perf_counter() - begun)
