"""Optuna looks for better hyperparameters of a model than the defaults, and writes down which are the best.

    python examples/tune.py examples/dubins.kyx -o dubins.yaml     (`pip install 'dl2c[train,tune]'`)
    dl2c train --config dubins.yaml

The first trial has the defaults of `dl2c train`; with `--like FILE` two more have what was found for another
model. The best trial and the defaults are then trained and measured again with other seeds, since who is the
best of many was lucky, too. The file says all that there was to choose, so that it goes on meaning the same.
"""

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import yaml

import dl2c
from dl2c.training.evaluation import FIRST_SEED, outcomes
from dl2c.training.hyper import DEFAULTS
from dl2c.training.learning import train
from dl2c.training.run import Settings

Values = dict[str, Any]

EPISODES = 200
SEEDS = (101, 102, 103)
"""Of the last comparison; trials have seed 0."""

CHOICES: dict[str, tuple[Any, ...]] = {
    "gamma": (0.95, 0.98, 0.99, 0.995),
    "gae_lambda": (0.9, 0.95, 0.98),
    "n_steps": (16, 32, 64, 128),
    "batch_size": (256, 1024),
    "n_epochs": (2, 3, 6, 10),
    "ent_coef": (0.0, 0.003, 0.01),
    "action_map": ("project", "squash"),
}
"""What a trial picks from, beside the learning rate. The last one is an option of the environment."""

_, N_ENVS, DEFAULT = DEFAULTS["ppo"]
PLAIN = {name: DEFAULT.get(name, "project") for name in (*CHOICES, "learning_rate")}


def suggested(trial: optuna.Trial) -> dict[str, Any]:
    """The values of a trial."""
    picked = {name: trial.suggest_categorical(name, values) for name, values in CHOICES.items()}
    return picked | {"learning_rate": trial.suggest_float("learning_rate", 3e-4, 1e-2, log=True)}


def configuration(model: str, steps: int, values: Mapping[str, Any]) -> dict[str, Any]:
    """What `dl2c train --config` reads."""
    manifest = dl2c.make(model).manifest
    algo = "ppo" if manifest.inputs else "maskable-ppo"
    hyper = {name: value for name, value in values.items() if name != "action_map"}
    hyper["schedule"] = DEFAULT["schedule"]
    chosen: dict[str, Any] = {"model": model, "algo": algo, "steps": steps, "n_envs": N_ENVS, "hyper": hyper}
    return chosen | ({"options": {"action_map": values["action_map"]}} if manifest.inputs else {})


def score(chosen: Mapping[str, Any], seed: int, first_episode: int) -> float:
    """The mean return of the policy that this training gives."""
    settings = Settings(steps=chosen["steps"], n_envs=chosen["n_envs"], hyper=chosen["hyper"])
    options = chosen.get("options", {})
    with tempfile.TemporaryDirectory() as folder:
        given: Values = {"directory": Path(folder), "settings": settings, "whole": True} | options
        run = train(chosen["model"], chosen["algo"], seed=seed, **given)
        masked = chosen["algo"] == "maskable-ppo"
        found = outcomes(run.policy, chosen["model"], EPISODES, first_episode, masked, **options)
    return float(found.total.mean())


def values_of(path: Path) -> list[dict[str, Any]]:
    """The values that a file says, for both ways to map actions."""
    said = yaml.safe_load(path.read_text(encoding="utf-8")).get("hyper", {})
    values = {name: said.get(name, value) for name, value in PLAIN.items()}
    return [values | {"action_map": action_map} for action_map in CHOICES["action_map"]]


def tuned(model: str, trials: int, steps: int, first: Sequence[Values]) -> tuple[Values, float, float]:
    """The best configuration (that of the defaults if none is better), its mean return, and theirs."""
    study = optuna.create_study(direction="maximize", sampler=optuna.samplers.TPESampler(seed=0))
    for values in first:
        study.enqueue_trial(values)
    study.optimize(lambda t: score(configuration(model, steps, suggested(t)), 0, 2 * FIRST_SEED), trials)
    best, plain = (configuration(model, steps, values) for values in (study.best_params, PLAIN))
    found, before = (
        float(np.mean([score(chosen, seed, 3 * FIRST_SEED) for seed in SEEDS])) for chosen in (best, plain)
    )
    return (best, found, before) if found > before else (plain, before, before)


def main() -> None:
    """Tune, and write what is best."""
    parser = argparse.ArgumentParser(description="Look for hyperparameters.")
    parser.add_argument("model")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--steps", type=int, default=120_000)
    parser.add_argument("--like", type=Path, action="append", default=[], metavar="FILE")
    given = parser.parse_args()
    first = [PLAIN, *chain(*map(values_of, given.like))]
    best, found, before = tuned(given.model, given.trials, given.steps, first)
    said = f"mean return {found:.4g}, with the defaults {before:.4g}"
    if found == before:
        said = f"mean return {found:.4g} with the defaults, which no trial surpassed"
    about = (
        f"# Chosen by examples/tune.py in {given.trials} trials of {given.steps:,} steps.\n"
        f"# Of {len(SEEDS)} other seeds, {EPISODES} episodes each: {said}.\n"
    )
    given.output.write_text(about + yaml.safe_dump(best, sort_keys=False), encoding="utf-8")
    print(f"{given.output}: {said}")


if __name__ == "__main__":
    main()
