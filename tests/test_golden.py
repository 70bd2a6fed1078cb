"""Every stage of the compiler as text, and that the models of tests/good run."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import dl2c
from dl2c.configuration import resolve_options
from dl2c.pipeline import check_model, emit
from dl2c.source import Source

HERE = Path(__file__).parent
GOLDEN = HERE / "golden"
WAYPOINT = HERE.parent / "examples" / "waypoint.kyx"
GOOD = sorted((HERE / "good").glob("*.kyx"))
SUFFIX = {"tree": "kyx", "expanded": "txt", "ir": "txt", "paths": "txt", "c": "c"}
WANTED = [
    *((WAYPOINT, stage) for stage in SUFFIX),
    *(
        (path, stage)
        for path in GOOD
        if path.stem in ("tank", "lift", "walk")
        for stage in ("ir", "paths", "c")
    ),
]


def source(path: Path) -> Source:
    return Source(path.name, path.read_text(encoding="utf-8"))


@pytest.mark.parametrize(("path", "stage"), WANTED, ids=lambda part: getattr(part, "stem", part))
def test_stages_read_as_before(path: Path, stage: str, golden: Callable[[Path, str], None]) -> None:
    """After a change that is meant, write them with `--update-golden` and read the difference."""
    golden(GOLDEN / stage / f"{path.stem}.{SUFFIX[stage]}", emit(source(path), stage, resolve_options({})))


@pytest.mark.parametrize("path", [WAYPOINT, *GOOD], ids=lambda path: path.stem)
def test_good_models_have_no_warnings(path: Path) -> None:
    assert check_model(source(path), resolve_options({})) == ()


@pytest.mark.usefixtures("unoptimised")
@pytest.mark.parametrize("path", [WAYPOINT, *GOOD], ids=lambda path: path.stem)
def test_good_models_run(path: Path) -> None:
    """Fifty random steps: observations lie in their space, rewards are numbers."""
    env = dl2c.make(path)
    env.action_space.seed(0)
    observation, info = env.reset(seed=0)
    for step in range(50):
        assert env.observation_space.contains(observation)
        assert all(np.isfinite(value) for value in env.state.values())
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert np.isfinite(reward)
        if terminated or truncated:
            assert info["reason"]
            observation, info = env.reset(seed=step)
