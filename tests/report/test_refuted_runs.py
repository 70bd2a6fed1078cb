"""Runs that refute a theorem, followed by the environment and saved: `dl2c verify -o`, then `dl2c replay`."""

import json
from pathlib import Path
from typing import Any

import pytest
from commands.test_cli import run
from selection import quick_among
from slowness import slowness

pytestmark = pytest.mark.usefixtures("unoptimised")

MODEL = """Theorem "moving"
ProgramVariables
  /* @var: bound=[-50:50] */
  Real x;
  /* @var: bound=[-5:5] */
  Real v;
  /* @var: bound=[0:9] */
  Real t;{unlimited}
End.
Problem
  {problem}
End.
End.
"""

FOLLOWED = {
    "one choice after the other": "x = 0 -> [{{?x = 0; x := 2; ++ ?x = 2; x := 7;}}*] x <= 5",
    "a value": "x = 0 -> [{v := *; ?0 <= v & v <= 5; x := x + v;}*] x <= 7",
    "the whole duration": "x = 0 & v = 1 & t = 0 -> [{t := 0; {x' = v, t' = 1 & t <= 4}}*] x <= 3",
    "a duration": "x = 0 & v = 1 & t = 0 -> [{t := 0; {x' = v, t' = 1 & t <= 4}}*] (x <= 2 | x >= 3)",
    "without a clock": "x = 0 & v = 1 -> [{{x' = v}}*] (x <= 2 | x >= 3)",
    "two motions": "x = 0 & v = 0 -> [{{x' = 1 & x <= 4} {v' = 1 & v <= 3}}*] (x <= 1 | x >= 2 | v <= 1)",
    "at once": "x <= 1 & v = 0 -> [{v := 1; {x' = v*x + v, v' = v}}*] x <= 1",
    "without a loop": "x = 0 & v = 1 -> [{{x' = v & x <= 3} ++ x := 1;}] x <= 2",
}


QUICK = ("one choice after the other", "without a loop")


def words(path: Path, episode: Path) -> tuple[str, ...]:
    """`dl2c verify`, with as many seconds as it needs just now."""
    slow = slowness()
    return ("verify", str(path), "--timeout", str(10 * slow), "--total", str(20 * slow), "-o", str(episode))


def model(folder: Path, problem: str) -> Path:
    path = folder / "model.kyx"
    unlimited = "\n  Real w;" if "w" in problem else ""
    path.write_text(MODEL.replace("{unlimited}", unlimited).replace("{problem}", problem))
    return path


@pytest.mark.parametrize("name", quick_among(FOLLOWED, QUICK))
def test_a_run_is_saved_and_replayed(name: str, capsys: Any, tmp_path: Path) -> None:
    episode = tmp_path / "new" / "run.json"
    code, out, err = run(capsys, *words(model(tmp_path, FOLLOWED[name]), episode))
    assert (code, err) == (1, "") and out.endswith(f"replay it with `dl2c replay {episode}`\n"), out
    code, out, _ = run(capsys, "replay", str(episode))
    assert code == 0 and "the postcondition fails in step" in out and "bit for bit" in out


NOT_FOLLOWED = {
    "before the first step": (
        "x >= 0 & v >= 0 -> [{x := x + 1;}*] x >= 1",
        "the run ends before the first step",
    ),
    "less than rounding": (
        "x = 1 -> [{x := x + 1/10^20; ++ x := 0;}] x <= 1",
        "no action of step 1 violates the postcondition",
    ),
    "beyond the bounds": ("x >= 60 -> [{x := 0 - x;}*] x >= 0", ""),
    "no environment": ("x = 0 & w >= 0 -> [{x := x + 10;}*] x <= w", "w"),
}


@pytest.mark.parametrize("name", quick_among(NOT_FOLLOWED, NOT_FOLLOWED.keys() - {"less than rounding"}))
def test_what_the_environment_cannot_follow_is_not_saved(name: str, capsys: Any, tmp_path: Path) -> None:
    problem, reason = NOT_FOLLOWED[name]
    episode = tmp_path / "run.json"
    code, out, err = run(capsys, *words(model(tmp_path, problem), episode))
    assert (code, err) == (1, "") and "Traceback" not in out
    assert f"{episode} is not written: the environment cannot follow this run: " in out and reason in out
    assert not episode.exists()


def test_what_is_proved_has_no_run(capsys: Any, tmp_path: Path) -> None:
    path, episode = model(tmp_path, "x >= 0 -> [{x := x + 1;}*] x >= 0"), tmp_path / "run.json"
    code, out, _ = run(capsys, "verify", str(path), "-o", str(episode), "--json")
    found = json.loads(out)
    assert (code, found["episode"], found["not_saved"]) == (0, None, "no run refutes the theorem")
    assert not episode.exists()
