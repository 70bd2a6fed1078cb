"""What a built library is, as data: everything a caller needs besides the C calls.

Written beside the library as `manifest.json` and read back by `dl2c.load`. Holds no
path, date or machine name but the build's own key.
"""

import json
import math
import sys
from dataclasses import MISSING, asdict, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeAlias, cast, get_args, get_origin, get_type_hints

from dl2c.inputs import checked_input, read_text
from dl2c.native.errors import NativeError
from dl2c.options import OPTIONS, Options, UnknownOption, with_options

MANIFEST_VERSION = 6

MAX_BYTES = 64 * 1024**2
"""What is longer is not a manifest."""


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
    """How one ODE is integrated, and why (`text` is its dL text with the line). `events` are its conditions,
    each with what is certain about where it first fails."""

    text: str
    kernel: str
    reason: str
    events: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class ConditionSpec:
    """A condition of the monitor that judges every step, by its number; `text` with its place."""

    number: int
    check: str
    text: str


@dataclass(frozen=True, slots=True)
class ShapeSpec:
    """A shape of the scene: a `kind` of `ir.scene.FORMS` in the panel `plane`, `line`, `level`, `dial` or
    `text`. `role` is agent, unsafe, goal or world. Each of `arguments` is a list of
    places in what `dl2c_scene_values` writes; `unit` is that of the first one.
    """

    kind: str
    panel: str
    role: str
    name: str
    unit: str
    arguments: dict[str, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class AxisSpec:
    """An axis of a scene: limits that hold everything on it, infinite where bounds of the model say none."""

    low: float
    high: float
    unit: str


@dataclass(frozen=True, slots=True)
class SceneSpec:
    """What a picture of a state shows; nothing where there are no shapes. `axes` are `x` and `y` of a plane,
    `line` and `level`, those that there are. `shaded` are two variables in whose plane a picture marks
    where @safety predicates fail, or none.
    """

    shapes: tuple[ShapeSpec, ...]
    axes: dict[str, AxisSpec]
    shaded: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TheoremSpec:
    """What the model claims: the name of its theorem, the invariant of its loop, "" where it gives none, and
    what was known when it was built, such as `proved by dl2c verify with z3 5.4.0` or `not checked`."""

    name: str
    invariant: str
    known: str


ActionForm: TypeAlias = Literal["none", "one choice", "choices", "runs", "box", "dict"]
"""How actions are written: each form is a class of dl2c/env/encodings.py."""


@dataclass(frozen=True, slots=True)
class Manifest:
    """One compiled model. `observations` are the entries of an observation in order.

    `runs` lists the decision vectors of the whole control paths in program order, -1 where a
    path does not meet a decision; `run_texts` describes each. `choices` and `inputs` are the
    agent's, `drawn_choices` and `drawn_inputs` the environment's. `certificate` says what is proved
    of sampled initial states. `options` are the effective options by name, `conditions` those of the
    monitor of every step.
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
    drawn_choices: tuple[ChoiceSpec, ...]
    drawn_inputs: tuple[InputSpec, ...]
    runs: tuple[tuple[int, ...], ...]
    run_texts: tuple[str, ...]
    predicates: tuple[PredicateSpec, ...]
    flows: tuple[FlowSpec, ...]
    certificate: str
    sampler: dict[str, Any]
    options: dict[str, Any]
    notes: tuple[str, ...]
    platform: dict[str, str]
    conditions: tuple[ConditionSpec, ...]
    theorem: TheoremSpec
    scene: SceneSpec

    def action_form(self, action_format: str | None = None) -> "ActionForm":
        """The form of actions under `action_format` (default: the model's option), as semantics 2 says.

        Raises `UnknownOption` where the format cannot express the model's decisions.
        """
        if not self.choices and not self.inputs:
            return "none"
        match action_format or self.options["action_format"]:
            case "auto":
                if self.inputs:
                    return "dict" if self.choices else "box"
                return "one choice" if len(self.choices) == 1 else "choices"
            case "dict" | "box" as named:
                return named
            case "discrete" | "multidiscrete" as named:
                if keys := ", ".join(i.key for i in self.inputs):
                    raise UnknownOption(
                        f"action_format={named!r} cannot express the inputs {keys}; "
                        "use 'auto', 'dict' or 'box'"
                    )
                return "runs" if named == "discrete" else "choices"
            case other:
                raise AssertionError(other)

    def to_json(self) -> str:
        """Stable text: the same manifest gives the same bytes. Infinite limits are "inf" and "-inf"."""
        data = _plain({"manifest_version": MANIFEST_VERSION, **asdict(self)})
        return json.dumps(data, indent=1, sort_keys=True, allow_nan=False) + "\n"

    @staticmethod
    def read(path: Path) -> "Manifest":
        """Read a manifest; raises `NativeError` if it is not one of this version. Nothing in it is run."""
        fault = f"{path.name} is not a dl2c manifest"
        try:
            with checked_input(NativeError, fault):
                data = json.loads(read_text(path, MAX_BYTES), parse_constant=_refused_constant)
                if not isinstance(data, dict):
                    raise ValueError("it is not an object")
                given = cast("dict[str, Any]", data)
                version = given.pop("manifest_version", None)
                if isinstance(version, bool) or version != MANIFEST_VERSION:
                    raise NativeError(f"{path.name} is of another version of dl2c; build the model again")
                return _consistent(_record(given, Manifest, "the manifest"))
        except OSError as problem:
            raise NativeError(f"{fault}: {problem.strerror}") from None


def _consistent(manifest: Manifest) -> Manifest:
    """The manifest, if its parts fit each other. Raises `ValueError`."""
    with_options(Options(), manifest.options)
    if any(len(run) != len(manifest.choices) for run in manifest.runs):
        raise ValueError("a run has as many entries as there are choices")
    if len(manifest.run_texts) != len(manifest.runs):
        raise ValueError("every run has a text")
    if missing := sorted(OPTIONS.keys() - {"entry"} - manifest.options.keys()):
        raise ValueError(f"the options lack {missing[0]}")
    return manifest


def _refused_constant(word: str) -> NoReturn:
    raise ValueError(f"{word} is not a number")


def _record(value: Any, kind: Any, where: str) -> Any:
    """An object of JSON as a dataclass. Raises `ValueError` that says where it does not fit."""
    if not isinstance(value, dict):
        raise ValueError(f"{where} is not an object")
    given = cast("dict[str, Any]", value)
    kinds = _hints(kind)
    needed = {f.name for f in fields(kind) if f.default is MISSING}
    if missing := sorted(needed - given.keys()):
        raise ValueError(f"{where} lacks {missing[0]}")
    if unknown := sorted(given.keys() - kinds.keys()):
        raise ValueError(f"{where} has an unknown {unknown[0]!r}")
    return kind(**{name: _part(part, kinds[name], f"{name} of {where}") for name, part in given.items()})


@cache
def _hints(kind: Any) -> dict[str, Any]:
    """The types of a dataclass's fields."""
    return get_type_hints(kind)


def _part(value: Any, kind: Any, where: str) -> Any:
    """A value of JSON as a field holds it: lists as tuples, infinite limits as numbers."""
    if get_origin(kind) is tuple and isinstance(value, list):
        return tuple(_part(item, get_args(kind)[0], where) for item in cast("list[Any]", value))
    if is_dataclass(kind):
        return _record(value, kind, where)
    if get_origin(kind) is dict and isinstance(value, dict):
        given = cast("dict[str, Any]", value)
        return {name: _part(part, get_args(kind)[1], where) for name, part in given.items()}
    if kind is Any or (kind is str and isinstance(value, str)):
        return value
    if kind is int and isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63:
        return value
    if kind == float | None and value is None:
        return None
    if kind in (float, float | None):
        return _limit(value, where)
    raise ValueError(f"{where} has a value of a wrong type")


def _limit(value: Any, where: str) -> float:
    if value in ("inf", "-inf"):
        return float(value)
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= sys.float_info.max:
        raise ValueError(f"{where} is not a number of this size")
    return float(value)


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
