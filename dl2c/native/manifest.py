"""What a built library is, as data: everything a caller needs besides the C calls.

Written beside the library as `manifest.json` and read back by `dl2c.load`. Holds no
path, date or machine name but the build's own key.
"""

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, cast

from dl2c.native.errors import NativeError

MANIFEST_VERSION = 2


@dataclass(frozen=True, slots=True)
class Quantity:
    """A variable or constant: its declared range (infinite where open) and how to present it.

    `value` is a constant's fixed value, else None.
    """

    name: str
    low: float
    high: float
    description: str = ""
    unit: str = ""
    plot: str = "none"
    value: float | None = None


@dataclass(frozen=True, slots=True)
class ChoiceSpec:
    """A discrete decision: `key` is `choice_<k>`; one text per alternative, as in the model."""

    key: str
    alternatives: tuple[str, ...]
    name: str = ""


@dataclass(frozen=True, slots=True)
class InputSpec:
    """A continuous decision: `key` is `assign_<variable>`, with the limits of its Box."""

    key: str
    variable: str
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class PredicateSpec:
    """An annotated predicate, in declaration order: reason code 16 + index."""

    name: str
    category: str


@dataclass(frozen=True, slots=True)
class FlowSpec:
    """How one ODE is integrated, and why (`text` is its dL text with the line)."""

    text: str
    kernel: str
    reason: str


@dataclass(frozen=True, slots=True)
class Manifest:
    """One compiled model. `observations` are the entries of an observation in order.

    `runs` lists the decision vectors of the whole control paths in program order, -1 where a
    path does not meet a decision; `run_texts` describes each. `choices` and `inputs` are the
    agent's, `drawn_choices` and `drawn_inputs` the environment's. `certificate` says what is proved
    of sampled initial states. `options` are the effective options by name.
    """

    name: str
    source: str
    dl2c_version: str
    abi_version: int
    stream_version: int
    key: str
    variables: tuple[Quantity, ...]
    constants: tuple[Quantity, ...]
    observations: tuple[Quantity, ...]
    choices: tuple[ChoiceSpec, ...]
    inputs: tuple[InputSpec, ...]
    runs: tuple[tuple[int, ...], ...]
    run_texts: tuple[str, ...]
    predicates: tuple[PredicateSpec, ...]
    flows: tuple[FlowSpec, ...]
    certificate: str
    sampler: dict[str, Any]
    options: dict[str, Any]
    notes: tuple[str, ...]
    platform: dict[str, str]
    drawn_choices: tuple[ChoiceSpec, ...] = ()
    drawn_inputs: tuple[InputSpec, ...] = ()

    def to_json(self) -> str:
        """Stable text: the same manifest gives the same bytes. Infinite limits are "inf" and "-inf"."""
        data = _plain({"manifest_version": MANIFEST_VERSION, **asdict(self)})
        return json.dumps(data, indent=1, sort_keys=True, allow_nan=False) + "\n"

    @staticmethod
    def read(path: Path) -> "Manifest":
        """Read a manifest; raises `NativeError` if it is not one of this version."""
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            if data.pop("manifest_version") != MANIFEST_VERSION:
                raise NativeError(f"{path.name} is of another version of dl2c; build the model again")
            return _manifest(data)
        except (OSError, KeyError, TypeError, ValueError) as problem:
            raise NativeError(f"{path.name} is not a dl2c manifest: {problem}") from None


def _manifest(data: dict[str, Any]) -> Manifest:
    rows: dict[str, type] = {
        "variables": Quantity,
        "constants": Quantity,
        "observations": Quantity,
        "choices": ChoiceSpec,
        "inputs": InputSpec,
        "drawn_choices": ChoiceSpec,
        "drawn_inputs": InputSpec,
        "predicates": PredicateSpec,
        "flows": FlowSpec,
    }
    given = {f.name: data[f.name] for f in fields(Manifest)}
    for name, row in rows.items():
        given[name] = tuple(row(**{k: _frozen(v) for k, v in item.items()}) for item in data[name])
    given["runs"] = tuple(tuple(run) for run in data["runs"])
    given["run_texts"] = tuple(data["run_texts"])
    given["notes"] = tuple(data["notes"])
    return Manifest(**given)


def _plain(value: Any) -> Any:
    """JSON has no infinite numbers: they become words."""
    match value:
        case dict():
            return {name: _plain(part) for name, part in cast("dict[str, Any]", value).items()}
        case list() | tuple():
            return [_plain(part) for part in cast("list[Any]", value)]
        case float() if math.isinf(value):
            return str(value)
        case _:
            return value


def _frozen(value: Any) -> Any:
    """A value as a field holds it: lists as tuples, infinite limits as numbers."""
    if value in ("inf", "-inf"):
        return float(value)
    return tuple(cast("list[Any]", value)) if isinstance(value, list) else value
