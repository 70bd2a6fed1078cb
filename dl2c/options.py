"""What a user may choose about an environment: one record per option, with one name everywhere.

The same names serve the command line (`--on-blocked`), Python (`on_blocked=`), `@episode` annotations and
`[tool.dl2c]` of a project. Flags, their help, what `@episode` accepts and the tables of the documentation
are made from `OPTIONS`. Values given in code win over `@episode`, which wins over `[tool.dl2c]`
(configuration.py), which wins over the defaults here (semantics 9).
"""

import re
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields, replace
from fractions import Fraction
from typing import Any, Literal, TypeAlias, cast, get_args
from warnings import warn

from dl2c.diagnostics import Mistake

OnBlocked: TypeAlias = Literal["fallback", "truncate", "terminate"]
Duration: TypeAlias = Literal["max", "sample", "agent"]
MaskDepth: TypeAlias = Literal["flow", "step"]
Integrator: TypeAlias = Literal["auto", "exact", "cvodes", "dopri5"]
Provider: TypeAlias = Literal["casadi", "system"]

LARGEST = 10**300
MAX_LENGTH = 400
"""Numbers may be so large, and their texts so long."""

MOST_STEPS = 10**18
MOST_LOOPS = 10**9
MOST_REPEATS = 1000

DEFAULT_DT = Fraction(1, 10)
"""Seconds a flow lasts where the model gives no horizon."""

Kind: TypeAlias = Literal["word", "integer", "decimal", "boolean", "range", "text", "constants"]


class UnknownOption(Mistake):
    """An option name or value that does not exist; the message says what does."""


class UnknownName(UnknownOption, TypeError):
    """An option name that does not exist. What Python raises for a keyword argument that a function does not
    take: TorchRL tries keywords and leaves out those that are refused so.
    """


@dataclass(frozen=True, slots=True)
class Option:
    """All that is known of one option.

    A "word" is one of `words`, or one of `deprecated`, which stands for another. Numbers are at least
    `least`, above it where `open`, integers at most `most`. `episode` is the name in `@episode`, "" where
    that cannot set it; integers are at least `least_in_episode` there.
    """

    name: str
    kind: Kind
    default: Any
    help: str
    words: tuple[str, ...] = ()
    least: int | None = None
    open: bool = False
    most: int = MOST_STEPS
    episode: str = ""
    least_in_episode: int | None = None
    deprecated: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def flag(self) -> str:
        """The flag on the command line."""
        return f"--{self.name.replace('_', '-')}"

    def converted(self, value: Any) -> Any:
        """The value as `Options` holds it. Raises `UnknownOption`."""
        if value is None and self.default is None:
            return None
        match self.kind:
            case "word":
                return self._word(value)
            case "integer":
                return self._integer(value)
            case "decimal":
                number = self._decimal(value)
                return float(number) if isinstance(self.default, float) else number
            case "boolean":
                if not isinstance(value, bool):
                    raise UnknownOption(f"`{self.name}` takes True or False, not {value!r}")
                return value
            case "range":
                return _range(self.name, value)
            case "text":
                return str(value)
            case "constants":
                return _constants(self.name, value)

    def _word(self, value: Any) -> str:
        if isinstance(value, bool) and "true" in self.words:
            value = str(value).lower()
        value = self.deprecated.get(value, value) if isinstance(value, str) else value
        if value not in self.words:
            raise UnknownOption(f"`{self.name}` takes {', '.join(map(repr, self.words))}, not {value!r}")
        return cast("str", value)

    def _integer(self, value: Any) -> int:
        least = self.least or 0
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= self.most:
            raise UnknownOption(f"`{self.name}` takes a whole number from {least} to {self.most:,}")
        return value

    def _decimal(self, value: Any) -> Fraction:
        number = exact_number(self.name, value)
        if self.least is not None and self.open and number <= self.least:
            raise UnknownOption(f"`{self.name}` must be positive, not {number}")
        if self.least is not None and number < self.least:
            raise UnknownOption(f"`{self.name}` must not be negative, but is {number}")
        return number


def _constants(option: str, value: Any) -> tuple[tuple[str, Fraction], ...]:
    if not isinstance(value, Mapping):
        raise UnknownOption(f"`{option}` takes names with values, not {value!r}")
    given = cast("Mapping[str, Any]", value)
    return tuple(sorted((name, exact_number(f"{option}[{name}]", v)) for name, v in given.items()))


def _range(name: str, value: Any) -> tuple[Fraction, Fraction]:
    """`LO:HI`, with or without brackets, or two numbers."""
    ends = value.strip().strip("[]").split(":") if isinstance(value, str) else value
    if not isinstance(ends, list | tuple) or len(found := cast("list[Any]", ends)) != 2:
        raise UnknownOption(f"`{name}` takes LO:HI, not {value!r}")
    low, high = (exact_number(name, end) for end in found)
    if low >= high:
        raise UnknownOption(f"`{name}` takes LO:HI with LO below HI, not {value!r}")
    return low, high


def exact_number(name: str, value: Any) -> Fraction:
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


def _option(default: Any, help: str, **facts: Any) -> Any:
    """A field of `Options`; `facts` are those of `Option` that do not follow from name, type and default."""
    return field(default=default, metadata={"help": help, **facts})


POSITIVE: dict[str, Any] = {"least": 0, "open": True}


@dataclass(frozen=True, slots=True)
class Options:
    """Every option of an environment; the reference says what each one means.

    `dt` None means: the model's own horizon; in a problem without a loop the end of the domain, if that
    is met within `max_flow` seconds; else `DEFAULT_DT`.
    """

    entry: str | None = _option(
        None, "Entry of a KeYmaera X archive that holds several, by name or number.", episode=""
    )
    constants: tuple[tuple[str, Fraction], ...] = _option(
        (), "Fixes constants by name (`--set NAME=VALUE`).", episode=""
    )
    max_episode_steps: int = _option(
        1000,
        "Truncate episodes after so many steps; 0: never.",
        episode="max_steps",
        least_in_episode=1,
    )
    default_bound: tuple[Fraction, Fraction] | None = _option(
        None, "LO:HI, limits of names that neither a bound nor the precondition limits."
    )
    dt: Fraction | None = _option(None, "Longest time of a continuous evolution, in seconds.", **POSITIVE)
    max_flow: Fraction = _option(
        Fraction(1000),
        "Seconds in which its domain may end a flow without a clock, in a problem without a loop.",
        **POSITIVE,
    )
    duration: Duration = _option(
        "max", "Flows last as long as they may, a random part of that, or one the agent chooses."
    )
    on_blocked: OnBlocked = _option("fallback", "What happens to a step whose requested run blocks.")
    mask_depth: MaskDepth = _option(
        "flow", "Masks look up to the first motion of a step, or follow alternatives to its end."
    )
    blocked_penalty: float = _option(0.0, "Added to the reward of such a step.")
    stall_limit: int = _option(
        0, "Truncate after so many zero-duration steps in a row; 0: never.", least_in_episode=1
    )
    action_format: Literal["auto", "dict", "box", "discrete", "multidiscrete"] = _option(
        "auto", "How decisions become an action space."
    )
    action_map: Literal["project", "squash"] = _option(
        "project", "How continuous actions meet their admissible set."
    )
    observe_constants: bool = _option(True, "Observe the sampled constants too.")
    obs_dtype: Literal["float32", "float64"] = _option(
        "float32", "Type of observations and continuous actions."
    )
    observation_bounds: Literal["declared", "unbounded"] = _option(
        "declared", "Limits of the observation space."
    )
    tolerance: Fraction = _option(Fraction(1, 10**9), "Relative tolerance of annotated predicates.", least=0)
    safety_check: Literal["continuous", "step", "flows"] = _option(
        "continuous",
        "Watch safety along the last motion of a step, after steps only, or along all motion.",
        deprecated={"auto": "continuous"},
    )
    integrator: Integrator = _option("auto", "How a differential equation is solved.")
    stiff: Literal["auto", "true", "false"] = _option(
        "auto", "Solve with the method for stiff equations; auto: as the model suggests."
    )
    rtol: Fraction = _option(Fraction(1, 10**9), "Relative tolerance of CVODES and dopri5.", **POSITIVE)
    atol: Fraction = _option(Fraction(1, 10**11), "Absolute tolerance of CVODES and dopri5.", **POSITIVE)
    progress_failure: Literal["due", "literal"] = _option(
        "due", "When a progress predicate with on_failure fails."
    )
    initial_distribution: Literal["uniform", "target", "z3"] = _option(
        "uniform", "How initial states are drawn: uniformly, or near random targets, in C or by Z3."
    )
    monitor_every_step: bool = _option(
        False, "Judge every step by the exported monitor; a violation is an error."
    )
    max_repeat: int = _option(
        8, "How often other loops inside a step may be repeated.", least=0, most=MOST_REPEATS
    )
    max_loop: int = _option(
        10_000,
        "Iterations of while loops in one step after which it counts as diverged.",
        least=1,
        most=MOST_LOOPS,
    )
    loop: int | None = _option(
        None, "Which of several top-level loops is the episode's, counted from 1.", least=1
    )
    native: bool | None = _option(
        None,
        "Compile for this processor alone, or for all of its kind (default: for all where `-o` is given).",
        episode="",
    )
    debug: bool = _option(
        False, "Compile quickly and with debugging symbols, to much slower code.", episode=""
    )
    sundials: Provider = _option(
        "casadi", "Which SUNDIALS solves flows: that of casadi, or an installed one.", episode=""
    )
    given: frozenset[str] = field(default=frozenset(), repr=False)
    """The options that were given in code, which `@episode` does not change."""


_KINDS: dict[Any, Kind] = {
    bool: "boolean",
    bool | None: "boolean",
    int: "integer",
    int | None: "integer",
    float: "decimal",
    Fraction: "decimal",
    Fraction | None: "decimal",
    str | None: "text",
    tuple[Fraction, Fraction] | None: "range",
    tuple[tuple[str, Fraction], ...]: "constants",
}
"""What the type of a field says; all others are words."""


def _record(option: "Field[Any]") -> Option:
    kind = _KINDS.get(option.type, "word")
    facts: dict[str, Any] = {"episode": option.name, **option.metadata}
    words = get_args(option.type) if kind == "word" else ()
    return Option(name=option.name, kind=kind, default=option.default, words=words, **facts)


OPTIONS: Mapping[str, Option] = {f.name: _record(f) for f in fields(Options) if f.name != "given"}
IN_EPISODE: Mapping[str, Option] = {o.episode: o for o in OPTIONS.values() if o.episode}
"""The options that `@episode` may set, by their names there."""


def as_words(options: Options) -> dict[str, str]:
    """Options as they decide what is built."""
    return {f.name: str(getattr(options, f.name)) for f in fields(options) if f.name != "given"}


def with_options(options: Options, given: Mapping[str, Any]) -> Options:
    """`options` with the given ones replaced, each checked and converted.

    Raises `UnknownName` or `UnknownOption` for a name or value that does not exist.
    """
    changes: dict[str, Any] = {}
    for name, value in given.items():
        if name not in OPTIONS:
            said = f"no option `{name}` (unexpected keyword argument '{name}')"
            raise UnknownName(f"{said}; the options are {', '.join(sorted(OPTIONS))}")
        if instead := deprecation(name, value):
            warn(instead, DeprecationWarning, stacklevel=2)
        changes[name] = OPTIONS[name].converted(value)
    return replace(options, **changes, given=frozenset((*options.given, *changes)))


def current(name: str, value: Any) -> Any:
    """The value that a deprecated one stands for; any other value itself."""
    return OPTIONS[name].deprecated.get(value, value) if isinstance(value, str) else value


def deprecation(name: str, value: Any) -> str:
    """What to use instead of a value that is deprecated; "" of others."""
    if not (isinstance(value, str) and value in OPTIONS[name].deprecated):
        return ""
    return f"`{name}={value}` is deprecated: use `{name}={current(name, value)}`, its new name"


def under(options: Options, episode: Mapping[str, Any]) -> Options:
    """`options` completed by those of `@episode`; what was given in code stays.

    Raises `UnknownOption`.
    """
    rest = {name: value for name, value in episode.items() if name not in options.given}
    return replace(with_options(options, rest), given=options.given)
