"""Episodes recorded while many are played at once are those of single environments, to the last bit."""

from pathlib import Path

import numpy as np
import pytest
from selection import quick_among

from dl2c.report.episode import difference, replay
from dl2c.report.pictures import episodes_of
from dl2c.report.recording import Recording
from dl2c.training.evaluation import evaluate, outcomes

pytestmark = pytest.mark.usefixtures("unoptimised")

HERE = Path(__file__).parents[1]
PLAYED = {
    "walk": (str(HERE / "good" / "walk.kyx"), True),
    "unmasked": (str(HERE / "good" / "walk.kyx"), False),
    "broken": (str(HERE / "broken" / "watertank.kyx"), False),
    "bouncing_ball": ("example:bouncing_ball", True),
    "evasion": ("example:evasion", True),
    "waypoint": ("example:waypoint", False),
}
"""A model that random requests are made of, and whether they are masked."""

NAMES = quick_among(PLAYED, {"walk", "unmasked", "broken"})
SEED = 5


@pytest.mark.parametrize("name", NAMES)
def test_episodes_of_many_environments_replay_in_a_single_one(name: str) -> None:
    model, masked = PLAYED[name]
    found = outcomes("random", model, 8, SEED, masked, max_episode_steps=60)
    seen = episodes_of("random", model, 8, SEED, masked, max_episode_steps=60)
    assert [e.start.seed for e in seen] == [SEED + k for k in range(8)]
    for k, episode in enumerate(seen):
        assert difference(episode, replay(episode)) == ""
        assert np.sum([m.reward for m in episode.moments]) == pytest.approx(found.total[k], rel=1e-12)
        assert (episode.status == "success") == found.success[k]
        assert any(m.blocked for m in episode.moments) == found.blocked[k]


def test_episodes_end_when_they_do() -> None:
    """Some go on while others begin anew, which is not recorded."""
    model, masked = PLAYED["broken"]
    lengths = {len(e.moments) for e in episodes_of("random", model, 8, SEED, masked)}
    assert len(lengths) > 2


def test_the_first_of_more_episodes_are_kept() -> None:
    model, _ = PLAYED["walk"]
    some, all_of_them = Recording(2, SEED), Recording(9, SEED)
    rates = [evaluate("random", model, 4, SEED, watch=watch) for watch in (some, all_of_them, None)]
    assert rates[0] == rates[1] == rates[2]
    assert some.episodes() == all_of_them.episodes()[:2] and len(all_of_them.episodes()) == 4
