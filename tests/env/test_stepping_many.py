"""The step of many environments: in C and in Python it returns the same, and keeps nothing."""

import gc
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from env.test_stepping import (
    MODELS,
    check_that_nothing_is_kept,
    counted,
    details,
    refuse,
    shared_objects,
    unchanged,
)

import dl2c
import dl2c.env.vector
import dl2c.native.binding
from dl2c.env.opening import open_library, source_of
from dl2c.env.stepping import python_infos, python_steps
from dl2c.env.vector import Dl2cVectorEnv
from dl2c.native.errors import BatchClosed, NativeError
from dl2c.native.stepping import Stepping, stepping

pytestmark = pytest.mark.usefixtures("unoptimised")

MODES = ("NextStep", "SameStep", "Disabled")

ALTERNATIVES = np.array([1, 0])
VALUES = np.array([[0.5], [-0.25]])
ODD_MANY: list[Any] = [
    *(ALTERNATIVES.astype(t) for t in ("b", "B", "h", "i", "I", "q", "Q", ">q", ">i", "?", "f", "d", "O")),
    *(VALUES.astype(t) for t in ("e", "f", "d", ">f", ">d", "g", "O", "q")),
    *(
        [-1, 0],
        [0, 4],
        [0, 2**32],
        [2**63 - 1, 0],
        [-(2**63), 1],
        [0.5, 1.0],
        [1],
        [1, 1, 1],
        [],
        1,
        None,
        "1",
    ),
    *(np.array(a) for a in ([-1, 0], [0, 4], [0, 2**32], [2**63 - 1, 0], [-(2**63), 0], [1], [[1], [0]], 1)),
    *(np.array([[a], [0.5]]) for a in (np.nan, np.inf, -np.inf, -0.0)),
    *(np.array([[np.nan], [0.5]], np.float32), np.ma.masked_array(VALUES), np.ma.masked_array(ALTERNATIVES)),
    *(np.array([1, 7, 0, 7])[::2], np.array([[0.5, 7], [0.25, 7]])[:, :1], np.broadcast_to(0.25, (2, 1))),
    *(np.frombuffer(bytes(17), np.float64, 2, 1).reshape(2, 1), np.frombuffer(bytes(17), np.int64, 2, 1)),
    *(np.array(a) for a in ([[0, 1], [1, 0]], [[0, 2], [1, 0]], [[0, -1], [1, 0]], [[2**32, 1], [1, 0]])),
    *(np.array([[0, 1], [1, 0]], order="F"), [(0, 1), (1, 0)], np.zeros((2, 2)), np.zeros((2, 2), np.int32)),
]


BATCH, WRITE, RETURNED = 1, 7, 11
"""Places of cgen/python/stepping.c."""


@pytest.fixture(scope="module", autouse=True)
def extension() -> Stepping:
    if (found := stepping()) is None:
        pytest.skip("there are no headers to build it with")
    return found


def many(name: str, num_envs: int, **more: Any) -> Dl2cVectorEnv:
    return dl2c.make_vec(MODELS[name][0], num_envs, **MODELS[name][1], **more)


def many_in_python(name: str, num_envs: int, **more: Any) -> Dl2cVectorEnv:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dl2c.env.vector, "steps_function", python_steps)
        return many(name, num_envs, **more)


def steps_of_many(env: Dl2cVectorEnv, steps: int) -> Iterator[Any]:
    """What random actions return. Starts no step of an episode that has ended."""
    env.action_space.seed(5)
    yield env.reset(seed=5)
    for _ in range(steps):
        yield (result := env.step(env.action_space.sample()))
        ended = result[2] | result[3]
        if env.metadata["autoreset_mode"].value == "Disabled" and ended.any():
            yield env.reset(options={"reset_mask": ended})


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", MODELS)
def test_both_forms_of_many_return_the_same_objects(name: str, mode: str) -> None:
    compiled, plain = (make(name, 5, autoreset_mode=mode) for make in (many, many_in_python))
    assert type(compiled._transition) is not type(plain._transition)
    endings = 0
    for left, right in zip(steps_of_many(compiled, 60), steps_of_many(plain, 60), strict=True):
        assert details((*left[:-1], dict(left[-1]))) == details((*right[:-1], dict(right[-1])))
        endings += len(left) > 2 and int((left[2] | left[3]).sum())
    assert endings > 5


def outcome_of_many(env: Dl2cVectorEnv, actions: Any) -> Any:
    """What a step returns or raises, in new episodes, and what the next one does."""
    env.reset(seed=3)
    try:
        *result, infos = env.step(actions)
        return details((*result, dict(infos)))
    except (ValueError, TypeError, OverflowError, AttributeError) as problem:
        env.action_space.seed(5)
        *result, infos = env.step(env.action_space.sample())
        return type(problem), str(problem), details((*result, dict(infos)))


@pytest.mark.parametrize("name", ["one choice", "choices", "runs", "inputs", "inputs and a solver", "names"])
def test_both_forms_of_many_take_and_refuse_the_same_actions(name: str) -> None:
    compiled, plain = many(name, 2), many_in_python(name, 2)
    for actions in ODD_MANY:
        assert outcome_of_many(compiled, actions) == outcome_of_many(plain, actions), actions


@pytest.mark.parametrize("name", ["one choice", "inputs"])
def test_steps_of_many_keep_nothing(name: str) -> None:
    env = many(name, 3)
    shared = shared_objects(env._transition)

    def go_on(steps: int) -> None:
        for k, _ in enumerate(steps_of_many(env, steps)):
            if k % 50 == 49:
                with pytest.raises(ValueError, match="action"):
                    env.step(np.array([[np.nan]] * 3) if name == "inputs" else np.array([7, 0, 0]))

    check_that_nothing_is_kept(go_on, 10_000, shared)


def test_both_forms_step_a_batch_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    library = open_library(source_of("example:waypoint"), {})
    batches = [library.batch(3, autoreset="same_step") for _ in range(2)]
    rng = np.random.default_rng(7)
    for batch, found in zip(batches, (stepping(), None), strict=True):
        batch.reset(seeds=np.arange(3, dtype=np.uint64))
        monkeypatch.setattr(dl2c.native.binding, "stepping", lambda found=found: found)
        batch.step()
    for _ in range(200):
        choices = rng.integers(0, 2, batches[0].choices.shape)
        for batch in batches:
            batch.choices[:] = choices
            batch.step()
        assert all(np.array_equal(*pair) for pair in zip(*(b.arrays() for b in batches), strict=True))
    for batch in batches:
        batch.close()
        with pytest.raises(BatchClosed):
            batch.step()


def test_steps_of_a_batch_keep_nothing(extension: Stepping) -> None:
    env = many("one choice", 3)
    env.reset(seed=1)
    batch = env.batch
    step = batch.step_in_c("batch", None, True)
    broken = list(step.__self__)  # pyright: ignore[reportFunctionMemberAccess]
    broken[BATCH] = 0
    refused = extension.batch(tuple(broken))

    def go_on(steps: int) -> None:
        for k in range(steps):
            assert step is not None and step() is None
            if k % 50 == 49:
                with pytest.raises(NativeError):
                    refused()

    check_that_nothing_is_kept(go_on, 10_000, shared_objects(step))


def parts_of(env: Dl2cVectorEnv) -> list[Any]:
    return list(env._transition.__self__)  # pyright: ignore[reportFunctionMemberAccess]


@pytest.mark.parametrize("name", ["one choice", "choices", "inputs", "inputs and a solver"])
def test_plain_actions_are_read_in_c(name: str, extension: Stepping) -> None:
    env = many(name, 3)
    env.reset(seed=1)
    parts = parts_of(env)
    parts[WRITE] = refuse
    step = extension.many(tuple(parts))
    step(env.action_space.sample())
    with pytest.raises(OSError, match="refused"):
        step(env.action_space.sample().tolist())


@pytest.mark.parametrize("part", [BATCH, RETURNED])
def test_an_error_in_any_part_passes_through(part: int, extension: Stepping) -> None:
    """No batch; something to be copied that cannot be."""
    env = many("one choice", 3)
    env.reset(seed=1)
    parts = parts_of(env)
    parts[part] = 0 if part == BATCH else (parts[part][0], refuse)
    step, shared = extension.many(tuple(parts)), shared_objects(env._transition)
    before = counted(shared)
    for _ in range(50):
        with pytest.raises((NativeError, OSError)):
            step(np.array([0, 0, 0]))
    assert unchanged(before, counted(shared))
    env.step(np.array([0, 0, 0]))


def test_closed_environments_are_not_stepped() -> None:
    env = many("one choice", 3)
    env.reset(seed=1)
    env.close()
    with pytest.raises(BatchClosed):
        env.step(np.array([0, 0, 0]))


# Infos of many ----------------------------------------------------------------


def columns_of(n: int) -> dict[str, Any]:
    """Rows, numbers of all types that results have, and names."""
    codes = np.arange(n, dtype=np.int32) % 3
    return {
        "rows": np.arange(4.0 * n).reshape(n, 2, 2).astype(np.float32),
        "time": 0.5 * np.arange(n),
        "code": codes - 1,
        "flag": codes == 1,
        "status": (codes, ("none", "success", "failure")),
        "reason": (codes, {0: "", 1: "far", 2: "late"}),
    }


@pytest.mark.parametrize("n", [0, 1, 5, 700])
@pytest.mark.parametrize("every", [1, 2, 1000])
def test_both_forms_make_the_same_infos(n: int, every: int, extension: Stepping) -> None:
    told, columns = np.arange(n) % every == every - 1, columns_of(n)
    compiled, plain = (make(told, columns) for make in (extension.infos, python_infos))
    assert details(compiled) == details(plain)
    assert len({id(info) for info in compiled}) == n
    assert gc.isenabled()


def test_infos_are_of_their_own_step(extension: Stepping) -> None:
    columns = columns_of(3)
    for make in (extension.infos, python_infos):
        infos = make(np.array([True, False, True]), columns)
        before = details(infos)
        columns["rows"][:] += 1
        assert details(infos) == before and infos[0]["rows"].flags.writeable


def test_infos_without_collection_of_garbage(extension: Stepping) -> None:
    gc.disable()
    try:
        assert extension.infos(np.zeros(3, np.bool_), {}) == [{}, {}, {}] and not gc.isenabled()
    finally:
        gc.enable()


def test_infos_keep_nothing_and_refuse_what_is_none(extension: Stepping) -> None:
    told, columns = np.array([True, True]), columns_of(2)
    shared = [told, columns, *columns.values(), columns["reason"][1]]
    codes = columns["code"]
    arrays = [np.zeros(3), np.zeros(()), np.zeros((2, 2)).T, np.zeros(4)[::2], np.array([None, None])]
    named = [(codes,), (columns["time"], {}, {}), ([0, 1], {}), (codes, {}), (codes, 1)]
    flags = [[True, True], told.astype(np.int8), np.array([True]), np.array([True] * 4)[::2]]
    unfit: list[tuple[Any, ...]] = [(told, {"time": column}) for column in (*arrays, *named, [1.5, 2.5])]
    unfit += [(t, columns) for t in flags]
    unfit += [(told, []), (told,), (None, columns)]
    before = counted(shared)
    for _ in range(50):
        extension.infos(told, columns)
        for given in unfit:
            with pytest.raises((LookupError, TypeError)):
                extension.infos(*given)
    assert gc.isenabled() and unchanged(before, counted(shared))


@pytest.mark.parametrize("name", MODELS)
def test_both_forms_of_vec_env_return_the_same(name: str) -> None:
    compiled = dl2c.make_sb3(MODELS[name][0], 5, **MODELS[name][1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dl2c.env.sb3, "steps_function", python_steps)
        patch.setattr(dl2c.env.sb3, "infos_function", lambda: python_infos)
        plain = dl2c.make_sb3(MODELS[name][0], 5, **MODELS[name][1])
    endings = 0
    for env in (compiled, plain):
        env.seed(3)
    assert details(compiled.reset()) == details(plain.reset())
    compiled.action_space.seed(5)
    for _ in range(60):
        actions = np.stack([compiled.action_space.sample() for _ in range(5)])
        left, right = compiled.step(actions), plain.step(actions)
        assert details(left) == details(right)
        endings += int(left[2].sum())
    assert endings > 5
