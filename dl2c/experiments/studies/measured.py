"""Training and measuring the policies of a study. Imports torch when it trains."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dl2c.env.actions import encoding
from dl2c.env.opening import open_library
from dl2c.experiments.studies.catalogue import Study
from dl2c.experiments.studies.judged import Judgement, judged
from dl2c.training.evaluation import FIRST_SEED, evaluate, flat_environments
from dl2c.training.policies import policy_of
from dl2c.training.run import Algorithm, Evaluation, Run

ENDURED = 100_000
"""Steps in which a guarded policy may violate nothing."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A policy in words, whether the model's guards hold it, and what it achieved."""

    policy: str
    guarded: bool
    found: Evaluation


@dataclass(frozen=True, slots=True)
class Endured:
    """So many steps of the guarded policy, and in how many a safety predicate failed."""

    steps: int
    violations: int


@dataclass(frozen=True, slots=True)
class Result:
    """All that a page tells. `runs` are the trainings with guards and without, `judgement` is about the first
    one's policy.
    """

    study: Study
    rows: tuple[Measured, ...]
    endured: Endured
    judgement: Judgement
    runs: Mapping[str, Run]


def algorithm(study: Study) -> Algorithm:
    """Masks are learned with where all decisions are discrete."""
    manifest = open_library(study.guarded, study.options).manifest
    return "ppo" if manifest.inputs else "maskable-ppo"


def measure(study: Study, folder: Path, seed: int = 0, episodes: int = 400, steps: int = ENDURED) -> Result:
    """Train with guards and without them, and measure what was learned and what chance achieves."""
    from dl2c.training.learning import train

    algo = algorithm(study)
    models = {"with guards": study.guarded, "without guards": study.unguarded}
    runs: dict[str, Run] = {
        name: train(
            model,
            algo,
            seed=seed,
            directory=folder / name.replace(" ", "_"),
            settings=study.settings,
            whole=True,
            **study.options,
        )
        for name, model in models.items()
    }
    safe, free = (run.policy for run in runs.values())
    rows = (
        ("uniformly random", True, "random"),
        ("learned with guards", True, safe),
        ("uniformly random", False, "random"),
        ("learned with guards", False, safe),
        ("learned without guards", False, free),
    )
    measured: list[Measured] = []
    for name, guarded, actor in rows:
        model = study.guarded if guarded else study.unguarded
        measured.append(Measured(name, guarded, evaluate(actor, model, episodes, **study.options)))
    return Result(study, tuple(measured), endure(safe, study, steps), judged(safe, study), runs)


def endure(policy: Path, study: Study, steps: int, n: int = 100) -> Endured:
    """Run a guarded policy in n environments at once, and count what must not happen."""
    env = flat_environments(study.guarded, n, **study.options)
    act = policy_of(policy, encoding(env.manifest), True, FIRST_SEED)
    observations, _ = env.reset(seed=FIRST_SEED)
    violations = 0
    for _ in range(-(-steps // n)):
        observations, *_ = env.step(act(observations, env.action_masks()))
        violations += int(np.count_nonzero(env.batch.cost))
    env.close()
    return Endured(-(-steps // n) * n, violations)
