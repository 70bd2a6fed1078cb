"""Hyperparameters and configurations: what fits is taken, what does not is named with advice."""

import re
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY

pytest.importorskip("sb3_contrib")

from dl2c.training.hyper import DEFAULTS, complete, parsed
from dl2c.training.run import ALGORITHMS, Settings, TrainingError


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_defaults_fit_the_algorithm(algo: Any) -> None:
    made = complete(algo, Settings(hyper=DEFAULTS[algo][2]))
    assert made.hyper == DEFAULTS[algo][2]
    assert (made.steps, made.n_envs) == DEFAULTS[algo][:2]


def test_numbers_are_read_as_the_algorithm_takes_them() -> None:
    given = parsed(["n_steps=2e2", "learning_rate=1", "net_arch=[8, 8]", "target_kl=none", "activation=relu"])
    hyper = complete("ppo", Settings(hyper=given | {"gamma": "9.9e-1"})).hyper
    assert (hyper["n_steps"], type(hyper["n_steps"])) == (200, int)
    assert (hyper["learning_rate"], type(hyper["learning_rate"])) == (1.0, float)
    assert (hyper["net_arch"], hyper["target_kl"], hyper["gamma"]) == ([8, 8], None, 0.99)
    assert complete("sac", Settings(hyper=parsed(["ent_coef=auto"]))).hyper["ent_coef"] == "auto"


@pytest.mark.parametrize(
    ("algo", "text", "words"),
    [
        ("ppo", "learning_rat=1", "did you mean learning_rate?"),
        ("ppo", "tau=0.1", "ppo has no hyperparameter 'tau'"),
        ("ppo", "policy=x", "ppo has no hyperparameter 'policy'"),
        ("ppo", "learning_rate=fast", "learning_rate of ppo: a number, not 'fast'"),
        ("ppo", "learning_rate=-1", "a positive number, not -1"),
        ("ppo", "n_steps=1.5", "a whole number, not 1.5"),
        ("ppo", "gamma=1.5", "a number from 0 to 1"),
        ("ppo", "net_arch=64", "sizes of layers"),
        ("ppo", "net_arch=[0]", "sizes of layers"),
        ("ppo", "activation=sin", "one of tanh, relu"),
        ("ppo", "schedule=cosine", "one of tapered, linear, constant"),
        ("sac", "schedule=tapered", "one of linear, constant"),
        ("ppo", "normalize_advantage=3", "true or false"),
        ("sac", "n_epochs=3", "sac has no hyperparameter 'n_epochs'"),
    ],
)
def test_what_does_not_fit_is_named(algo: Any, text: str, words: str) -> None:
    with pytest.raises(TrainingError) as problem:
        complete(algo, Settings(hyper=parsed([text])))
    assert words in str(problem.value)


def test_all_mistakes_are_named_at_once() -> None:
    with pytest.raises(TrainingError) as problem:
        complete("ppo", Settings(hyper=parsed(["gama=1", "n_steps=x"])))
    assert "gamma?" in str(problem.value) and "n_steps" in str(problem.value)
    with pytest.raises(TrainingError, match="NAME=VALUE"):
        parsed(["gamma"])


GOOD = """\
algo: sac
steps: 5000   # in all
hyper: {learning_rate: 1e-3, net_arch: [8]}
options: {action_map: squash}
"""


def test_a_configuration_is_read(tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    from dl2c.training.configured import read_configuration

    path = tmp_path / "study.yaml"
    path.write_text(GOOD, encoding="utf-8")
    found = read_configuration(path)
    assert (found["algo"], found["steps"]) == ("sac", 5000)
    assert complete("sac", Settings(hyper=found["hyper"])).hyper["learning_rate"] == 1e-3
    path.write_text("", encoding="utf-8")
    assert read_configuration(path) == {}


def test_the_configuration_of_the_guide_is_one(tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    from dl2c.training.configured import read_configuration

    guide = (REPOSITORY / "docs" / "howto" / "train.md").read_text("utf-8")
    (block,) = re.findall(r"^```yaml\n(.*?)^```", guide, re.M | re.S)
    (tmp_path / "c.yaml").write_text(block, encoding="utf-8")
    found = read_configuration(tmp_path / "c.yaml")
    assert complete(found["algo"], Settings(hyper=found["hyper"])).hyper["learning_rate"] == 4e-3


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("algo: ppo\nstpes: 3\n", "study.yaml:2: no setting 'stpes'; did you mean steps?"),
        ("steps: many\n", "study.yaml:1: steps is a whole number, not 'many'"),
        ("steps: 0\n", "steps is at least 1"),
        ("algo: dqn\n", "no algorithm 'dqn'"),
        ("- ppo\n", "settings are lines"),
        ("hyper: {a: 1\n", "this is not YAML"),
        ("a: !!python/object/apply:os.getcwd []\n", "this is not YAML"),
    ],
)
def test_mistakes_in_a_configuration_have_a_place(text: str, words: str, tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    from dl2c.training.configured import read_configuration

    path = tmp_path / "study.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TrainingError) as problem:
        read_configuration(path)
    assert words in str(problem.value)
