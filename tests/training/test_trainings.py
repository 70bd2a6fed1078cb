"""Whole trainings, on a toy: the same again for the same seed, saved, stopped, and gone on with."""

import json
import os
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generators.toy_library import use_toy
from selection import quick_rows

pytest.importorskip("sb3_contrib")

from dl2c import cli
from dl2c.policy.files import NPZ
from dl2c.training.evaluation import evaluate, flat_environments
from dl2c.training.folders import read_run
from dl2c.training.learning import train
from dl2c.training.policies import policy_of
from dl2c.training.run import Point, Settings, TrainingError

MODEL = "a model\nof two lines"
ON_POLICY = {"n_steps": 16, "batch_size": 32, "n_epochs": 1, "net_arch": [8, 8]}
OFF_POLICY = {"learning_starts": 16, "batch_size": 16, "buffer_size": 500, "net_arch": [8, 8]}


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes every model the toy library, with these decisions."""
    use_toy(monkeypatch)
    return partial(use_toy, monkeypatch)


def small(algo: str = "ppo", steps: int = 128, **more: Any) -> Settings:
    return Settings(steps=steps, n_envs=4, hyper=OFF_POLICY if algo == "sac" else ON_POLICY, **more)


def numbers(folder: Path) -> list[list[float]]:
    """Every number of a policy."""
    with np.load(folder / NPZ) as file:
        return [file[name].ravel().tolist() for name in sorted(file.files)]


CASES = [
    ("ppo", (3,), 0, False),
    ("ppo", (2,), 1, True),
    ("maskable-ppo", (3, 2), 0, True),
    ("sac", (), 2, False),
]


@pytest.mark.parametrize(
    ("algo", "counts", "inputs", "normalize"), quick_rows([*CASES, ("sac", (), 1, True)], CASES)
)
def test_a_seed_gives_one_policy(
    toy: Any, algo: Any, counts: Any, inputs: int, normalize: bool, tmp_path: Path
) -> None:
    """And the zip file, with its statistics, acts as the data do."""
    toy(counts, inputs)
    settings = small(algo, normalize=normalize)
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        train(MODEL, algo, seed=seed, directory=tmp_path / name, settings=settings)
    assert numbers(tmp_path / "a") == numbers(tmp_path / "b") != numbers(tmp_path / "c")
    env = flat_environments(MODEL, 50)
    observations, _ = env.reset(seed=1)
    from dl2c.env.actions import encoding

    code, masks = encoding(env.manifest, "box" if counts and inputs else None), env.action_masks()
    zipped, data = (
        policy_of(p, code, True, 0)(observations, masks)
        for p in (tmp_path / "a" / "policy.zip", tmp_path / "a")
    )
    assert np.allclose(zipped, data, atol=1e-4)


def test_evaluations_do_not_change_the_training(tmp_path: Path) -> None:
    train(MODEL, directory=tmp_path / "a", settings=small())
    watched = small(eval_every=64, eval_episodes=3, checkpoint_every=64)
    run = train(MODEL, directory=tmp_path / "b", settings=watched)
    assert numbers(tmp_path / "a") == numbers(tmp_path / "b")
    assert [e.steps for e in run.evaluations] == [64, 128]
    assert {p.name for p in (tmp_path / "b" / "checkpoints").iterdir()} == {"64", "128"}
    assert numbers(tmp_path / "b" / "checkpoints" / "128") != numbers(tmp_path / "b" / "checkpoints" / "64")
    assert str(read_run(tmp_path / "b").run.evaluations) == str(run.evaluations)
    assert (tmp_path / "b" / "best" / "policy.json").exists()
    assert str(evaluate(tmp_path / "b", MODEL, 3)) == str(run.evaluations[-1].found)


@pytest.mark.parametrize(
    ("algo", "counts", "inputs"), quick_rows([("ppo", (3,), 0), ("sac", (), 1)], [("ppo", (3,), 0)])
)
def test_a_training_goes_on(toy: Any, algo: Any, counts: Any, inputs: int, tmp_path: Path) -> None:
    toy(counts, inputs)
    train(MODEL, algo, directory=tmp_path / "a", settings=small(algo))
    with pytest.raises(TrainingError, match="128 steps already"):
        train(MODEL, algo, directory=tmp_path / "a", settings=small(algo), resume=tmp_path / "a")
    ends = [
        train(MODEL, algo, directory=tmp_path / name, settings=small(algo, 256), resume=tmp_path / "a")
        for name in ("b", "c")
    ]
    assert numbers(tmp_path / "b") == numbers(tmp_path / "c") != numbers(tmp_path / "a")
    assert json.loads((tmp_path / "b" / "run.json").read_text())["steps"] == 256
    if algo == "ppo":
        assert [p.steps for p in ends[0].curve] == [64, 128, 192, 256]


def test_a_killed_training_goes_on_from_its_last_checkpoint(tmp_path: Path) -> None:
    train(MODEL, directory=tmp_path, settings=small(checkpoint_every=64))
    (tmp_path / "run.json").unlink()
    assert read_run(tmp_path).folder == tmp_path / "checkpoints" / "128"
    with pytest.raises(TrainingError, match="holds no training"):
        read_run(tmp_path / "best")


def test_only_the_same_task_is_gone_on_with(tmp_path: Path) -> None:
    train(MODEL, directory=tmp_path, settings=small())
    with pytest.raises(TrainingError, match="was trained with algo ppo, not maskable-ppo"):
        train(MODEL, "maskable-ppo", directory=tmp_path, settings=small(steps=256), resume=tmp_path)
    other = small(steps=256, normalize=True)
    with pytest.raises(TrainingError, match="was trained with normalize False, not True"):
        train(MODEL, directory=tmp_path, settings=other, resume=tmp_path)


@pytest.fixture
def heeded() -> Iterator[None]:
    """Processes in the background of a shell ignore interruptions."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupt(point: Point) -> None:
    if point.steps == 128:
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.usefixtures("heeded")
def test_ctrl_c_ends_what_is_of_use_only_as_a_whole(tmp_path: Path) -> None:
    """A table about half a training would be wrong."""
    with pytest.raises(KeyboardInterrupt):
        train(MODEL, directory=tmp_path / "a", settings=small(steps=100_000), progress=interrupt, whole=True)
    assert not (tmp_path / "a").exists()


@pytest.mark.usefixtures("heeded")
def test_who_ignores_ctrl_c_is_not_stopped(tmp_path: Path) -> None:
    """Such as what a shell runs in the background."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    assert not train(MODEL, directory=tmp_path, settings=small(steps=256), progress=interrupt).interrupted


@pytest.mark.usefixtures("heeded")
def test_ctrl_c_keeps_what_there_is(tmp_path: Path) -> None:

    before = signal.getsignal(signal.SIGINT)
    run = train(MODEL, directory=tmp_path, settings=small(steps=100_000), progress=interrupt)
    assert run.interrupted and run.curve[-1].steps == 128
    assert signal.getsignal(signal.SIGINT) == before
    assert read_run(tmp_path).run.interrupted
    assert evaluate(tmp_path, MODEL, 3).episodes == 3
    on = train(MODEL, directory=tmp_path, settings=small(steps=256), resume=tmp_path)
    assert not on.interrupted and on.curve[-1].steps == 260


@pytest.mark.parametrize(
    ("algo", "counts", "inputs", "words"),
    [
        ("sac", (3,), 0, "choice_0 is a choice; use ppo"),
        ("sac", (3,), 1, "choice_0 is a choice; use ppo"),
        ("sac", (), 0, "the model decides nothing"),
        ("maskable-ppo", (3,), 1, "assign_u0 is continuous; use ppo or sac"),
    ],
)
def test_an_algorithm_that_does_not_fit_is_refused(
    toy: Any, algo: Any, counts: Any, inputs: int, words: str, tmp_path: Path
) -> None:
    toy(counts, inputs)
    with pytest.raises(TrainingError, match=words):
        train(MODEL, algo, directory=tmp_path)


# The command ---------------------------------------------------------------------------------------


def dl2c(capsys: Any, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> tuple[int, str, str]:
    monkeypatch.setattr("sys.argv", ["dl2c", *arguments])
    try:
        cli.main()
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    said = capsys.readouterr()
    return code, said.out, said.err


FLAGS = ("--steps", "64", "--n-envs", "4", "--hyper", "n_steps=16", "--hyper", "batch_size=32", "--json")


def test_the_command_trains_and_goes_on(capsys: Any, monkeypatch: Any, tmp_path: Path) -> None:
    folder = str(tmp_path / "run")
    code, out, err = dl2c(capsys, monkeypatch, "train", MODEL, "-o", folder, *FLAGS, "--seed", "5")
    assert (code, json.loads(out)["interrupted"]) == (0, False), err
    assert (tmp_path / "run" / "curve.png").stat().st_size > 1000
    code, out, err = dl2c(capsys, monkeypatch, "train", MODEL, "--resume", folder, "--steps", "128")
    assert code == 0 and "200 episodes" in out, err
    given = read_run(tmp_path / "run").given
    assert (given.seed, given.settings.steps, given.settings.hyper["n_steps"]) == (5, 128, 16)
    code, _, err = dl2c(capsys, monkeypatch, "train", MODEL, "--resume", folder, "--seed", "6")
    assert code == 1 and "goes on with its own seed" in err


def test_tensorboard_is_told_every_round(capsys: Any, monkeypatch: Any, tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    folders = ("-o", str(tmp_path / "run"), "--tensorboard", str(tmp_path / "log"))
    code, _, err = dl2c(capsys, monkeypatch, "train", MODEL, *folders, *FLAGS, "--steps", "192")
    assert code == 0, err
    (file,) = (tmp_path / "log").rglob("events*")
    told = EventAccumulator(str(file))
    told.Reload()
    curve = read_run(tmp_path / "run").run.curve
    for name in ("success", "violations"):
        scalars = {e.step: e.value for e in told.Scalars(f"dl2c/{name}")}
        known = {p.steps: getattr(p, name) for p in curve if p.episodes}
        assert known and scalars == pytest.approx(known)


def test_flags_win_over_the_configuration(capsys: Any, monkeypatch: Any, tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    (tmp_path / "c.yaml").write_text(
        "steps: 1000000\nseed: 2\nhyper: {gamma: 0.5, n_epochs: 1}\noptions: {max_episode_steps: 9}\n"
    )
    config = ("--config", str(tmp_path / "c.yaml"))
    code, _, err = dl2c(capsys, monkeypatch, "train", MODEL, *config, *FLAGS, "-o", str(tmp_path / "run"))
    assert code == 0, err
    given = read_run(tmp_path / "run").given
    assert (given.settings.steps, given.seed) == (64, 2)
    hyper = given.settings.hyper
    assert (hyper["gamma"], hyper["n_epochs"], hyper["n_steps"]) == (0.5, 1, 16)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "name a model"),
        ((MODEL, "--algo", "dqn"), "no algorithm 'dqn'; there is ppo, maskable-ppo, sac"),
        ((MODEL, "--hyper", "gama=1"), "did you mean gamma?"),
        ((MODEL, "--algo", "sac"), "sac needs continuous decisions only"),
        ((MODEL, "--resume", "nowhere"), "holds no training"),
    ],
)
def test_mistakes_of_the_command_are_one_line(
    arguments: tuple[str, ...], words: str, capsys: Any, monkeypatch: Any
) -> None:
    code, _, err = dl2c(capsys, monkeypatch, "train", *arguments)
    assert code == 1 and words in err and "internal" not in err
