"""Which examples are studied, and how their policies are trained."""

from dataclasses import dataclass, field, replace
from typing import Any

from dl2c.env.opening import source_of
from dl2c.source import Source
from dl2c.training.run import Settings


@dataclass(frozen=True, slots=True)
class Study:
    """An example, what is proved of it and what is left to learn, in words. `guard` is the text in it that
    keeps its agent safe, `instead` what stands in its place once it is taken away. `found` says how to read
    what is measured. `options` are those of its environments. `has_goal`: episodes can succeed; else only the
    return says how well a policy does.
    """

    example: str
    title: str
    proved: str
    learned: str
    found: str
    guard: str
    settings: Settings
    instead: str = "?true;"
    options: dict[str, Any] = field(default_factory=dict[str, Any])
    has_goal: bool = True

    @property
    def guarded(self) -> Source:
        """The model."""
        return source_of(f"example:{self.example}")

    @property
    def unguarded(self) -> Source:
        """The model without what keeps its agent safe."""
        text = self.guarded.text
        assert text.count(self.guard) == 1, f"{self.example} says in one place {self.guard}"
        return Source(f"examples/{self.example}.kyx without guards", text.replace(self.guard, self.instead))

    def quick(self) -> "Study":
        """The same with hardly any training."""
        tiny = {"n_steps": 16, "batch_size": 64, "n_epochs": 1, "net_arch": [8, 8]}
        return replace(self, settings=Settings(steps=128, n_envs=8, hyper=tiny))


SQUASH: dict[str, Any] = {"action_map": "squash"}

DRIVING = Settings(steps=4_000_000, n_envs=128, hyper={"gamma": 0.99, "ent_coef": 0.01})

STUDIES: tuple[Study, ...] = (
    Study(
        "static_safety",
        "Static safety on the ground",
        "The robot never hits an obstacle while it moves, wherever the environment places the nearest one.",
        "Which arcs lead to the goal although obstacles forbid most of them. Standing still is always safe, "
        "so that a policy has to learn to leave it.",
        "TODO",
        "?isSeparated(x, y, xo, yo, admissibleSeparation(v));",
        DRIVING,
        options=SQUASH,
    ),
    Study(
        "passive_safety",
        "Passive safety beside a moving obstacle",
        "The robot has stopped by the time the obstacle, which moves as it likes up to its highest velocity, "
        "touches it.",
        "To get past something that moves: the guard allows driving only far from it, and that takes time.",
        "TODO",
        "?isSeparated(x, y, xo, yo, admissibleSeparation(v));",
        DRIVING,
        options=SQUASH,
    ),
    Study(
        "acc",
        "Adaptive cruise control",
        "The cars never touch, whatever the one in front does that its brakes allow.",
        "Comfort: to keep the wanted distance in stop-and-go traffic instead of the least that is safe.",
        "TODO",
        "?d + vl^2 / (2 * b) > v^2 / (2 * b) + (A / b + 1) * (A / 2 * ep^2 + ep * v);",
        Settings(steps=1_000_000),
        has_goal=False,
    ),
    Study(
        "watertank",
        "Water tank",
        "The level stays between empty and full.",
        "To keep the level near the wanted one with a valve that is set only now and then.",
        "TODO",
        "?(0 <= l + (u - q) * ep & l + (u - q) * ep <= m);",
        Settings(steps=300_000),
        has_goal=False,
    ),
    Study(
        "pendulum",
        "Inverted pendulum with limited energy",
        "The energy of the pendulum stays below its limit, whatever the motor does within the guard.",
        "To swing up with a motor too weak to lift the pendulum at once.",
        "TODO",
        "if (energy(theta, w) + ep * U^2 / (4 * d) <= Emax)",
        Settings(steps=300_000),
        "if (true)",
    ),
    Study(
        "etcs",
        "European Train Control System",
        "The train passes the end of its movement authority no faster than that allows, whatever authorities "
        "the radio block centre grants later.",
        "To be quick within authorities that come from nowhere, and to stop at a station that no authority "
        "names.",
        "TODO",
        "?m - z >= separation(v, d);",
        Settings(
            steps=6_000_000,
            n_envs=128,
            hyper={"gamma": 0.998, "gae_lambda": 0.98, "net_arch": [128, 128]},
        ),
    ),
)


def study_of(example: str) -> Study | None:
    """The study of an example, None if there is none."""
    return next((s for s in STUDIES if s.example == example), None)
