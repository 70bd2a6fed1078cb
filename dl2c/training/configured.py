"""Trainings described in YAML files: the settings of `dl2c train` by name, with places in what is wrong.

    model: example:waypoint
    algo: ppo
    steps: 2000000
    hyper: {learning_rate: 3e-3, gamma: 0.01}
    options: {on_blocked: fallback, blocked_penalty: -1000}

PyYAML is imported when called; nothing in a file is executed.
"""

import reprlib
from collections.abc import Generator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, cast

from dl2c.inputs import checked_input, read_text
from dl2c.training.run import ALGORITHMS, TrainingError

MOST_BYTES = 64 * 1024
MOST_ALIASES = 16
"""Aliases of aliases multiply what a text stands for."""

KINDS: dict[str, type] = {
    "model": str,
    "algo": str,
    "steps": int,
    "n_envs": int,
    "seed": int,
    "normalize": bool,
    "eval_every": int,
    "eval_episodes": int,
    "checkpoint_every": int,
    "threads": int,
    "output": str,
    "tensorboard": str,
    "hyper": dict,
    "eval_options": dict,
    "options": dict,
}
"""What a file may set; `hyper`, `options` and `eval_options` are mappings of their own."""

LEAST = {"steps": 1, "n_envs": 1, "eval_episodes": 1, "threads": 1}
WORDS = {str: "a text", int: "a whole number", bool: "true or false", dict: "a mapping"}


def read_configuration(path: Path) -> dict[str, Any]:
    """The settings of a YAML file. Raises `TrainingError` that says all that is wrong, and `OSError`."""
    import yaml

    untyped = cast("Any", yaml)
    with checked_input(TrainingError, f"{path}: these are not settings"):
        text = read_text(path, MOST_BYTES)
        try:
            aliases = sum(isinstance(token, yaml.AliasToken) for token in untyped.scan(text))
            if aliases > MOST_ALIASES:
                raise ValueError(f"{aliases} aliases; there may be {MOST_ALIASES}")
            data: Any = yaml.safe_load(text)
            root: Any = untyped.compose(text, Loader=yaml.SafeLoader)
        except yaml.YAMLError as problem:
            mark = getattr(problem, "problem_mark", None)
            place = f"{path}:{mark.line + 1}" if mark is not None else str(path)
            told = f"{place}: this is not YAML: {getattr(problem, 'problem', problem)}"
            raise TrainingError(told) from None
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise TrainingError(f"{path}: settings are lines such as `algo: ppo`")
    settings = cast("dict[Any, Any]", data)
    lines: dict[Any, int] = {key.value: key.start_mark.line + 1 for key, _ in root.value}
    wrong = [f"{path}:{lines.get(str(name), 1)}: {text}" for name, text in _wrong(settings)]
    if wrong:
        raise TrainingError("\n".join(wrong))
    return settings


def _wrong(settings: Mapping[Any, Any]) -> Generator[tuple[Any, str]]:
    for name, value in settings.items():
        if name not in KINDS:
            near = get_close_matches(str(name), KINDS, 1)
            advice = f"did you mean {near[0]}?" if near else f"there is {', '.join(KINDS)}"
            yield name, f"no setting {reprlib.repr(name)}; {advice}"
        elif type(value) is not KINDS[name]:
            yield name, f"{name} is {WORDS[KINDS[name]]}, not {reprlib.repr(value)}"
        elif KINDS[name] is int and value < LEAST.get(name, 0):
            yield name, f"{name} is at least {LEAST.get(name, 0)}, not {value}"
        elif name == "algo" and value not in ALGORITHMS:
            yield name, f"no algorithm {reprlib.repr(value)}; there is {', '.join(ALGORITHMS)}"
