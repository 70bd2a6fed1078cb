"""What a user may choose about an environment, with one name everywhere.

The same names serve the command line (`--on-blocked`), Python (`on_blocked=`) and
`@episode` annotations. Values given in code win over `@episode`, which wins over
`[tool.dl2c]` of a project (configuration.py), which wins over the defaults here (semantics 9).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from typing import Any, Literal, TypeAlias, cast, get_args
from warnings import warn

OnBlocked: TypeAlias = Literal["fallback", "truncate", "terminate"]
ActionFormat: TypeAlias = Literal["auto", "dict", "box", "discrete", "multidiscrete"]
ActionMap: TypeAlias = Literal["project", "squash"]
ObservationDtype: TypeAlias = Literal["float32", "float64"]
ObservationBounds: TypeAlias = Literal["declared", "unbounded"]
Duration: TypeAlias = Literal["max", "sample", "agent"]
SafetyCheck: TypeAlias = Literal["continuous", "step", "flows"]
MaskDepth: TypeAlias = Literal["flow", "step"]
Integrator: TypeAlias = Literal["auto", "exact", "cvodes", "dopri5"]
Stiff: TypeAlias = Literal["auto", "true", "false"]
Provider: TypeAlias = Literal["casadi", "system"]
ProgressFailure: TypeAlias = Literal["due", "literal"]
InitialDistribution: TypeAlias = Literal["uniform", "target", "z3"]

LARGEST = 10**300
MAX_LENGTH = 400
"""Numbers may be so large, and their texts so long."""

MOST_STEPS = 10**18
MOST_LOOPS = 10**9
MOST_REPEATS = 1000

DEFAULT_DT = Fraction(1, 10)
"""Seconds a flow lasts where the model gives no horizon."""

DEPRECATED = {("safety_check", "auto"): "continuous"}
"""Values of options that stand for others."""


@dataclass(frozen=True, slots=True)
class Options:
    """Every option of an environment; see semantics for what each one means.

    `dt` None means: the model's own horizon; in a problem without a loop the end of the domain, if that
    is met within `max_flow` seconds; else `DEFAULT_DT`. `rtol` and `atol` are the tolerances of CVODES
    and dopri5. `constants` fixes episode constants by name, `default_bound` limits
    names on the sides on which nothing else does, `entry` selects an archive entry by its name or its
    number in the file (from 1), `loop` one of several top-level loops (from 1).
    """

    entry: str | None = None
    loop: int | None = None
    constants: tuple[tuple[str, Fraction], ...] = ()
    default_bound: tuple[Fraction, Fraction] | None = None
    dt: Fraction | None = None
    max_flow: Fraction = Fraction(1000)
    tolerance: Fraction = Fraction(1, 10**9)
    progress_failure: ProgressFailure = "due"
    observe_constants: bool = True
    obs_dtype: ObservationDtype = "float32"
    observation_bounds: ObservationBounds = "declared"
    action_format: ActionFormat = "auto"
    action_map: ActionMap = "project"
    on_blocked: OnBlocked = "fallback"
    mask_depth: MaskDepth = "flow"
    blocked_penalty: float = 0.0
    max_episode_steps: int = 1000
    stall_limit: int = 0
    duration: Duration = "max"
    safety_check: SafetyCheck = "continuous"
    initial_distribution: InitialDistribution = "uniform"
    integrator: Integrator = "auto"
    stiff: Stiff = "auto"
    rtol: Fraction = Fraction(1, 10**9)
    atol: Fraction = Fraction(1, 10**11)
    monitor_every_step: bool = False
    max_loop: int = 10_000
    max_repeat: int = 8
    native: bool = False
    sundials: Provider = "casadi"
    given: frozenset[str] = field(default=frozenset(), repr=False)
    """The options that were given in code, which `@episode` does not change."""


class UnknownOption(ValueError):
    """An option name or value that does not exist; the message says what does."""


def with_options(options: Options, given: Mapping[str, Any]) -> Options:
    """`options` with the given ones replaced, each checked and converted.

    Raises `UnknownOption` for a name or value that does not exist.
    """
    known = {f.name: f for f in fields(Options) if f.name != "given"}
    changes: dict[str, Any] = {}
    for name, value in given.items():
        if name not in known:
            raise UnknownOption(f"no option `{name}`; the options are {', '.join(sorted(known))}")
        if instead := deprecation(name, value):
            warn(instead, DeprecationWarning, stacklevel=2)
        changes[name] = _converted(name, value, known[name].type)
    return replace(options, **changes, given=frozenset((*options.given, *changes)))


def deprecation(name: str, value: Any) -> str:
    """What to use instead of a value that is deprecated; "" of others."""
    instead = DEPRECATED.get((name, value)) if isinstance(value, str) else None
    return f"`{name}={value}` is deprecated: use `{name}={instead}`, its new name" if instead else ""


def under(options: Options, episode: Mapping[str, Any]) -> Options:
    """`options` completed by those of `@episode`; what was given in code stays.

    Raises `UnknownOption`.
    """
    rest = {name: value for name, value in episode.items() if name not in options.given}
    return replace(with_options(options, rest), given=options.given)


def _converted(name: str, value: Any, kind: Any) -> Any:
    match name:
        case "constants":
            if not isinstance(value, Mapping):
                raise UnknownOption(f"`constants` takes names with values, not {value!r}")
            given = cast("Mapping[str, Any]", value)
            return tuple(sorted((name, _exact(f"constants[{name}]", v)) for name, v in given.items()))
        case "default_bound":
            return None if value is None else _range(name, value)
        case "dt":
            return None if value is None else _positive(name, _exact(name, value))
        case "max_flow" | "rtol" | "atol":
            return _positive(name, _exact(name, value))
        case "stiff" if isinstance(value, bool):
            return str(value).lower()
        case "tolerance":
            return _nonnegative(name, _exact(name, value))
        case "entry":
            return None if value is None else str(value)
        case "blocked_penalty":
            return float(_exact(name, value))
        case "max_episode_steps" | "stall_limit":
            return _whole(name, value, 0)
        case "max_repeat":
            return _whole(name, value, 0, MOST_REPEATS)
        case "max_loop":
            return _whole(name, value, 1, MOST_LOOPS)
        case "loop":
            return None if value is None else _whole(name, value, 1)
        case "observe_constants" | "monitor_every_step" | "native":
            if not isinstance(value, bool):
                raise UnknownOption(f"`{name}` takes True or False, not {value!r}")
            return value
        case _:
            allowed = get_args(kind)
            value = DEPRECATED.get((name, value), value) if isinstance(value, str) else value
            if value not in allowed:
                raise UnknownOption(f"`{name}` takes {', '.join(map(repr, allowed))}, not {value!r}")
            return value


def _whole(name: str, value: Any, least: int, most: int = MOST_STEPS) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise UnknownOption(f"`{name}` takes a whole number from {least} to {most:,}")
    return value


def _range(name: str, value: Any) -> tuple[Fraction, Fraction]:
    """`LO:HI`, with or without brackets, or two numbers."""
    ends = value.strip().strip("[]").split(":") if isinstance(value, str) else value
    if not isinstance(ends, list | tuple) or len(found := cast("list[Any]", ends)) != 2:
        raise UnknownOption(f"`{name}` takes LO:HI, not {value!r}")
    low, high = (_exact(name, end) for end in found)
    if low >= high:
        raise UnknownOption(f"`{name}` takes LO:HI with LO below HI, not {value!r}")
    return low, high


def _exact(name: str, value: Any) -> Fraction:
    """Numbers as the user wrote them: a float stands for its shortest decimal."""
    if not isinstance(value, Fraction):
        text = str(value).strip()
        exponent = re.search(r"e[+-]?0*([0-9_]+)$", text, re.IGNORECASE)
        if len(text) > MAX_LENGTH or (exponent and len(exponent.group(1)) > 3):
            raise UnknownOption(f"`{name}` takes a number of at most {MAX_LENGTH} digits, up to 1e300")
        try:
            value = Fraction(text)
        except (ValueError, ZeroDivisionError):
            raise UnknownOption(f"`{name}` takes a number, not {text!r}") from None
    if abs(value) > LARGEST:
        raise UnknownOption(f"`{name}` takes a number up to 1e300")
    return value


def _positive(name: str, value: Fraction) -> Fraction:
    if value <= 0:
        raise UnknownOption(f"`{name}` must be positive, not {value}")
    return value


def _nonnegative(name: str, value: Fraction) -> Fraction:
    if value < 0:
        raise UnknownOption(f"`{name}` must not be negative, but is {value}")
    return value
