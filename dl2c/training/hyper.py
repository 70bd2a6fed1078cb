"""Hyperparameters: the defaults of each algorithm, and whether what is given fits its signature.

Names and types are those of the constructors of Stable-Baselines3, which is imported when called, beside
three of our own: `net_arch` (sizes of the hidden layers), `activation`, and `schedule` (what becomes of the
learning rate: `linear` falls to 0, `constant` stays; `tapered` falls to 0, and the number of epochs to 1).
"""

import inspect
import json
import reprlib
import types
from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches
from typing import Any, Union, cast, get_args, get_origin

from dl2c.training.run import Algorithm, Settings, TrainingError
from dl2c.work import require_memory_for_torch

ON_POLICY: dict[str, Any] = {
    "learning_rate": 6e-3,
    "n_steps": 32,
    "batch_size": 1024,
    "n_epochs": 2,
    "gamma": 0.995,
    "gae_lambda": 0.95,
    "ent_coef": 0.003,
    "net_arch": [64, 64],
    "activation": "tanh",
    "schedule": "tapered",
}

CAREFUL: dict[str, Any] = {
    "n_steps": 128,
    "batch_size": 1024,
    "n_epochs": 6,
    "learning_rate": 1e-3,
    "schedule": "linear",
}
CAREFUL_ENVS = 64
"""Smaller steps of learning, and more of them than the defaults, and how many environments go with it: takes
several times as long. Studies and tuned settings were measured with these.
"""

OFF_POLICY: dict[str, Any] = {
    "learning_rate": 1e-3,
    "buffer_size": 200_000,
    "learning_starts": 1000,
    "batch_size": 256,
    "train_freq": 1,
    "gradient_steps": -1,
    "gamma": 0.99,
    "net_arch": [64, 64],
    "activation": "relu",
    "schedule": "constant",
}

DEFAULTS: dict[Algorithm, tuple[int, int, dict[str, Any]]] = {
    "ppo": (400_000, 256, ON_POLICY),
    "maskable-ppo": (400_000, 256, ON_POLICY),
    "sac": (40_000, 8, OFF_POLICY),
}
"""Steps, environments and hyperparameters."""

ACTIVATIONS = ("tanh", "relu", "elu", "sigmoid")
SCHEDULES = ("tapered", "linear", "constant")

NOT_GIVEN = frozenset(
    ("self", "policy", "env", "seed", "device", "verbose", "tensorboard_log", "policy_kwargs", "action_noise")
    + ("rollout_buffer_class", "rollout_buffer_kwargs", "replay_buffer_class", "replay_buffer_kwargs")
    + ("_init_setup_model", "stats_window_size", "optimize_memory_usage")
)
"""Parameters of the constructors that dl2c decides, or that do not fit on a line."""

POSITIVE = (
    *("learning_rate", "n_steps", "batch_size", "n_epochs", "clip_range", "clip_range_vf", "max_grad_norm"),
    *("buffer_size", "train_freq", "target_update_interval", "tau"),
)
MOST_LAYERS, WIDEST = 64, 8192
FRACTIONS = ("gamma", "gae_lambda", "tau")


def constructor(algo: Algorithm) -> Any:
    """The class of Stable-Baselines3 or sb3-contrib, PPO with gradients in closed form."""
    require_memory_for_torch()
    match algo:
        case "sac":
            from stable_baselines3 import SAC

            return cast("Any", SAC)
        case "ppo":
            from stable_baselines3 import PPO as Found
        case "maskable-ppo":
            from sb3_contrib import MaskablePPO as Found
    from dl2c.training.ppo.update import closed_form

    return closed_form(Found)


def complete(algo: Algorithm, settings: Settings) -> Settings:
    """The settings with every default of the algorithm. Raises `TrainingError`."""
    steps, n_envs, defaults = DEFAULTS[algo]
    wrong = list(mistakes(algo, settings.hyper))
    if wrong:
        raise TrainingError("\n".join(wrong))
    allowed = kinds(algo)
    hyper = defaults | {name: _as(allowed.get(name), value) for name, value in settings.hyper.items()}
    return replace(settings, steps=settings.steps or steps, n_envs=settings.n_envs or n_envs, hyper=hyper)


def mistakes(algo: Algorithm, hyper: Mapping[str, Any]) -> list[str]:
    """What is wrong with hyperparameters, a line each."""
    allowed = kinds(algo)
    names = sorted({*allowed, "net_arch", "activation", "schedule"})
    schedules = SCHEDULES if "n_epochs" in allowed else SCHEDULES[1:]
    found: list[str] = []
    for name, value in hyper.items():
        if name not in names:
            near = get_close_matches(name, names, 1)
            advice = f"did you mean {near[0]}?" if near else f"there is {', '.join(names)}"
            found.append(f"{algo} has no hyperparameter {name!r}; {advice}")
        elif text := _mistake(name, value, allowed.get(name, ()), schedules):
            found.append(f"hyperparameter {name} of {algo}: {text}, not {reprlib.repr(value)}")
    return found


def kinds(algo: Algorithm) -> dict[str, tuple[type, ...]]:
    """The plain types that each parameter of the constructor takes."""
    parameters = inspect.signature(constructor(algo).__init__).parameters.values()
    return {p.name: _plain(p.annotation) for p in parameters if p.name not in NOT_GIVEN}


def _plain(annotation: Any) -> tuple[type, ...]:
    parts = get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else (annotation,)
    return tuple(t for t in parts if t in (int, float, bool, str, type(None)))


def _mistake(name: str, value: Any, allowed: tuple[type, ...], schedules: tuple[str, ...]) -> str | None:
    """What it should be; None where it is."""
    match name:
        case "net_arch":
            sizes = cast("list[Any]", value) if isinstance(value, list) else []
            fits = 0 < len(sizes) <= MOST_LAYERS and all(type(n) is int and 0 < n <= WIDEST for n in sizes)
            return None if fits else f"sizes of layers such as [64, 64], each at most {WIDEST}"
        case "activation":
            return None if value in ACTIVATIONS else f"one of {', '.join(ACTIVATIONS)}"
        case "schedule":
            return None if value in schedules else f"one of {', '.join(schedules)}"
        case _ if type(made := _as(allowed, value)) not in allowed:
            return " or ".join(NAMES[t] for t in allowed)
        case _ if name in POSITIVE and isinstance(made, int | float) and not made > 0:
            return "a positive number"
        case _ if name in FRACTIONS and isinstance(made, int | float) and not 0 <= made <= 1:
            return "a number from 0 to 1"
        case _:
            return None


NAMES = {int: "a whole number", float: "a number", bool: "true or false", str: "a word", type(None): "none"}


def _as(allowed: tuple[type, ...] | None, value: Any) -> Any:
    """The value in a type that is allowed, where it is the same number; YAML reads `1e-3` as a text."""
    if not allowed or type(value) in allowed:
        return value
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            return value
    if isinstance(value, float) and value.is_integer() and float not in allowed and int in allowed:
        return int(value)
    return float(value) if type(value) is int and float in allowed else value


def parsed(texts: list[str]) -> dict[str, Any]:
    """Hyperparameters of the command line, `NAME=VALUE` each. Raises `TrainingError`."""
    found: dict[str, Any] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise TrainingError(f"--hyper takes NAME=VALUE, not {text!r}")
        try:
            found[name] = None if value.lower() == "none" else json.loads(value)
        except ValueError:
            found[name] = value
    return found
