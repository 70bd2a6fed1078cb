"""Films show episodes in the time of the model, and appear whole or not at all."""

import math
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import dl2c.report.film as films
from dl2c.cli import app
from dl2c.diagnostics import Mistake
from dl2c.picture.scene import ScenePicture, Status
from dl2c.report.episode import Episode, Start, play, write_episode
from dl2c.report.film import FRAMES, HELD, frames_of, write_film

MODEL = """
Theorem "A point on a circle"
ProgramVariables
  /* @var: bound=[-3:3], unit="m" */ Real x;
  /* @var: bound=[-3:3], unit="m" */ Real y;
  Real t;
End.
/* @scene: disk(x, y, radius=0.2, role=agent) */
Problem
  x = 2 & y = 0 -> [{ t := 0; {x' = -y, y' = x, t' = 1 & t <= 0.3} }*] x <= 3
End.
End.
"""


@pytest.fixture(autouse=True)
def compiled_quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CFLAGS", "-O0 -DDL2C_NO_TARGET_CLONES")


def episode(model: str = MODEL, steps: int = 7, action: Any = 0, **options: Any) -> Episode:
    import dl2c

    env = dl2c.make(model, **options)
    try:
        return play(env, Start(0), [action] * steps)
    finally:
        env.close()


def test_frames_come_in_the_time_of_the_model_and_follow_its_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of 0.3 seconds, frames of 0.04: each shows where on the circle the agent was."""
    drawn: list[tuple[float, float, float]] = []
    draw = ScenePicture.draw

    def noted(picture: ScenePicture, x: Any, p: Any, status: Status) -> Any:
        drawn.append((status.time, float(x[0]), float(x[1])))
        return draw(picture, x, p, status)

    monkeypatch.setattr(ScenePicture, "draw", noted)
    frames = list(frames_of(episode()))
    assert len(frames) == 1 + 52 + round(HELD * FRAMES) and len(drawn) == 1 + 52
    for k, (time, x, y) in enumerate(drawn):
        assert time == pytest.approx(k / FRAMES)
        assert (x, y) == pytest.approx((2 * math.cos(k / FRAMES), 2 * math.sin(k / FRAMES)))
    assert all((a != b).any() for a, b in pairwise(frames[:53]))


def test_a_step_without_time_has_one_frame_and_a_long_episode_a_minute() -> None:
    jumps = MODEL.replace("{x' = -y, y' = x, t' = 1 & t <= 0.3}", "x := x - 0.01;")
    assert len(list(frames_of(episode(jumps)))) == 1 + 7 + round(HELD * FRAMES)
    slow = MODEL.replace("t <= 0.3", "t <= 30")
    found = sum(1 for _ in frames_of(episode(slow)))
    assert abs(found - (60 + HELD) * FRAMES) <= 2


def test_an_episode_without_a_scene_is_filmed_as_curves() -> None:
    plain = MODEL.replace("/* @scene: disk(x, y, radius=0.2, role=agent) */", "").replace(', unit="m"', "")
    frames = list(frames_of(episode(plain, steps=2)))
    assert len(frames) == 1 + 15 + FRAMES and len({f.shape for f in frames}) == 1
    assert (frames[0] != frames[-1]).any()


@pytest.mark.parametrize("ending", ["mp4", "gif", "MP4"])
def test_films_can_be_played(ending: str, tmp_path: Path) -> None:
    ffmpeg: Any = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "made" / f"film.{ending}"
    one = episode(steps=2)
    write_film([one, replace(one, start=Start(1))], path)
    frames, seconds = ffmpeg.count_frames_and_secs(str(path))
    assert frames == 2 * (1 + 15 + FRAMES)
    assert seconds == pytest.approx(frames / FRAMES, abs=0.1)
    assert ffmpeg.read_frames(str(path)).__next__()["size"] == (640, 520)


def test_nothing_half_written_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "film.mp4"
    path.write_bytes(b"before")
    whole = films.frames_of

    def broken(one: Episode) -> Any:
        yield from list(whole(one))[:5]
        raise KeyboardInterrupt

    monkeypatch.setattr(films, "frames_of", broken)
    with pytest.raises(KeyboardInterrupt):
        write_film([episode(steps=2)], path)
    assert path.read_bytes() == b"before" and [p.name for p in tmp_path.iterdir()] == ["film.mp4"]


def test_what_is_missing_or_wrong_is_said_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saved = tmp_path / "episode.json"
    write_episode(episode(steps=2), saved)
    run = CliRunner().invoke
    wrong = run(app, ["replay", str(saved), "--film", str(tmp_path / "film.avi")])
    assert isinstance(wrong.exception, OSError) and ".mp4, .gif" in str(wrong.exception)
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(Mistake, match="pip install pygame-ce"):
        write_film([episode(steps=2)], tmp_path / "film.mp4")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ModuleNotFoundError) as missing:
        write_film([episode(steps=2)], tmp_path / "film.mp4")
    assert missing.value.name == "imageio_ffmpeg"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["episode.json"]


def test_commands_write_films(tmp_path: Path) -> None:
    model, saved = tmp_path / "circle.kyx", tmp_path / "episode.json"
    model.write_text(MODEL)
    write_episode(episode(steps=3), saved)
    one, other = tmp_path / "one.gif", tmp_path / "other.mp4"
    run = CliRunner().invoke
    done = run(app, ["replay", str(saved), "--film", str(one)])
    assert done.exit_code == 0 and one.stat().st_size > 1000
    given = ["rollout", str(model), "--film", str(other), "--max-episode-steps", "3"]
    done = run(app, given)
    assert done.exit_code == 0 and other.stat().st_size > 1000 and "1 episodes, 3 steps" in done.output
    refused = run(app, [*given, "--ray"])
    assert "--film is for episodes run here" in str(refused.exception)
