"""Episodes written out step by step, for tables and plots."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dl2c.env.actions import encoding, flat_format
from dl2c.env.opening import Model, open_library, source_of
from dl2c.env.single import Dl2cEnv
from dl2c.training.policies import Policy, policy_of

COLUMNS = ("episode", "step", "time", "action", "reward", "terminated", "truncated", "status", "reason")
"""Columns of a row, before one for each variable and constant (`name_` if the name is among these)."""


def rollout(
    policy: str | Path | Policy,
    model: Model,
    episodes: int = 1,
    seed: int = 0,
    masked: bool = True,
    around: Callable[[Dl2cEnv], Any] = lambda env: env,
    **options: Any,
) -> Iterator[dict[str, Any]]:
    """The steps of so many episodes, episode k seeded `seed + k`: one row per step, and row 0 of each
    episode for its initial state (no action, reward 0). `action` is the run that was executed; an
    action of several numbers is a list. `around` may wrap the environment, to record what happens in it.
    """
    source = source_of(model)
    action_format = flat_format(open_library(source, options).manifest)
    env = Dl2cEnv(source, **(options | {"action_format": action_format}))
    act = policy_of(policy, encoding(env.manifest), masked, seed)
    acted = around(env)
    names = [q.name for q in (*env.manifest.variables, *env.manifest.constants)]
    for episode in range(episodes):
        observation, _ = acted.reset(seed=seed + episode)
        step, ended = 0, False
        yield _row((episode, 0, 0.0, "", 0.0, False, False, "none", ""), env, names)
        while not ended:
            action = act(observation[None], env.action_masks()[None])[0]
            observation, reward, terminated, truncated, info = acted.step(action)
            step, ended = step + 1, terminated or truncated
            taken = np.asarray(info["executed_action"]).tolist()
            head = (episode, step, info["time"], taken, reward, terminated, truncated)
            yield _row((*head, info["status"], info["reason"]), env, names)
    env.close()


def _row(head: tuple[Any, ...], env: Dl2cEnv, names: list[str]) -> dict[str, Any]:
    state = env.state
    return dict(zip(COLUMNS, head, strict=True)) | {f"{n}_" if n in COLUMNS else n: state[n] for n in names}
