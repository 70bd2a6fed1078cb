"""The single environment: spaces, actions, infos, copies."""

import copy
import pickle
import warnings
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from generators.toy_library import ToyLibrary, toy_manifest, use_toy
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.utils.passive_env_checker import data_shares_objects
from hypothesis import given
from hypothesis import strategies as st

from dl2c.env.actions import encoding
from dl2c.env.registration import register
from dl2c.env.single import Dl2cEnv
from dl2c.env.spaces import observation_space
from dl2c.native.errors import ResetFailed
from dl2c.options import UnknownOption

MODEL = "a model\nof two lines"
DECISIONS = [((3,), 0), ((3, 2), 0), ((), 2), ((), 0), ((2, 3), 1)]


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Callable[..., gym.Env[Any, Any]]:
    """Makes an environment of the toy library, through Gymnasium."""

    def make(counts: tuple[int, ...] = (3,), inputs: int = 0, **options: Any) -> gym.Env[Any, Any]:
        use_toy(monkeypatch, counts, inputs)
        return gym.make("dl2c/Model-v0", model=MODEL, **options)

    return make


@pytest.mark.parametrize(("counts", "inputs"), DECISIONS)
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_check_env_is_silent_but_for_action_scales(toy: Any, counts: Any, inputs: int, dtype: str) -> None:
    options = {"action_map": "squash"} if inputs else {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(toy(counts, inputs, obs_dtype=dtype, **options).unwrapped, skip_render_check=True)


def all_formats() -> list[tuple[Any, int, str]]:
    formats = [(c, i, f) for c, i in DECISIONS for f in ("auto", "dict", "box")]
    return formats + [(c, 0, f) for c in [(3,), (3, 2)] for f in ("discrete", "multidiscrete")]


@pytest.mark.parametrize(("counts", "inputs", "name"), all_formats())
@pytest.mark.parametrize("action_map", ["project", "squash"])
def test_an_admissible_request_is_executed_as_written(
    toy: Any, counts: Any, inputs: int, name: str, action_map: str
) -> None:
    env = toy(counts, inputs, action_format=name, action_map=action_map)
    env.action_space.seed(1)
    env.reset(seed=1)
    for _ in range(30):
        action = env.action_space.sample()
        _, _, terminated, truncated, info = env.step(action)
        assert info["executed_action"] in env.action_space
        if not info["blocked"] and name != "box":
            assert data_equivalence(
                spaces.flatten(env.action_space, info["executed_action"]),
                spaces.flatten(env.action_space, action),
                exact=True,
            )
        if terminated or truncated:
            env.reset()


@given(st.data())
def test_executed_inverts_write(data: st.DataObject) -> None:
    counts, inputs, name = data.draw(st.sampled_from(all_formats()))
    squash = data.draw(st.sampled_from(["project", "squash"]))
    n = data.draw(st.integers(1, 4))
    manifest = toy_manifest(counts, inputs, action_format=name, action_map=squash)
    code = encoding(manifest)
    batch = ToyLibrary(manifest).batch(n)
    space = gym.vector.utils.batch_space(code.space(), n)
    space.seed(data.draw(st.integers(0, 99)))
    code.write(batch, space.sample())
    first = batch.choices.copy(), batch.inputs.copy()
    again = code.executed(*first)
    assert again in space
    batch.choices[:] = batch.inputs[:] = 0
    code.write(batch, again)
    assert data_equivalence(first[0], batch.choices, exact=True)
    np.testing.assert_allclose(first[1], batch.inputs, rtol=1e-6)


NUMBERS: list[Any] = [
    *(np.zeros(1), np.ones(1, np.float32), np.ones(1, np.float16), np.ones(1, np.longdouble)),
    *(np.ones(1, int), np.ones(1, ">f8"), np.array([np.nan]), np.array([np.inf]), np.zeros((1, 1))),
    *(np.zeros(2), np.array(1.0), [2.0], 3.0, None),
]
INDICES: list[Any] = [0, 2, -1, 10**30, True, np.True_, np.int8(1), np.array(1), np.array([1]), 1.0, None]


def requested(batch: Any, call: Callable[[], None]) -> Any:
    """What an action asks for, or how it is refused."""
    batch.choices[:], batch.inputs[:] = -7, -7
    try:
        call()
    except (ValueError, TypeError, OverflowError) as problem:
        return type(problem), str(problem)
    return batch.choices.tolist(), batch.inputs.tolist()


def test_one_action_is_requested_as_a_batch_of_one() -> None:
    """Also where its entries are not what the space samples."""
    manifest = toy_manifest((3, 2), 1)
    code, batch = encoding(manifest), ToyLibrary(manifest).batch(1)
    quick = code.writer(batch)
    actions = [{"assign_u0": u, "choice_0": i, "choice_1": 1} for u in NUMBERS for i in INDICES]
    for action in ({}, *actions, actions[0] | {"more": 1}):
        rows = {key: np.asarray(value)[None] for key, value in action.items()}
        found = requested(batch, lambda action=action: quick(action))
        assert found == requested(batch, lambda rows=rows: code.write(batch, rows)), action


@pytest.mark.parametrize("action_map", ["project", "squash"])
def test_one_row_is_requested_and_read_as_a_batch_of_one(action_map: str) -> None:
    """Choices halfway between two, far outside, and the limits of their range."""
    manifest = toy_manifest((3, 1, 4), 2, action_format="box", action_map=action_map)
    code, batch = encoding(manifest), ToyLibrary(manifest).batch(1)
    quick, read = code.writer(batch), code.reader(batch)
    numbers = [-np.inf, -1e9, -1.0, -0.5, -0.0, 0.5, 1 / 3, 1.0, 1.5, 2.5, 7.0, np.inf, np.nan]
    rng = np.random.default_rng(1)
    for _ in range(400):
        row = rng.choice(numbers, 5).astype(rng.choice(["f", "d"]))
        found = requested(batch, lambda row=row: quick(row))
        wanted = requested(batch, lambda row=row: code.write(batch, row[None]))
        assert found == wanted or (np.isnan(row).any() and found[0] is wanted[0] is ValueError), row
        batch.executed_choices[:] = rng.integers(0, (3, 1, 4))
        batch.executed_inputs[:] = rng.normal(size=2)
        alone, together = read(), code.executed(batch.executed_choices, batch.executed_inputs)[0]
        assert (alone.dtype, alone.tobytes()) == (together.dtype, together.tobytes())


@pytest.mark.parametrize(
    ("counts", "inputs", "name", "bad"),
    [
        ((3,), 0, "auto", 3),
        ((3,), 0, "auto", -1),
        ((3,), 0, "auto", 7),
        ((3, 2), 0, "auto", np.array([2, 2])),
        ((3, 2), 0, "auto", np.array([2])),
        ((3, 2), 0, "discrete", 6),
        ((), 2, "auto", np.array([0.0])),
        ((), 2, "auto", np.array([0.0, np.nan])),
        ((3,), 1, "box", np.array([np.nan, 0.0])),
        ((3,), 1, "auto", {"choice_0": 1}),
        ((3,), 1, "auto", {"choice_0": 3, "assign_u0": np.zeros(1)}),
        ((), 0, "auto", 1),
    ],
)
def test_an_action_outside_the_space_is_refused(
    toy: Any, counts: Any, inputs: int, name: str, bad: Any
) -> None:
    env = toy(counts, inputs, action_format=name)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"action|expected"):
        env.step(bad)
    env.step(env.action_space.sample())


@pytest.mark.parametrize("name", ["discrete", "multidiscrete"])
def test_formats_without_inputs_refuse_them(name: str) -> None:
    with pytest.raises(UnknownOption, match="assign_u0"):
        encoding(toy_manifest((2,), 1, action_format=name))


def test_a_run_is_masked_by_the_decisions_it_meets() -> None:
    code = encoding(toy_manifest((2, 3), 0, action_format="discrete"))
    mask = np.array([[1, 1, 1, 1, 1], [1, 0, 1, 0, 1]], np.int8)
    assert code.masks(mask).tolist() == [[1] * 6, [1, 0, 1, 0, 0, 0]]


def test_runs_that_do_not_meet_a_decision_ignore_it() -> None:
    import dataclasses

    manifest = toy_manifest((2, 3), 0, action_format="discrete")
    code = encoding(dataclasses.replace(manifest, runs=((0, -1), (1, 0), (1, 1), (1, 2))))
    assert code.space() == spaces.Discrete(4)
    assert code.masks(np.array([[1, 1, 0, 1, 0]], np.int8)).tolist() == [[1, 0, 1, 0]]
    assert code.executed(np.array([[0, 2], [1, 2]]), np.zeros((2, 0))).tolist() == [0, 3]


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@given(low=st.floats(-1e300, 1e300), width=st.floats(0, 1e300))
def test_declared_bounds_fit_into_the_box(dtype: str, low: float, width: float) -> None:
    import dataclasses

    from dl2c.native.manifest import Quantity

    manifest = dataclasses.replace(
        toy_manifest(obs_dtype=dtype), observations=(Quantity("x", low, low + width),)
    )
    box = observation_space(manifest)
    assert float(box.low[0]) <= low
    assert low + width <= float(box.high[0])
    assert dtype == "float32" or (box.low[0], box.high[0]) == (low, low + width)


def test_unbounded_observations_on_request() -> None:
    box = observation_space(toy_manifest(observation_bounds="unbounded"))
    assert np.isinf(box.low).all() and np.isinf(box.high).all()


def play(env: gym.Env[Any, Any], seed: int, steps: int = 50) -> list[Any]:
    """What an environment returns to a fixed sequence of actions."""
    env.action_space.seed(seed)
    seen: list[Any] = [env.reset(seed=seed)]
    for _ in range(steps):
        seen.append(env.step(env.action_space.sample()))
        if seen[-1][2] or seen[-1][3]:
            seen.append(env.reset())
    return seen


def test_a_seed_fixes_everything(toy: Any) -> None:
    first, second = play(toy((3, 2)), 7), play(toy((3, 2)), 7)
    assert data_equivalence(first, second, exact=True)
    assert not data_equivalence(first, play(toy((3, 2)), 8), exact=True)


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_behaves_the_same(toy: Any, clone: Callable[[Any], Any]) -> None:
    env = toy()
    twin = clone(env)
    assert twin.spec == env.spec
    assert data_equivalence(play(env, 3), play(twin, 3), exact=True)


def test_nothing_returned_is_handed_out_twice(toy: Any) -> None:
    seen = [(s[0], s[-1]) for s in play(toy((3, 2)), 1)]
    for one, other in pairwise(seen):
        assert not data_shares_objects(one, other)


def test_infos_have_plain_types(toy: Any) -> None:
    env = toy()
    _, info = env.reset(seed=1)
    assert info["initial_state_certificate"] == "sampled"
    assert info["action_mask"].dtype == np.int8
    assert env.unwrapped.action_masks().dtype == np.bool_
    _, reward, terminated, truncated, info = env.step(1)
    assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
    assert {k: type(v) for k, v in info.items()} == {
        "status": str, "reason": str, "cost": int, "blocked": bool, "executed_action": int, "duration": float,
        "time": float, "postcondition": bool, "saturated": bool, "action_mask": np.ndarray,
    }  # fmt: skip


def test_the_end_of_an_episode_says_why(toy: Any) -> None:
    env = toy()
    env.reset(seed=1)
    while True:
        _, _, terminated, _, info = env.step(2)
        if terminated:
            break
        assert (info["status"], info["reason"], "is_success" in info) == ("none", "", False)
    assert (info["status"], info["reason"], info["is_success"]) == ("success", "goal", True)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(0)


def test_the_time_limit_truncates(toy: Any) -> None:
    env = toy().unwrapped.__class__(MODEL, max_episode_steps=3)
    env.reset(seed=1)
    steps = [env.step(0) for _ in range(3)]
    assert [(s[2], s[3]) for s in steps] == [(False, False), (False, False), (False, True)]
    assert (steps[-1][4]["reason"], steps[-1][4]["is_success"]) == ("time_limit", False)


def test_a_state_can_be_set_at_reset(toy: Any) -> None:
    env = toy()
    env.reset(seed=1, options={"state": {"x": 0.1, "k": 0.2}})
    assert env.unwrapped.state == {"x": 0.1, "k": 0.2}
    with pytest.raises(ResetFailed):
        env.reset(options={"state": {"x": 0.1, "k": 5.0}})
    with pytest.raises(ValueError, match="lacks k"):
        env.reset(options={"state": {"x": 0.1}})
    with pytest.raises(ValueError, match="no variable or constant `y`"):
        env.reset(options={"state": {"x": 0.1, "k": 0.2, "y": 1.0}})
    with pytest.warns(UserWarning, match="reset ignores the option `stat`; there is state"):
        env.reset(options={"stat": {}})


def test_the_spec_says_when_episodes_are_truncated(toy: Any) -> None:
    toy()
    register()
    for made in (gym.make("dl2c/Model-v0", model=MODEL), gym.make_vec("dl2c/Model-v0", 2, model=MODEL)):
        assert made.spec is not None and made.spec.max_episode_steps == 20
        again = pickle.loads(pickle.dumps(made))
        assert again.spec.max_episode_steps == 20
    cut = gym.make("dl2c/Model-v0", model=MODEL, max_episode_steps=3)
    assert cut.spec is not None and cut.spec.max_episode_steps == 3
    assert gym.spec("dl2c/Model-v0").max_episode_steps is None
    assert Dl2cEnv(MODEL).spec is None


def test_episodes_without_a_seed_differ_between_environments(toy: Any) -> None:
    assert not np.array_equal(toy().reset()[0], toy().reset()[0])


def test_closing_twice_is_fine(toy: Any) -> None:
    env = toy()
    env.close()
    env.close()


def test_the_state_is_rendered_as_text(toy: Any) -> None:
    env = toy(render_mode="ansi")
    env.reset(options={"state": {"x": 0.5, "k": 0.25}})
    assert env.render() == "time=0  x=0.5m  k=0.25"
    with pytest.raises(ValueError, match="no render mode"):
        toy(render_mode=None).unwrapped.__class__(MODEL, render_mode="rgb")
