"""A folder that `dl2c train` wrote, as far as a report needs it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dl2c.env.opening import Model, source_of
from dl2c.inputs import checked_input, read_json
from dl2c.source import Source
from dl2c.training.run import MOST_BYTES, RUN, TEXT


class RunError(Exception):
    """A folder that is not a training; the message says why."""


@dataclass(frozen=True, slots=True)
class Trained:
    """What was asked for, and what came of it: entries of `curve` and `evaluations` as in `run.json`."""

    folder: Path
    source: Source
    algo: str
    seed: int
    options: Mapping[str, Any]
    settings: Mapping[str, Any]
    curve: Sequence[Mapping[str, Any]]
    evaluations: Sequence[Mapping[str, Any]]
    seconds: float
    versions: Mapping[str, Any]
    interrupted: bool

    @property
    def masked(self) -> bool:
        """Whether the policy is meant to be kept to enabled alternatives."""
        return self.algo == "maskable-ppo"


def read_trained(folder: Path, model: Model | None = None) -> Trained:
    """Read a folder; `model` stands for the text where there is none. Raises `RunError`, `OSError`."""
    if not (folder / RUN).is_file():
        raise RunError(f"{folder} holds no training: there is no {RUN}")
    with checked_input(RunError, f"{folder / RUN} is not of `dl2c train`"):
        data: dict[str, Any] = read_json(folder / RUN, MOST_BYTES)
        return Trained(
            folder=folder,
            source=_source(folder, str(data["model"]), str(data.get("source", TEXT)), model),
            algo=str(data["algo"]),
            seed=int(data["seed"]),
            options=dict(data["options"]),
            settings=dict(data["settings"]),
            curve=list(data["curve"]),
            evaluations=list(data.get("evaluations", ())),
            seconds=float(data["seconds"]),
            versions=dict(data.get("versions", {})),
            interrupted=bool(data.get("interrupted", False)),
        )


def _source(folder: Path, name: str, file: str, model: Model | None) -> Source:
    """The text that was trained on, under the name that its file had: so the builds of the training serve."""
    if model is not None:
        return source_of(model)
    if not (folder / TEXT).is_file():
        raise RunError(f"{folder} does not hold the text of {name!r}: name the model with --model")
    return Source(file, Source.read(folder / TEXT).text)
