"""The step of a single environment: in C and in Python it returns the same, fresh, and keeps nothing."""

import gc
import sys
import tracemalloc
import weakref
from collections import OrderedDict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from generators.kyx_builder import model_text
from gymnasium.error import ResetNeeded
from selection import few_and_many

import dl2c
import dl2c.env.single
import dl2c.native.stepping
from dl2c.code import cgen_dir
from dl2c.env.single import Dl2cEnv
from dl2c.env.stepping import python_step
from dl2c.native.cache import cache_entries
from dl2c.native.errors import NativeError
from dl2c.native.stepping import stepping
from dl2c.native.toolchain import STRICT_FLAGS, find_compiler, python_include, run

pytestmark = pytest.mark.usefixtures("unoptimised")

WALK = model_text(
    "x = 0 & w = 0 & t = 0 -> [{w := *; {x := x + 1; ++ ?x > 0; x := x - 1;} {t := 0; ++ t := 0.5;}"
    " {x' = w, t' = 1 & t <= 1}}*] x < 5",
    """/* @safety: on_failure=terminate:failure */ Bool near(Real x) <-> x < 5;
    /* @stability: reward={x} */ Bool low(Real x) <-> x < 3;""",
    """/* @var: bound=[-9:9] */ Real x;
    /* @var: bound=[-1:1], role=env */ Real w;
    /* @var: bound=[0:9] */ Real t;""",
)

MODELS: dict[str, tuple[str, dict[str, Any]]] = {
    "one choice": ("example:waypoint", {}),
    "blocked steps end": ("example:waypoint", {"on_blocked": "truncate", "obs_dtype": "float64"}),
    "inputs and a solver": ("example:pendulum", {"max_episode_steps": 20}),
    "inputs": ("example:watertank", {"obs_dtype": "float64", "max_episode_steps": 20}),
    "names": ("example:acc", {"max_episode_steps": 20}),
    "the environment decides": ("example:etcs", {"max_episode_steps": 20}),
    "nothing to decide": ("example:forced_acceleration", {}),
    "choices": (WALK, {"max_episode_steps": 9}),
    "runs": (WALK, {"max_episode_steps": 9, "action_format": "discrete"}),
}

ODD_ACTIONS: list[Any] = [
    *(-1, 4, 10**30, 1.0, None, "1", [1], True, np.True_, np.int8(1), np.uint64(2**63), np.float64(1)),
    *(np.array(1), np.array([1]), np.array([1, 2]), np.array(1.0), np.nan),
    *(np.array([0.5], t) for t in ("f", "d", "e", ">f", ">d", "g", "O")),
    *(np.array(a) for a in ([np.nan], [np.inf], [-np.inf], [-0.0], [[0.5]], [0.5, 0.5], [])),
    *(np.array([0.5, 0.2, 0.7])[k::-2] for k in (0, 1, 2)),
    *(np.frombuffer(bytes(9), np.float64, 1, 1), np.broadcast_to(0.25, (1,))),
    *(np.ma.masked_array([0.5]), np.float32(0.5), [0.5], (0.5,), 0.5),
]

ODD_ACTIONS += [{"assign_a": a, "choice_0": 1} for a in ODD_ACTIONS]
ODD_ACTIONS += [{"choice_0": a, "assign_a": np.array([0.25], np.float32)} for a in ODD_ACTIONS[:50]]
ODD_ACTIONS += [{}, {"choice_0": 1}, OrderedDict(choice_0=1, assign_a=np.array([0.5])), [("choice_0", 1)]]
ODD_ACTIONS += [{"choice_0": 1, "assign_a": np.array([0.5]), "more": 1}, {"choice_0": 1, "more": 1}]

PARTS = {"BATCH": 1, "ENDED": 15, "OBSERVE": 16, "INFO": 18, "STATUSES": 19, "REASONS": 20, "SOURCES": 21}
"""Places of cgen/python/stepping.c."""


@pytest.fixture(scope="module", autouse=True)
def headers() -> None:
    if stepping() is None:
        pytest.skip("there are no headers to build it with")


def in_python(model: str, options: dict[str, Any]) -> Dl2cEnv:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dl2c.env.single, "step_function", python_step)
        return dl2c.make(model, **options)


def details(value: Any) -> Any:
    """All that can be told of a result: types, bits, the order of keys, how arrays lie in memory."""
    match value:
        case dict():
            return dict, [(key, details(v)) for key, v in value.items()]
        case tuple():
            return tuple, [details(v) for v in value]
        case list():
            return [details(v) for v in cast("list[Any]", value)]
        case np.ndarray() if value.dtype == object:
            return details(value.tolist())
        case np.ndarray():
            return (
                value.dtype,
                value.shape,
                value.strides,
                str(value.flags),
                value.base is None,
                value.tobytes(),
            )
        case float():
            return float, value.hex()
        case _:
            return type(value), value


def episodes(env: Dl2cEnv, steps: int) -> Iterator[Any]:
    """What random episodes return. Starts no step of an episode that has ended."""
    env.action_space.seed(5)
    yield env.reset(seed=5)
    for _ in range(steps):
        yield (result := env.step(env.action_space.sample()))
        if result[2] or result[3]:
            yield env.reset()


def outcome(env: Dl2cEnv, action: Any) -> Any:
    """What a step returns or raises, in a new episode."""
    env.reset(seed=3)
    try:
        return details(env.step(action)), details(env.state)
    except (ValueError, TypeError, OverflowError, ResetNeeded) as problem:
        return type(problem), str(problem)


@pytest.mark.parametrize("name", MODELS)
def test_both_forms_return_the_same_objects(name: str) -> None:
    compiled, plain = dl2c.make(MODELS[name][0], **MODELS[name][1]), in_python(*MODELS[name])
    assert type(compiled._transition) is not type(plain._transition)
    endings = 0
    for left, right in zip(episodes(compiled, 300), episodes(plain, 300), strict=True):
        assert details(left) == details(right)
        endings += "is_success" in left[-1]
    assert endings > 5


@pytest.mark.parametrize("name", ["one choice", "choices", "runs", "inputs", "inputs and a solver", "names"])
def test_both_forms_take_and_refuse_the_same_actions(name: str) -> None:
    compiled, plain = dl2c.make(MODELS[name][0], **MODELS[name][1]), in_python(*MODELS[name])
    for action in ODD_ACTIONS:
        assert outcome(compiled, action) == outcome(plain, action), action


def test_a_step_writes_into_nothing_that_was_returned() -> None:
    env = dl2c.make("example:waypoint")
    results = list(episodes(env, 50))
    told = [details(result) for result in results]
    for _ in episodes(env, 50):
        pass
    assert [details(result) for result in results] == told
    arrays = [a for result in results for a in (result[0], result[-1]["action_mask"])]
    assert not any(np.shares_memory(a, b) for i, a in enumerate(arrays) for b in arrays[:i])


def shared_objects(step: Any) -> list[Any]:
    """What all steps use, but for singletons."""
    found: list[Any] = []
    for part in step.__self__:
        found += [part, *(part if isinstance(part, tuple) else [])]
        found += [*part, *part.values()] if isinstance(part, dict) else []
    return [x for x in found if not isinstance(x, bool | int | float | None)]


def counted(objects: list[Any]) -> list[int]:
    gc.collect()
    return [sys.getrefcount(x) for x in objects]


def unchanged(before: list[int], after: list[int]) -> bool:
    """But for what others do with the same strings meanwhile; a leak would be one in each step or episode."""
    return all(abs(a - b) < 10 for a, b in zip(after, before, strict=True))


def check_that_nothing_is_kept(go_on: Callable[[int], None], count: int, shared: list[Any]) -> None:
    """Neither memory nor references to shared objects, by so many steps."""
    go_on(1000)
    before = counted(shared)
    tracemalloc.start()
    try:
        go_on(1000)
        gc.collect()
        memory = tracemalloc.get_traced_memory()[0]
        go_on(count)
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - memory < 20_000
    finally:
        tracemalloc.stop()
    assert unchanged(before, counted(shared))


@pytest.mark.parametrize("count", few_and_many(10_000, 100_000))
def test_steps_keep_nothing(count: int) -> None:
    """Neither those that succeed nor those that are refused."""
    env = dl2c.make("example:waypoint")
    shared = shared_objects(env._transition)

    def go_on(steps: int) -> None:
        for k, _ in enumerate(episodes(env, steps)):
            if k % 50 == 49:
                with pytest.raises((ValueError, ResetNeeded)):
                    env.step(7)

    check_that_nothing_is_kept(go_on, count, shared)


def refuse(*_: Any) -> Any:
    raise OSError("refused")


BROKEN: dict[str, Any] = {
    "BATCH": 0,
    "OBSERVE": refuse,
    "INFO": None,
    "STATUSES": (),
    "REASONS": {},
    "SOURCES": ("executed_action", refuse),
    "ENDED": refuse,
}


@pytest.fixture(scope="module")
def waypoint() -> Dl2cEnv:
    return dl2c.make("example:waypoint")


@pytest.mark.parametrize("part", BROKEN)
def test_an_error_in_any_part_passes_through(part: str, waypoint: Dl2cEnv) -> None:
    env = waypoint
    extension = stepping()
    assert extension is not None
    parts = list(env._transition.__self__)  # pyright: ignore[reportFunctionMemberAccess]
    parts[PARTS[part]] = BROKEN[part]
    step, shared = extension.one(tuple(parts)), shared_objects(env._transition)
    before, raised = counted(shared), 0
    for _ in range(20):
        env.reset(seed=1)
        for _ in range(50):
            try:
                if step(0)[2]:
                    break
            except (NativeError, OSError, IndexError, KeyError, SystemError):
                raised += 1
    assert raised >= 20 and unchanged(before, counted(shared))


def test_a_step_is_made_of_all_its_parts() -> None:
    extension = stepping()
    assert extension is not None
    unfit: list[Any] = [(), [], None, *((part,) * size for part in ((), []) for size in (12, 22))]
    for parts in unfit:
        for make in (extension.one, extension.many, extension.batch):
            with pytest.raises(TypeError, match="parts"):
                make(parts)


def test_an_environment_that_nobody_has_goes() -> None:
    env = dl2c.make("example:waypoint")
    env.reset(seed=1)
    env.step(0)
    gone = weakref.ref(env)
    del env
    gc.collect()
    assert gone() is None


def test_without_headers_steps_are_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dl2c.native.stepping, "python_include", lambda: ())
    env = dl2c.make("example:waypoint")
    assert env._transition.__module__ == "dl2c.env.stepping"
    env.reset(seed=1)
    assert env.step(0)[4]["executed_action"] in range(4)
    assert dl2c.make_vec("example:waypoint", 2)._transition.__module__ == "dl2c.env.stepping"


def test_what_no_compiler_takes_is_done_in_python(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("CFLAGS", "-fno-such-thing")
    with caplog.at_level("INFO", "dl2c"):
        assert stepping() is None
    assert "stepped in Python" in caplog.text and cache_entries() == ()


def test_it_is_built_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path))
    first = stepping()
    monkeypatch.setattr(dl2c.native.stepping, "run", refuse)
    assert stepping() is first is not None
    assert len(cache_entries()) == 1


def test_it_compiles_without_warnings(tmp_path: Path) -> None:
    """But for those of numpy's macros, which are not pedantic."""
    flags = [flag for flag in STRICT_FLAGS if flag != "-Wpedantic"]
    include = (*python_include(), f"-I{np.get_include()}", f"-I{cgen_dir() / 'include'}")
    command = (*find_compiler().command, "-std=c11", "-fsyntax-only", *flags, *include)
    run((*command, str(cgen_dir() / "python" / "stepping.c")), tmp_path)
