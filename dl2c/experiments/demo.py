"""A model in which a policy learns its way, and the paper's, with and without masks (`make demo`).

Prints tables and writes pictures to `build/demo`.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from dl2c.experiments.parallel import in_parallel
from dl2c.training.evaluation import evaluate
from dl2c.training.plots import plot_curves, plot_trajectory
from dl2c.training.rollout import rollout
from dl2c.training.run import Algorithm, Evaluation, Point, Settings

LEARNED, LEARNED_STEPS = "example:evasion", 300_000
"""Where random actions hardly ever succeed, and PPO learns within a minute."""

MODEL = "example:waypoint"
FOLDER = Path("build/demo")
SEEDS = (1, 2, 3)
EPISODES = 200
FILMED = 3
"""Episodes of a film."""

STRICT: dict[str, Any] = {"on_blocked": "terminate"}
"""How every policy is measured: a request without a run ends the episode, unsuccessfully."""

LESSONS: dict[str, Any] = {"on_blocked": "fallback", "blocked_penalty": -1000.0}
"""How the unmasked policy learns: such a request costs 1000, and the episode goes on with an enabled run."""

GUARDS = Settings(
    steps=2_000_000,
    n_envs=256,
    hyper={
        "n_steps": 8,
        "batch_size": 256,
        "n_epochs": 3,
        "learning_rate": 3e-3,
        "schedule": "linear",
        "gamma": 0.01,
        "gae_lambda": 0.0,
        "net_arch": [128, 128],
    },
)
"""Long enough to find the guards. A request blocks or not at once, so nothing needs to look ahead."""

ROWS = """\
Every row: {episodes} episodes with random constants and initial states; 95 % intervals in brackets.
Success is info["is_success"], a violation an episode in which a @safety predicate failed, blocked an
episode in which a request blocked.
"""

ABOUT_LEARNED = """\
examples/evasion.kyx: get to a goal while an adversary moves an obstacle about. The guard of the model
keeps every policy away from the obstacle; the way to the goal is learned.
"""

ABOUT = """\
examples/waypoint.kyx, the paper's model: stop in an area before a deadline. A request that blocks ends
the episode here (on_blocked="terminate"), and counts as no success.

The guards of Theorem 14 leave the controller almost no choice: in nearly every state exactly one
alternative is enabled. Masks alone therefore solve this model, and the masked rows say nothing
about learning. What learning does shows without masks: PPO has to find the guards by itself. It
learns with on_blocked="fallback" and a penalty of 1000 for every request that blocks, and is
measured like all others with on_blocked="terminate"."""


@dataclass(frozen=True, slots=True)
class Trained:
    """One finished training: what it is called, its curve and how the policy did."""

    name: str
    algo: Algorithm
    seed: int
    policy: Path
    curve: tuple[Point, ...]
    found: Evaluation


def main() -> None:
    """Run the demonstration: a few minutes on two cores."""
    started = time.perf_counter()
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=120)
    table = _table()
    for name, policy, masked in (
        ("first enabled", "first", True),
        ("uniform random", "random", True),
        ("uniform random", "random", False),
    ):
        _add(table, name, masked, evaluate(policy, MODEL, EPISODES, masked=masked, **STRICT))
    console.print(f"training {1 + 2 * len(SEEDS)} policies; this takes a few minutes")
    learned, *trained = _train_all()
    for run in trained:
        _add(table, f"{run.name}, seed {run.seed}", run.algo == "maskable-ppo", run.found)
    first = _table()
    _add(first, "uniform random", False, evaluate("random", LEARNED, EPISODES, masked=False))
    _add(first, learned.name, False, learned.found)
    console.print(ROWS.format(episodes=EPISODES), markup=False)
    for about, rows in ((ABOUT_LEARNED, first), (ABOUT, table)):
        console.print(about, markup=False)
        console.print(rows)
        console.print()
    for path in (*_pictures(trained), *_films(learned.policy)):
        console.print(f"wrote {path}", markup=False)
    console.print(f"{time.perf_counter() - started:.0f} s in all")


def _train_all() -> list[Trained]:
    """The policy of `LEARNED`; then those of `MODEL`, every algorithm with every seed.

    In parallel, the longest first; results in a fixed order.
    """
    console = Console(stderr=True)
    algorithms: tuple[Algorithm, ...] = ("ppo", "maskable-ppo")
    jobs = {(algo, seed): partial(_train, algo, seed) for algo in algorithms for seed in SEEDS}
    jobs["learned", 0] = partial(_learn)
    from rich.progress import Progress

    with Progress(console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("training")
        found = in_parallel(jobs, lambda done, of: bar.update(task, completed=done, total=of))
    learned = found.pop(("learned", 0))
    return [learned, *(found[name] for name in sorted(found))]


def _learn() -> Trained:
    from dl2c.training.learning import train

    settings = Settings(steps=LEARNED_STEPS)
    run = train(LEARNED, seed=0, directory=FOLDER / "evasion", settings=settings, whole=True)
    found = evaluate(run.policy, LEARNED, EPISODES, masked=False)
    return Trained("PPO", "ppo", 0, run.policy, run.curve, found)


def _train(algo: Algorithm, seed: int) -> Trained:
    from dl2c.training.learning import train

    masked = algo == "maskable-ppo"
    settings = Settings(steps=65_536) if masked else GUARDS
    options = STRICT if masked else LESSONS
    directory = FOLDER / f"{algo}-{seed}"
    run = train(MODEL, algo, seed=seed, directory=directory, settings=settings, whole=True, **options)
    found = evaluate(run.policy, MODEL, EPISODES, masked=masked, **STRICT)
    return Trained("MaskablePPO" if masked else "PPO", algo, seed, run.policy, run.curve, found)


def _table() -> Table:
    return Table("policy", "masks", "success", "violations", "blocked", "travel time / s", box=None)


def _add(table: Table, name: str, masked: bool, found: Evaluation) -> None:
    rates = (found.success, found.violations, found.blocked)
    shown = (*(e.shown(".1%") for e in rates), found.travel_time.shown(".2f"))
    table.add_row(name, "yes" if masked else "no", *map(escape, shown))


def _pictures(trained: Iterable[Trained]) -> list[Path]:
    """Learning curves of the unmasked policies, and one episode of the last of them."""
    learned = [run for run in trained if run.algo == "ppo"]
    curves, trajectory = FOLDER / "learning.png", FOLDER / "trajectory.png"
    plot_curves({"PPO without masks, 3 seeds": [run.curve for run in learned]}, curves)
    rows = list(rollout(learned[-1].policy, MODEL, masked=False, **STRICT))
    names = {"xr": "position / m", "vr": "velocity / (m/s)", "T": "time to deadline / s"}
    plot_trajectory(rows, names, trajectory, "one episode of PPO without masks")
    return [curves, trajectory]


def _films(policy: Path) -> list[Path]:
    """Some episodes of `LEARNED` before and after learning; none where what films need is missing."""
    from dl2c.report.film import write_film
    from dl2c.report.pictures import episodes_of

    if not (find_spec("imageio_ffmpeg") and find_spec("pygame")):
        return []
    films = {FOLDER / "before.gif": "random", FOLDER / "after.gif": policy}
    for path, acting in films.items():
        write_film(episodes_of(acting, LEARNED, FILMED, masked=False), path)
    return list(films)


if __name__ == "__main__":
    main()
