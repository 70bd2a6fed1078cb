"""Episodes written out step by step, for tables and plots."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dl2c.env.actions import encoding, flat_format
from dl2c.env.opening import Model, open_library, source_of
from dl2c.env.single import Dl2cEnv, Step
from dl2c.native.manifest import Manifest
from dl2c.training.policies import Policy, policy_of

COLUMNS = ("episode", "step", "time", "action", "reward", "terminated", "truncated", "status", "reason")
"""Columns of a row, before one for each variable and constant (`name_` if the name is among these), and for
the value that each `x := *` took (`assign_x`, the key of the action space).
"""


def rollout(
    policy: str | Path | Policy,
    model: Model,
    episodes: int = 1,
    seed: int = 0,
    masked: bool = True,
    first: int = 0,
    around: Callable[[Dl2cEnv], Any] = lambda env: env,
    **options: Any,
) -> Iterator[dict[str, Any]]:
    """The steps of so many episodes from number `first` on: one row per step, and row 0 of each episode for
    its initial state (no action, reward 0). `action` is the run that was executed, in the type of actions; an
    action of several numbers is a list. With `action_map="squash"` there are no columns for what the agent
    assigned. `around` may wrap the environment, to record what happens in it.

    Episode k is seeded `seed + k`, the random policy too, so its rows do not depend on other episodes.
    """
    source = source_of(model)
    action_format = flat_format(open_library(source, options).manifest)
    env = Dl2cEnv(source, **(options | {"action_format": action_format}))
    acted = around(env)
    code, names = encoding(env.manifest), state_names(env.manifest)
    act = policy_of(policy, code, masked, seed)
    for episode in range(first, first + episodes):
        if policy == "random":
            act = policy_of(policy, code, masked, seed + episode)
        observation, _ = acted.reset(seed=seed + episode)
        step, ended = 0, False
        yield _row(env, names, episode, 0, None)
        while not ended:
            action = act(observation[None], env.action_masks()[None])[0]
            observation, _, terminated, truncated, _ = result = acted.step(action)
            step, ended = step + 1, terminated or truncated
            yield _row(env, names, episode, step, result)
    env.close()


def state_names(manifest: Manifest) -> dict[str, str]:
    """The columns of variables and constants, each with the name in the model."""
    return {column(q.name): q.name for q in (*manifest.variables, *manifest.constants)}


def column(name: str) -> str:
    """The column of a variable or constant."""
    return f"{name}_" if name in COLUMNS or name.startswith("assign_") else name


def _row(env: Dl2cEnv, names: dict[str, str], episode: int, step: int, result: Step | None) -> dict[str, Any]:
    state, head = env.state, (0.0, "", 0.0, False, False, "none", "")
    if result is not None:
        _, reward, terminated, truncated, info = result
        taken = np.asarray(info["executed_action"]).tolist()
        head = (info["time"], taken, reward, terminated, truncated, info["status"], info["reason"])
    found = dict(zip(COLUMNS, (episode, step, *head), strict=True))
    found |= {column: state[name] for column, name in names.items()}
    return found | {key: "" if result is None else value for key, value in env.chosen.items()}
