"""A request that is not admissible, as an episode of one step: for `dl2c replay`."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dl2c.env.single import Dl2cEnv
from dl2c.policy.network import ActionKind, NetworkPolicy
from dl2c.report.episode import Episode, play
from dl2c.report.refuted import CannotFollow, begun, checked, opened
from dl2c.source import Source

NEAR = 1e-5
"""How far outputs may be from those that were judged, relative to 1 and to their size: a policy in float32
computes with other roundings than one in numpy.
"""

FORMATS: dict[ActionKind, str] = {"box": "box", "runs": "discrete"}
"""Formats of actions; of other kinds it is the one that is chosen by itself."""


def requested(
    source: Source,
    options: Mapping[str, Any],
    policy: NetworkPolicy,
    state: Mapping[str, float],
    outputs: Sequence[Fraction],
) -> Episode:
    """The episode in which the policy asks for something in a state, and the environment does not do that.
    `outputs` are those of its network there. Raises `CannotFollow`.
    """
    form = {"on_blocked": "truncate", "monitor_every_step": False}
    form["action_format"] = FORMATS.get(policy.interface.kind, "auto")
    env = opened(source, {**options, **form})
    try:
        start = begun(env, state)
        action = _asked(env, policy, outputs)
        if not _overruled(env, action):
            raise CannotFollow("within its tolerance the environment does what is asked for")
        return checked(play(env, start, [action]), lambda again: len(again.moments) == 1)
    finally:
        env.close()


def _asked(env: Dl2cEnv, policy: NetworkPolicy, outputs: Sequence[Fraction]) -> Any:
    """What the policy asks for, whatever the mask says. Raises `CannotFollow` where it observes something
    else than what was judged.
    """
    observation: NDArray[Any] = env.restore(env.save())[0][None]
    wanted = np.array([float(v) for v in outputs])
    if not np.allclose(policy.network.outputs(observation)[0], wanted, NEAR, NEAR):
        raise CannotFollow("the environment decides otherwise there before the policy observes")
    everything = np.ones((1, policy.interface.outputs), np.bool_)
    action = policy.act(observation, everything)[0]
    return int(action) if action.ndim == 0 else action


def _overruled(env: Dl2cEnv, action: Any) -> bool:
    """Whether the environment does something else than what is asked for; it has taken the step."""
    info = env.step(action)[4]
    return bool(info["blocked"]) or not np.array_equal(info["executed_action"], action)
