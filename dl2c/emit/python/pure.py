"""An environment in plain Python: NumPy and Gymnasium, SciPy where motion has no closed form; no dl2c.

Comes in: everything known of an environment. Goes out: Python text to read, and to change by hand. What is
the same for every model is copied from `support.py`. Assumes that `refusal` found nothing.
"""

import ast
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path as File

import numpy as np

from dl2c.emit.names import python_attribute, python_value
from dl2c.emit.plan import BuildPlan
from dl2c.emit.python.expr import Bracketed, Expression, Writer, statement
from dl2c.emit.python.judge import JUDGEMENT, judge_functions
from dl2c.emit.python.parts import (
    flow_functions,
    number,
    path_function,
    path_table,
    precondition_function,
    start_function,
)
from dl2c.emit.python.text import agent_decisions, class_name, clean, file_name, headline, sections
from dl2c.flows.watch import surely_positive
from dl2c.ir.model import Constant, Model, Number, Term, Variable
from dl2c.lower.observations import observation_limits, observed
from dl2c.source import Source

ARGUMENTS = (
    ("render_mode", 'None, or `"ansi"` for a line of text.'),
    ("max_episode_steps", "steps after which an episode is truncated, 0 for none."),
    (
        "on_blocked",
        "what a request without a run does: `fallback` takes another alternative, `truncate` and "
        "`terminate` end the episode.",
    ),
    ("blocked_penalty", "is added to the reward of such a step."),
    ("stall_limit", "truncates after so many steps in a row that take no time, 0 for never."),
    ("constants", "values of constants that are not to be drawn, by name."),
)

SUPPORT = tuple(File(__file__).with_name(f"{name}.py") for name in ("support", "steps"))

FIRST = ("Failed", "Motion", "Flow", "Path")
"""Types of the support that tables of a model are made of."""

IMPORTS = {
    "math": "import math",
    "Callable": "from collections.abc import Callable, Sequence",
    "asdict": "from dataclasses import asdict, dataclass, fields, replace",
    "@cache": "from functools import cache",
    "pairwise": "from itertools import pairwise, zip_longest",
    "NamedTuple": "from typing import Any, ClassVar, NamedTuple",
    "gym": "\nimport gymnasium as gym",
    "np": "import numpy as np",
    "spaces": "from gymnasium import spaces",
    "solve_ivp": "from scipy.integrate import solve_ivp",
}
"""Imports by a name that needs them, in the order in which they stand."""


def pure_module(build: BuildPlan, source: Source) -> str:
    """The module of a model with this text."""
    writer = Writer(python_value, _nonzero(build.model))
    support = _support()
    model = [
        start_function(build, writer),
        precondition_function(build, writer),
        *(part for k in range(len(build.flows)) for part in flow_functions(build, k, writer)),
        *(path_function(build, k, writer) for k in range(len(build.paths.paths))),
        path_table(build),
        JUDGEMENT,
        *judge_functions(build, writer),
    ]
    own = [_state(build), _tables(build), *_rule("The model"), *(support[n] for n in FIRST[1:])]
    own += [*model, *_rule("The environment"), _class(build, support["SupportEnv"])]
    used = _used(own, support)
    kept = [text for name, text in support.items() if name in used and name not in (*FIRST[1:], "SupportEnv")]
    body = _spaced([*own, *_rule("What every such environment needs"), *kept])
    head = [text for name, text in IMPORTS.items() if re.search(rf"(?<!\w){name}\b", body)]
    for name in ("Sequence", "zip_longest"):
        if not re.search(rf"\b{name}\b", body):
            head = [line.replace(f", {name}", "") for line in head]
    return f"{_docstring(build, source)}\n\n" + "\n".join(head) + f"\n\n\n{body}"


def _docstring(build: BuildPlan, source: Source) -> str:
    return f'''"""{headline(build.model)}

Written by dl2c {build.version} from {file_name(source)}. It does not need dl2c: change what you like.
"""'''


def _nonzero(model: Model) -> Callable[[Term], bool]:
    """Whether a divisor is surely not zero."""
    positive = surely_positive(model)
    return lambda term: term.value != 0 if isinstance(term, Number) else positive(term)


def _rule(title: str) -> list[str]:
    """A comment that parts the module."""
    return [f"# {title} {'-' * (85 - len(title))}\n"]


def _spaced(parts: Iterable[str]) -> str:
    """Two lines between definitions, one between assignments."""
    text = ""
    before = ""
    for part in parts:
        plain = not re.match(r"(@|def |class )", part) and not re.match(r"(@|def |class )", before)
        text += ("" if not text else "\n" if plain else "\n\n") + part
        before = part
    return text


# Support ----------------------------------------------------------------------


def _support() -> dict[str, str]:
    """Every definition of the support by name, as it is written."""
    found: dict[str, str] = {}
    for file in SUPPORT:
        text = file.read_text(encoding="utf-8")
        lines = text.splitlines()
        for node in ast.parse(text).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found[node.name] = "\n".join(lines[node.lineno - 1 : node.end_lineno]) + "\n"
    return found


def _used(texts: Iterable[str], support: dict[str, str]) -> set[str]:
    """The definitions that these texts use, and what those use."""
    found: set[str] = set()
    waiting = list(texts)
    while waiting:
        names = set(re.findall(r"\b\w+\b", waiting.pop())) & support.keys() - found
        found |= names
        waiting += [support[name] for name in names]
    return found


# Data -------------------------------------------------------------------------


def _state(build: BuildPlan) -> str:
    model = build.model
    items: list[Variable | Constant] = [*model.variables, *model.constants]
    lines = ["@dataclass(frozen=True)", "class State:", '    """Variables, then constants."""', ""]
    for item in items:
        fixed = item.value if isinstance(item, Constant) and item.value is not None else 0
        about = ", ".join(part for part in (item.description, item.unit) if part)
        note = f"  # {clean(about)}" if about else ""
        lines.append(f"    {python_attribute(item.name)}: float = {number(fixed)}{note}")
    return "\n".join(lines) + "\n"


def _tables(build: BuildPlan) -> str:
    choices, inputs = agent_decisions(build)
    names = [name for name, _, _ in observed(build.model, build.options)]
    tables: list[tuple[str, Expression]] = [
        ("OBSERVED", Bracketed("", tuple(f'"{python_attribute(n)}"' for n in names), "[]")),
        (
            "CHOICES",
            Bracketed("", tuple(f'"{c.key}": {len(c.alternatives)}' for c in choices), "{}"),
        ),
        ("NO_INPUTS", Bracketed("", tuple(f'"{i.key}": 0.0' for i in inputs), "{}")),
        ("TOLERANCE", number(build.options.tolerance)),
        ("LARGEST", "1e100"),
        ("LOOPS", str(build.model.loops)),
    ]
    if any(f.solution is None for f in build.flows):
        tables += [("METHOD", '"DOP853"'), ("RTOL", "1e-10"), ("ATOL", "1e-12")]
    return "\n".join(line for name, entry in tables for line in statement(f"{name} = ", entry)) + "\n"


# The class --------------------------------------------------------------------


def _class(build: BuildPlan, support: str) -> str:
    """The environment: its own methods, then those of the support."""
    model, options = build.model, build.options
    lines = [f"class {class_name(model)}(gym.Env):", f'    """{headline(model)}', ""]
    lines += [f"    {line}" if line else "" for line in sections(build, ARGUMENTS)]
    modes = '{"render_modes": ["ansi"], "render_fps": 10}'
    lines += ['    """', "", f"    metadata: ClassVar[dict[str, Any]] = {modes}", ""]
    lines += [
        "    def __init__(",
        "        self,",
        "        render_mode: str | None = None,",
        "        *,",
        f"        max_episode_steps: int = {options.max_episode_steps},",
        f'        on_blocked: str = "{options.on_blocked}",',
        f"        blocked_penalty: float = {options.blocked_penalty!r},",
        f"        stall_limit: int = {options.stall_limit},",
        "        constants: dict[str, float] | None = None,",
        "    ) -> None:",
        "        self.render_mode = render_mode",
        "        self.max_episode_steps = max_episode_steps",
        "        self.on_blocked = on_blocked",
        "        self.blocked_penalty = blocked_penalty",
        "        self.stall_limit = stall_limit",
        "        self.constants = constants or {}",
        *_observation_space(build),
        *(f"        {line}" for line in _action_space(build)),
        "        self.state = State()",
        "        self._running = False",
        "        self._steps, self._stalled, self._time = 0, 0, 0.0",
        "",
    ]
    methods = support.split("\n", 1)[1]
    return "\n".join([*lines, methods.rstrip("\n"), "", *_actions(build)]) + "\n"


def _observation_space(build: BuildPlan) -> Iterator[str]:
    options = build.options
    limits = [observation_limits(b, options) for _, _, b in observed(build.model, options)]
    kind = f"np.{options.obs_dtype}"
    for k, name in enumerate(("low", "high")):
        row = [pair[k] for pair in limits]
        entries = Bracketed("", tuple(_limit(x, options.obs_dtype) for x in row), "[]")
        call = Bracketed("np.array", (entries, f"dtype={kind}"))
        yield from statement(f"{name} = ", call, "", 8)
    yield f"        self.observation_space = spaces.Box(low, high, dtype={kind})"


def _limit(value: float, kind: str) -> str:
    """Shortest that is this number in its type."""
    if not np.isfinite(value):
        return "np.inf" if value > 0 else "-np.inf"
    return str(np.float32(value)) if kind == "float32" else repr(value)


def _action_space(build: BuildPlan) -> list[str]:
    choices, inputs = agent_decisions(build)
    kind = f"np.{build.options.obs_dtype}"
    counts = [len(c.alternatives) for c in choices]
    if not inputs:
        one = counts[0] if counts else 1
        space = f"Discrete({one})" if len(counts) < 2 else f"MultiDiscrete({counts})"
        return [f"self.action_space = spaces.{space}"]
    entries = {i.key: f"spaces.Box({number(i.low)}, {number(i.high)}, (1,), {kind})" for i in inputs}
    entries |= {c.key: f"spaces.Discrete({n})" for c, n in zip(choices, counts, strict=True)}
    if choices:
        named = [f"parts[{key!r}] = {space}".replace("'", '"') for key, space in entries.items()]
        return ["parts: dict[str, spaces.Space] = {}", *named, "self.action_space = spaces.Dict(parts)"]
    low, high = ([number(getattr(i, side)) for i in inputs] for side in ("low", "high"))
    return [
        f"limits = np.array([[{', '.join(low)}], [{', '.join(high)}]], dtype={kind})",
        f"self.action_space = spaces.Box(limits[0], limits[1], dtype={kind})",
    ]


def _actions(build: BuildPlan) -> list[str]:
    """Between actions and decisions, both ways."""
    choices, inputs = agent_decisions(build)
    kind = f"np.{build.options.obs_dtype}"
    if choices and inputs:
        wanted = [
            "{key: int(action[key]) for key in CHOICES}",
            "{key: float(action[key][0]) for key in NO_INPUTS}",
        ]
        done = f"{{**{{k: np.array([v], {kind}) for k, v in inputs.items()}}, **choices}}"
    elif inputs:
        wanted = ["{}", "dict(zip(NO_INPUTS, map(float, action), strict=True))"]
        done = f"np.array(list(inputs.values()), dtype={kind})"
    elif len(choices) == 1:
        wanted = [f'{{"{choices[0].key}": int(action)}}', "{}"]
        done = f'choices["{choices[0].key}"]'
    else:
        wanted = ["dict(zip(CHOICES, map(int, action), strict=True))", "{}"]
        done = "np.array(list(choices.values()), dtype=np.int64)"
        if not choices:
            wanted, done = ["{}", "{}"], "0"
    return [
        "    def _request(self, action: Any) -> tuple[dict[str, int], dict[str, float]]:",
        '        """The decisions that an action asks for: discrete, continuous."""',
        *(
            [
                "        if not self.action_space.contains(action):",
                '            raise ValueError(f"{action} is outside of the action space")',
            ]
            if choices and not inputs
            else []
        ),
        f"        choices = {wanted[0]}",
        f"        inputs = {wanted[1]}",
        "        return choices, inputs",
        "",
        "    def _executed(self, choices: dict[str, int], inputs: dict[str, float]) -> Any:",
        '        """The action that asks for these decisions."""',
        f"        return {done}",
    ]
