"""Which examples are studied, and how their policies are trained."""

from dataclasses import dataclass, field, replace
from typing import Any

from dl2c.training.run import Settings

GUARDED: dict[str, Any] = {"on_blocked": "fallback"}
"""An alternative that is not enabled is replaced by one that is."""

UNGUARDED: dict[str, Any] = {"on_blocked": "terminate", "blocked_penalty": -100.0}
"""Asking for an alternative that is not enabled ends the episode, and costs what a collision would. Values of
continuous decisions are moved to admissible ones all the same.
"""


@dataclass(frozen=True, slots=True)
class Study:
    """An example, what is proved of it and what is left to learn, in words. `options` are those of the
    environment in which its guarded policy acts. `has_goal`: episodes can succeed; else only the return says
    how well a policy does.
    """

    example: str
    title: str
    proved: str
    learned: str
    settings: Settings
    options: dict[str, Any] = field(default_factory=dict[str, Any])
    has_goal: bool = True

    def quick(self) -> "Study":
        """The same with hardly any training."""
        tiny = {"n_steps": 16, "batch_size": 64, "n_epochs": 1, "net_arch": [8, 8]}
        return replace(self, settings=Settings(steps=128, n_envs=8, hyper=tiny))


SQUASH: dict[str, Any] = {"action_map": "squash"}

STUDIES: tuple[Study, ...] = (
    Study(
        "static_safety",
        "Static safety on the ground",
        "The robot never hits an obstacle while it moves, wherever the environment places the nearest one.",
        "Which arcs lead to the goal although obstacles forbid most of them. Standing still is always safe, "
        "so that a policy has to learn to leave it.",
        Settings(steps=2_000_000, n_envs=128),
        SQUASH,
    ),
    Study(
        "passive_safety",
        "Passive safety beside a moving obstacle",
        "The robot has stopped by the time the obstacle, which moves as it likes up to its highest velocity, "
        "touches it.",
        "To get past something that moves: the guard allows driving only far from it, and that takes time.",
        Settings(steps=2_000_000, n_envs=128),
        SQUASH,
    ),
    Study(
        "acc",
        "Adaptive cruise control",
        "The cars never touch, whatever the one in front does that its brakes allow.",
        "Comfort: to keep the wanted distance in stop-and-go traffic instead of the least that is safe.",
        Settings(steps=500_000),
        has_goal=False,
    ),
    Study(
        "watertank",
        "Water tank",
        "The level stays between empty and full.",
        "To keep the level near the wanted one with a valve that is set only now and then.",
        Settings(steps=300_000),
        has_goal=False,
    ),
    Study(
        "pendulum",
        "Inverted pendulum with limited energy",
        "The energy of the pendulum stays below its limit, whatever the motor does within the guard.",
        "To swing up with a motor too weak to lift the pendulum at once, and to hold it there.",
        Settings(steps=1_000_000),
    ),
    Study(
        "etcs",
        "European Train Control System",
        "The train passes the end of its movement authority no faster than that allows, whatever authorities "
        "the radio block centre grants later.",
        "To be quick within authorities that come from nowhere, and to stop at a station that no authority "
        "names.",
        Settings(steps=1_000_000),
    ),
)


def study_of(example: str) -> Study | None:
    """The study of an example, None if there is none."""
    return next((s for s in STUDIES if s.example == example), None)
