"""Which examples are studied, and how their policies are trained."""

from dataclasses import dataclass, field, replace
from typing import Any

from dl2c.env.opening import source_of
from dl2c.source import Source
from dl2c.training.hyper import CAREFUL, CAREFUL_ENVS
from dl2c.training.run import Settings


@dataclass(frozen=True, slots=True)
class Study:
    """An example, with what is proved of it and what is left to learn in words. `guard` is the text that
    keeps its agent safe, `instead` its replacement in the model without guards. `found` says how to read
    the results. `options` are those of its environments. Without `has_goal` no episode can succeed, so
    only the return says how well a policy does.
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
        """The same study with very little training."""
        tiny = {"n_steps": 16, "batch_size": 64, "n_epochs": 1, "net_arch": [8, 8]}
        return replace(self, settings=Settings(steps=128, n_envs=8, hyper=tiny))


SQUASH: dict[str, Any] = {"action_map": "squash"}

DRIVING = Settings(steps=4_000_000, n_envs=128, hyper=CAREFUL | {"gamma": 0.99, "ent_coef": 0.01})

STUDIES: tuple[Study, ...] = (
    Study(
        "static_safety",
        "Static safety on the ground",
        "The robot never hits an obstacle while it moves, wherever the environment places the nearest one.",
        "Which arcs lead to the goal although obstacles forbid most of them. Standing still is always safe, "
        "so that a policy has to learn to leave it.",
        "With or without the guard the policies reach the goal, and nothing is hit. That is not skill but "
        "the model: an obstacle is a point that the environment places anew at every decision, and one "
        "placed at random is never where the robot is. The guard costs nothing here, and what it buys is "
        "not a rate but the theorem: the environment may place obstacles as maliciously as it likes.",
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
        "With guards the policy never touches the obstacle while it drives, and reaches the goal more often "
        "than the one without. That one has learned to be careful, too, but still collides in one episode in "
        "ten, after four million steps in which every collision cost 100. What safety costs is time: the "
        "guard reckons with the worst obstacle and not with one that wanders about at random, and on average "
        "the way takes eight seconds instead of five. A policy learned with guards relies on them: without, "
        "it collides as often as the one that never had any.",
        "?isSeparated(x, y, xo, yo, admissibleSeparation(v));",
        DRIVING,
        options=SQUASH,
    ),
    Study(
        "acc",
        "Adaptive cruise control",
        "The cars never touch, whatever the one in front does that its brakes allow.",
        "Comfort: to keep the wanted distance in stop-and-go traffic instead of the least that is safe.",
        "The guard makes the task easier: driving close is never fatal under it, while without it the first "
        "thing that penalties of 1000 teach is to stay far behind, which pays little, and even so a few "
        "episodes end in a crash. What the guard costs shows in the picture: the policy asks for more than "
        "it may have and lets the fallback brake, which is safe and uncomfortable. With its guard taken "
        "away the same policy crashes in most episodes.",
        "?d + vl^2 / (2 * b) > v^2 / (2 * b) + (A / b + 1) * (A / 2 * ep^2 + ep * v);",
        Settings(steps=1_000_000, n_envs=CAREFUL_ENVS, hyper=CAREFUL),
        has_goal=False,
    ),
    Study(
        "watertank",
        "Water tank",
        "The level stays between empty and full.",
        "To keep the level near the wanted one with a valve that is set only now and then.",
        "Who keeps near a wanted level stays away from both ends, so both policies learned are safe: their "
        "task implies the theorem. What the guard buys is the way there, since a policy that knows nothing "
        "yet makes the tank overflow in nearly every episode. With as many steps the policy with guards "
        "keeps the level a little less well; it is as good without its guard, so what differs is what was "
        "learned, not what is allowed.",
        "?(0 <= l + (u - q) * ep & l + (u - q) * ep <= m);",
        Settings(steps=300_000, n_envs=CAREFUL_ENVS, hyper=CAREFUL),
        has_goal=False,
    ),
    Study(
        "pendulum",
        "Inverted pendulum with limited energy",
        "The energy of the pendulum stays below its limit, whatever the motor does within the guard.",
        "To swing up with a motor too weak to lift the pendulum at once.",
        "The guard costs nothing: the policy learned under it always swings up, while the one without it "
        "exceeds the limit in one episode in ten although each costs 100. It relies on the guard, though: "
        "with that taken away it exceeds the limit in more than half of its episodes. Random torques never "
        "come near.",
        "if (energy(theta, w) + ep * U^2 / (4 * d) <= Emax)",
        Settings(steps=300_000, n_envs=CAREFUL_ENVS, hyper=CAREFUL),
        "if (true)",
    ),
    Study(
        "etcs",
        "European Train Control System",
        "The train passes the end of its movement authority no faster than that allows, whatever authorities "
        "the radio block centre grants later.",
        "To be quick within authorities that come from nowhere, and to stop at a station that no authority "
        "names.",
        "The guard costs nothing that these numbers show, and seldom acts: this radio grants a new "
        "authority in every second step, uniformly up to 1500 m ahead, so that the train is nearly always "
        "far from its end. What the guard buys is the theorem, for every other radio, and the few episodes "
        "in which a policy without it passes the end of an authority too fast. What is hard is to stop at "
        "the station: most episodes that fail drive past it.",
        "?m - z >= separation(v, d);",
        Settings(
            steps=6_000_000,
            n_envs=128,
            hyper=CAREFUL | {"gamma": 0.998, "gae_lambda": 0.98, "net_arch": [128, 128]},
        ),
    ),
)


def study_of(example: str) -> Study | None:
    """The study of an example, None if there is none."""
    return next((s for s in STUDIES if s.example == example), None)
