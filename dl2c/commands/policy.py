"""Trained policies for `dl2c monitor`: found, read, and held against the model that they are for."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dl2c.commands.verbosity import quiet
from dl2c.env.interface import interface_of
from dl2c.env.opening import compilation_of
from dl2c.native.describe import manifest_of
from dl2c.native.manifest import Manifest
from dl2c.policy.files import read_policy
from dl2c.policy.network import NetworkPolicy, PolicyError, mismatch
from dl2c.training.saved import found_policy, load_policy

INTERFACE = (
    *("action_format", "action_map", "obs_dtype", "observation_bounds", "observe_constants", "constants"),
    *("default_bound", "duration", "max_repeat", "loop", "entry"),
)
"""Options on which it depends what a policy sees and how it acts."""


def policy_for(model: str, path: Path, options: Mapping[str, Any]) -> tuple[NetworkPolicy, Mapping[str, Any]]:
    """The policy at a path, and the options of the environment that it acts in: those given over those it
    was trained with. Raises `PolicyError`, `OSError`, and what checking the model raises.
    """
    file, statistics = found_policy(path)
    if file.suffix == ".json":
        policy = read_policy(file)
        saved = {n: v for n, v in policy.options.items() if n in INTERFACE and v is not None}
        options = saved | dict(options)
        manifest = _manifest(model, options)
    else:
        _warn(file, statistics)
        manifest = _manifest(model, options)
        policy = load_policy(file, statistics, manifest)
    if problem := mismatch(policy, manifest.name, interface_of(manifest)):
        raise PolicyError(f"{file}: {problem}")
    return policy, options


def _warn(file: Path, statistics: Path | None) -> None:
    """What is loaded with pickle may do anything."""
    if not quiet():
        what = file.name if statistics is None else f"{file.name} and {statistics.name}"
        advice = "load only files that you trust, or the policy.json that `dl2c train` writes"
        print(f"warning: loading {what} executes code that is in it; {advice}", file=sys.stderr)


def _manifest(model: str, options: Mapping[str, Any]) -> Manifest:
    """What the environment of a model is, without building it."""
    return manifest_of(compilation_of(model, options).planned.build, "", {})
