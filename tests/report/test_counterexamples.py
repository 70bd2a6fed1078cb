"""Violations are found, made small, written down, and replayed to the last bit."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from selection import quick_among
from typer.testing import CliRunner

import dl2c
from dl2c.cli import app
from dl2c.configuration import resolve_options
from dl2c.env.opening import source_of
from dl2c.ir.evaluate import truth
from dl2c.ir.model import Symbol
from dl2c.pipeline import Compilation
from dl2c.report.blame import blamed, model_of
from dl2c.report.episode import (
    Episode,
    EpisodeError,
    Start,
    difference,
    play,
    read_episode,
    replay,
    write_episode,
)
from dl2c.report.falsify import Falsified, NothingToFalsify, falsify
from dl2c.report.recording import Recorder, failures_to
from dl2c.report.search import propose, search
from dl2c.report.shrink import simpler

pytestmark = pytest.mark.usefixtures("unoptimised")

HERE = Path(__file__).parents[1]
WALK = HERE / "good" / "walk.kyx"
TANK = HERE / "broken" / "watertank.kyx"
BUDGET: dict[str, Any] = {"episodes": 1000, "steps": 100}
"""Episodes and steps in which every broken model is falsified, and no proved one."""

VIOLATED = {"waypoint": "xr + stopDist(vr) < areaEnd(xg)", "watertank": "l <= m", "acc": "d > 0"}
"""What the broken models violate, as their texts have it."""

NAMES = quick_among(VIOLATED, {"watertank"})


@cache
def found_in(name: str) -> tuple[Episode, Falsified]:
    found = falsify(HERE / "broken" / f"{name}.kyx", **BUDGET)
    assert found.episode is not None
    return found.episode, found


@pytest.mark.parametrize("name", NAMES)
def test_a_broken_model_is_falsified(name: str, tmp_path: Path) -> None:
    episode, found = found_in(name)
    assert episode.failed and len(episode.moments) <= found.steps
    assert any(VIOLATED[name] in d.span.text for d in found.conditions)
    assert found.conditions[0].span.source.text == episode.source.text
    write_episode(episode, tmp_path / "found.json")
    again = read_episode(tmp_path / "found.json")
    assert (
        again == replace(episode, options=again.options, start=again.start) and again.start == episode.start
    )
    assert difference(again, replay(again)) == ""


@pytest.mark.parametrize("name", NAMES)
def test_the_worst_violation_is_none_of_rounding(name: str) -> None:
    """A step ends where its violation begins, so the counterexample itself fails by a hair."""
    _, found = found_in(name)
    assert any(VIOLATED[name] in d.span.text for d in found.worst)
    left, right = (float(side) for side in re.findall(r"-?[\d.]+(?:e[+-]\d+)?", found.worst[0].label)[:2])
    assert abs(left - right) > 1e-3


@pytest.mark.parametrize("name", NAMES)
def test_a_counterexample_starts_where_the_precondition_admits(name: str) -> None:
    episode, _ = found_in(name)
    model = Compilation(episode.source, resolve_options(episode.options)).lowered.drawn
    env = {Symbol(v.name, "variable"): episode.initial[v.name] for v in model.variables}
    env |= {Symbol(c.name, "constant"): episode.initial[c.name] for c in model.constants}
    if not model.lead:
        assert truth(model.precondition, env)
    for item in (*model.variables, *model.constants):
        if item.name in model.sampled:
            low, high = item.bound.low, item.bound.high
            assert (low is None or low <= episode.initial[item.name]) and (
                high is None or episode.initial[item.name] <= high
            )


@pytest.mark.parametrize("name", NAMES)
def test_a_proved_model_is_not_falsified(name: str) -> None:
    assert falsify(f"example:{name}", **BUDGET) == Falsified(None, (), 1000)


def test_a_search_follows_from_its_seed() -> None:
    first, second, other = (falsify(TANK, seed=s, **BUDGET).episode for s in (1, 1, 2))
    assert first == second != other


def test_shrinking_leaves_what_is_needed() -> None:
    """One step suffices to fill the tank, from a full one."""
    episode, _ = found_in("watertank")
    assert len(episode.moments) == 1
    assert max(len(repr(v)) for v in episode.initial.values()) <= 8


def test_a_counterexample_holds_no_more_once_the_model_is_mended() -> None:
    episode, _ = found_in("watertank")
    mended = source_of("example:watertank")
    assert not replay(episode, mended).failed
    assert difference(episode, replay(episode, mended))


def test_what_is_to_be_violated_must_exist() -> None:
    with pytest.raises(NothingToFalsify, match="safety"):
        falsify(UNSAFE, **BUDGET)


UNSAFE = """Theorem "Walk without limits"
ProgramVariables
  /* @var: bound=[0:1] */
  Real x;
End.
Definitions
  /* @stability: shape={-y} */
  Bool low(Real y) <-> y <= 5;
End.
Problem
  low(x) -> [{ { x := x + 1; ++ x := x; } }*] x >= 0
End.
End.
"""


NEEDLE = """Theorem "Needle"
ProgramVariables
  /* @var: bound=[0:100], def="how far the inputs have been off" */
  Real off;
  /* @var: bound=[0:8], def="steps" */
  Real n;
  /* @var: bound=[-1:1], def="input" */
  Real u;
End.
Definitions
  /* @safety: penalty=-1, on_failure=terminate:failure */
  Bool missed(Real n, Real off) <-> (n <= 7 | off > 0.03);
End.
/* @episode: max_steps=8 */
Problem
  off = 0 & n = 0 -> [{ u := *; ?-1 <= u & u <= 1; off := off + (u - 0.37)^2; n := n + 1; }*] n >= 0
End.
End.
"""


def test_the_search_learns_where_violations_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight inputs within some 0.06 of one number: chance alone finds that once in 10^8 episodes."""
    assert search(NEEDLE, episodes=4000, seed=1).episode is not None
    monkeypatch.setattr("dl2c.report.search.FRESH", 1.0)
    assert search(NEEDLE, episodes=4000, seed=1).episode is None


def test_names_without_bounds_are_searched_too() -> None:
    """Only the assumptions limit `off`: the search moves it as far as the best attempts differ in it."""
    text = NEEDLE.replace("off = 0 & n = 0", "off <= 1 & off >= 0 & n = 0")
    text = text.replace('/* @var: bound=[0:100], def="how far the inputs have been off" */', "")
    assert search(text, episodes=500, seed=1).episodes == 500


@given(st.floats(-1e6, 1e6))
def test_simpler_numbers_are_shorter(number: float) -> None:
    def length(x: float) -> int:
        return len(f"{x!r}".removesuffix(".0").lstrip("-0"))

    assert all(length(s) < length(number) for s in simpler(number))


def test_blocked_and_drawn_decisions_are_replayed() -> None:
    """A program before the loop, decisions of the environment, and several episodes of one seed."""
    seen: list[Episode] = []
    env = Recorder(dl2c.make(WALK), seen.append)
    env.action_space.seed(3)
    for _ in range(6):
        env.reset()
        while not (ended := env.step(env.action_space.sample()))[2] and not ended[3]:
            pass
    env.close()
    assert [e.start.number for e in seen] == list(range(6))
    assert len({e.start.seed for e in seen}) == 1
    for episode in seen:
        assert difference(episode, replay(episode)) == ""


def test_a_replay_finds_the_first_bit_that_differs() -> None:
    env = dl2c.make(TANK)
    episode = play(env, Start(5), [[0.4]] * 4)
    moments = list(episode.moments)
    changed = dict(moments[2].state)
    changed["l"] = np.nextafter(changed["l"], 9)
    moments[2] = replace(moments[2], state=changed)
    assert difference(replace(episode, moments=tuple(moments)), replay(episode)).startswith(
        "step 3 differs: l is"
    )
    assert difference(replace(episode, reason="other"), replay(episode)).startswith("the end differs")


def test_the_condition_is_located(tmp_path: Path) -> None:
    env = Recorder(dl2c.make(TANK), failures_to(tmp_path))
    env.reset(seed=1, options={"state": {"l": 5, "goal": 1, "u": 0, "t": 0, "U": 0.6, "q": 0.05}})
    ended = env.step([0.6])
    assert ended[4]["reason"] == "inTank"
    (file,) = tmp_path.iterdir()
    episode = read_episode(file)
    (condition,) = blamed(episode, model_of(episode))
    assert condition.span.text == "l <= m"
    assert "is false" in condition.label and "l = 5.0" in condition.notes[1]


@pytest.mark.parametrize(
    "change",
    [
        {"format": "other"},
        {"format_version": 2},
        {"steps": [{}]},
        {"steps": [{"action": "x"}]},
        {"steps": 3},
        {"initial": [1]},
        {"initial": {"l": "many"}},
        {"model": {"name": "m", "text": "m", "sha256": "0"}},
        {"model": 7},
        {"start": {"seed": -1, "number": 0, "state": None}},
        {"options": []},
    ],
)
def test_what_is_no_episode_is_refused(change: dict[str, Any], tmp_path: Path) -> None:
    env = dl2c.make(TANK)
    write_episode(play(env, Start(5), [[0.4]]), tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    (tmp_path / "a.json").write_text(json.dumps(content | change), encoding="utf-8")
    with pytest.raises(EpisodeError, match=r"a\.json is not an episode"):
        read_episode(tmp_path / "a.json")
    shown = CliRunner().invoke(app, ["replay", str(tmp_path / "a.json")])
    assert shown.exit_code == 1


@pytest.mark.parametrize("content", [b"", b"\xff", b"[]", b"null", b"[" * 100_000])
def test_files_that_are_none_are_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(EpisodeError):
        read_episode(tmp_path / "a.json")


def test_falsify_and_replay_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tank.kyx").write_text(TANK.read_text(encoding="utf-8"), encoding="utf-8")
    run = CliRunner().invoke
    small = ["--episodes", "250", "--steps", "20"]
    found = run(app, ["falsify", "tank.kyx", *small, "--json"])
    told = json.loads(found.stdout)
    assert found.exit_code == 1 and told["found"] and told["conditions"][0]["file"] == "tank.kyx"
    replayed = run(app, ["replay", told["file"]])
    assert replayed.exit_code == 0
    assert "bit for bit" in replayed.stdout and "tank.kyx:" in replayed.stdout and "^" in replayed.stdout
    assert run(app, ["falsify", "example:watertank", *small]).exit_code == 0
    mended = run(app, ["replay", told["file"], "--model", "example:watertank"])
    assert mended.exit_code == 1 and "another model" in mended.stdout
    Path("tank.kyx").write_text("changed", encoding="utf-8")
    assert "has changed since" in run(app, ["replay", told["file"]]).stdout


def test_rollout_saves_failures(tmp_path: Path) -> None:
    arguments = ["rollout", str(TANK), "--episodes", "5", "--save-failures", str(tmp_path)]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    files = sorted(tmp_path.iterdir())
    assert files
    for file in files:
        episode = read_episode(file)
        assert episode.failed and difference(episode, replay(episode)) == ""


def test_proposals_stay_within_limits() -> None:
    from dl2c.env.vector import Dl2cVectorEnv
    from dl2c.report.search import _space  # pyright: ignore[reportPrivateUsage]

    source = source_of(TANK)
    env = Dl2cVectorEnv(source, 2, autoreset_mode="Disabled", action_format="auto")
    space = _space(env, Compilation(source, resolve_options({})).lowered.drawn, 50)
    attempts = propose(space, 64, None, np.random.default_rng(0))
    assert ((space.low <= attempts.inputs) & (attempts.inputs <= space.high)).all()
    exact = np.isin(attempts.inputs, [*space.low, *space.high])
    assert (exact | (attempts.inputs == attempts.inputs.astype(np.float32))).all()
