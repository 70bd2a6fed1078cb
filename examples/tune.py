"""Optuna looks for better hyperparameters of a model than the defaults, and writes down which are the best.

    python examples/tune.py examples/dubins.kyx -o dubins.yaml     (`pip install 'dl2c[train,tune]'`)
    dl2c train --config dubins.yaml

The first trial has the defaults of `dl2c train`. The best trial and the defaults are then trained again with
other seeds and measured in other episodes: who is the best of many was lucky, too. With `--large` trainings
have many environments and large batches, for models that need millions of steps.
"""

import argparse
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import yaml

import dl2c
from dl2c.training.evaluation import FIRST_SEED, outcomes
from dl2c.training.hyper import ON_POLICY
from dl2c.training.learning import train
from dl2c.training.run import Settings

EPISODES = 200
SEEDS = (101, 102, 103)
"""Of the last comparison; trials have seed 0."""

CHOICES: dict[str, tuple[Any, ...]] = {
    "gamma": (0.95, 0.98, 0.99, 0.995),
    "gae_lambda": (0.9, 0.95, 0.98),
    "n_steps": (32, 64, 128),
    "batch_size": (256, 1024),
    "n_epochs": (3, 6, 10),
    "ent_coef": (0.0, 0.003, 0.01),
    "action_map": ("project", "squash"),
}
"""What a trial picks from, beside the learning rate. The last one is an option of the environment."""

LARGE = {"batch_size": (4096,), "n_epochs": (2, 4)}
LARGE_ENVS = 256
"""With `--large`: what is chosen among instead, and how many environments step at a time."""

DEFAULTS = {name: ON_POLICY.get(name, "project") for name in (*CHOICES, "learning_rate")}


def suggested(trial: optuna.Trial, large: bool) -> dict[str, Any]:
    """The values of a trial."""
    choices = CHOICES | LARGE if large else CHOICES
    picked = {name: trial.suggest_categorical(name, values) for name, values in choices.items()}
    return picked | {"learning_rate": trial.suggest_float("learning_rate", 3e-4, 1e-2, log=True)}


def configuration(model: str, steps: int, values: Mapping[str, Any], large: bool) -> dict[str, Any]:
    """What `dl2c train --config` reads; values that are defaults are left out."""
    manifest = dl2c.make(model).manifest
    algo = "ppo" if manifest.inputs else "maskable-ppo"
    changed = {name: value for name, value in values.items() if value != DEFAULTS[name]}
    action_map = changed.pop("action_map", None)
    chosen: dict[str, Any] = {"model": model, "algo": algo, "steps": steps}
    chosen |= ({"n_envs": LARGE_ENVS} if large else {}) | {"hyper": changed}
    return chosen | ({"options": {"action_map": action_map}} if action_map and manifest.inputs else {})


def score(chosen: Mapping[str, Any], seed: int, first_episode: int) -> float:
    """The mean return of the policy that this training gives."""
    settings = Settings(steps=chosen["steps"], n_envs=chosen.get("n_envs"), hyper=chosen["hyper"])
    options = chosen.get("options", {})
    with tempfile.TemporaryDirectory() as folder:
        run = train(
            chosen["model"],
            chosen["algo"],
            seed=seed,
            directory=Path(folder),
            settings=settings,
            whole=True,
            **options,
        )
        masked = chosen["algo"] == "maskable-ppo"
        found = outcomes(run.policy, chosen["model"], EPISODES, first_episode, masked, **options)
    return float(found.total.mean())


def tuned(model: str, trials: int, steps: int, large: bool) -> tuple[dict[str, Any], float, float]:
    """The best configuration, its mean return over `SEEDS`, and that of the defaults: if these are as good,
    they are the best.
    """
    defaults = DEFAULTS | ({"batch_size": 4096, "n_epochs": 4} if large else {})

    def returned(trial: optuna.Trial) -> float:
        return score(configuration(model, steps, suggested(trial, large), large), 0, 2 * FIRST_SEED)

    study = optuna.create_study(direction="maximize", sampler=optuna.samplers.TPESampler(seed=0))
    study.enqueue_trial(defaults)
    study.optimize(returned, trials)
    best = configuration(model, steps, study.best_params, large)
    plain = configuration(model, steps, defaults, large)
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
    parser.add_argument("--large", action="store_true", help=f"{LARGE_ENVS} environments, batches of 4096")
    given = parser.parse_args()
    best, found, before = tuned(given.model, given.trials, given.steps, given.large)
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
