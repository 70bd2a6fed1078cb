"""All three tests of the paper with five seeds each, in parallel; what `dl2c paper` runs."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from dl2c.experiments.paper import forced, safe_lock, waypoint
from dl2c.experiments.paper.forced import Approach, Forced
from dl2c.experiments.paper.safe_lock import LINE, PLANE, Locked
from dl2c.experiments.paper.waypoint import Driven
from dl2c.experiments.parallel import in_parallel
from dl2c.training.hyper import CAREFUL, CAREFUL_ENVS
from dl2c.training.run import Algorithm, Settings

FOLDER = Path("build/paper")

GUARDS: dict[str, Any] = {
    "n_steps": 16,
    "batch_size": 1024,
    "n_epochs": 4,
    "learning_rate": 4e-3,
    "schedule": "linear",
    "gamma": 0.0,
    "gae_lambda": 0.0,
}
"""Whether a request blocks is known at once, so nothing needs to look ahead."""

PAPER_PPO: dict[str, Any] = {
    "learning_rate": 3e-4,
    "schedule": "constant",
    "n_steps": 256,
    "batch_size": 64,
    "n_epochs": 10,
    "gamma": 0.99,
    "ent_coef": 0.0,
}
"""The defaults of Stable-Baselines3, with eight environments: 2048 steps in a round, as with one."""


@dataclass(frozen=True, slots=True)
class Budget:
    """How much is trained and measured. `proper` where success of what was learned is asked for."""

    proper: bool
    seeds: tuple[int, ...]
    episodes: int
    line: Settings
    plane: Settings
    masked: Settings
    unmasked: Settings


FULL = Budget(
    proper=True,
    seeds=(1, 2, 3, 4, 5),
    episodes=400,
    line=Settings(steps=100_000, n_envs=CAREFUL_ENVS, hyper=CAREFUL | {"gamma": 0.99}),
    plane=Settings(steps=10_000, n_envs=8, hyper=PAPER_PPO),
    masked=Settings(
        steps=65_536, n_envs=CAREFUL_ENVS, hyper=CAREFUL, eval_every=8_192, eval_options=waypoint.STRICT
    ),
    unmasked=Settings(
        steps=6_000_000, n_envs=512, hyper=GUARDS, eval_every=400_000, eval_options=waypoint.STRICT
    ),
)

TINY: dict[str, Any] = {"n_steps": 16, "batch_size": 64, "n_epochs": 1, "net_arch": [8, 8]}

QUICK = Budget(
    proper=False,
    seeds=(1, 2),
    episodes=20,
    line=Settings(steps=256, n_envs=8, hyper=TINY),
    plane=Settings(steps=256, n_envs=8, hyper=TINY),
    masked=Settings(
        steps=256, n_envs=8, hyper=TINY, eval_every=128, eval_episodes=10, eval_options=waypoint.STRICT
    ),
    unmasked=Settings(
        steps=256, n_envs=8, hyper=TINY, eval_every=128, eval_episodes=10, eval_options=waypoint.STRICT
    ),
)
"""Everything, in seconds; nothing is learned in it."""

Result: TypeAlias = Locked | Driven
Job: TypeAlias = Callable[[], Result]


@dataclass(frozen=True, slots=True)
class Results:
    """What was found, sorted by seed."""

    line: Sequence[Locked]
    plane: Sequence[Locked]
    forced: Sequence[Forced]
    approach: Approach
    guards: Sequence[Driven]
    """Policies that know nothing: the first enabled alternative, random ones with and without masks."""
    masked: Sequence[Driven]
    unmasked: Sequence[Driven]
    seconds: float


def experiments(budget: Budget, folder: Path, note: Callable[[int, int], None]) -> Results:
    """Run everything; `note` is told how many of how many trainings are done."""
    began = time.perf_counter()
    n = budget.episodes
    guards = [
        waypoint.driven("first enabled", "first", True, n),
        waypoint.driven("uniform random", "random", True, n),
        waypoint.driven("uniform random", "random", False, n),
    ]
    ends = [forced.forced(seed, n) for seed in budget.seeds]
    states = forced.initial_states(forced.MODEL, 20, forced.FIRST_SEED, **forced.STRICT)
    shown = forced.approach(max(states, key=lambda s: s["xo"] - s["x"]))
    found = _all(_jobs(budget, folder), budget.proper, note)

    def of(kind: str) -> list[Any]:
        return [found[name] for name in sorted(found) if name[0] == kind]

    learned = (of("masked"), of("unmasked"))
    return Results(of("line"), of("plane"), ends, shown, guards, *learned, time.perf_counter() - began)


def _jobs(budget: Budget, folder: Path) -> dict[tuple[str, int], Job]:
    """The trainings by kind and seed, the longest first."""
    n, jobs = budget.episodes, dict[tuple[str, int], Job]()
    learners: tuple[tuple[str, Algorithm, Settings], ...] = (
        ("unmasked", "ppo", budget.unmasked),
        ("masked", "maskable-ppo", budget.masked),
    )
    for kind, algo, settings in learners:
        for seed in budget.seeds:
            jobs[kind, seed] = partial(waypoint.learned, algo, seed, settings, n, folder / f"{kind}-{seed}")
    for kind, model, settings in (("line", LINE, budget.line), ("plane", PLANE, budget.plane)):
        for seed in budget.seeds:
            jobs[kind, seed] = partial(safe_lock.learned, model, seed, settings, n, folder / f"{kind}-{seed}")
    return jobs


def _all(
    jobs: dict[tuple[str, int], Job], parallel: bool, note: Callable[[int, int], None]
) -> dict[tuple[str, int], Result]:
    """The results of all jobs; processes of their own work on them, if it is worth to start these."""
    if parallel:
        return in_parallel(jobs, note)
    found: dict[tuple[str, int], Result] = {}
    for name, job in jobs.items():
        note(len(found), len(jobs))
        found[name] = job()
    return found
