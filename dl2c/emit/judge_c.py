"""Rewards, the end of episodes and observations in C (semantics 6 and 7).

Sections: leaf functions of predicates, rewards, precondition and postcondition, then
`model_judge`, `model_postcondition`, `model_precondition`, `model_observe`.
"""

import math
from fractions import Fraction

import numpy as np

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import LANES, each_lane, function, place
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import lane, slot
from dl2c.emit.plan import Environment
from dl2c.ir.model import TRUE, Bound, Formula, Model, Predicate, Symbol, Term, Trigger
from dl2c.ir.printer import print_formula, print_term
from dl2c.options import Options

STATE = "const real *x, const real *p"
STATUS = {"none": "DL2C_NONE", "success": "DL2C_SUCCESS", "failure": "DL2C_FAILURE"}
ENDS = {"terminate": "DL2C_TERMINATE", "truncate": "DL2C_TRUNCATE"}


def judge_functions(environment: Environment, leaves: Leaves) -> list[str]:
    """All functions of this file."""
    model = environment.model
    return [
        _facts(model, leaves),
        _judge(model, leaves),
        _precondition(model, leaves),
        _observe(environment, leaves),
    ]


def fact_names(model: Model) -> list[str]:
    """Enumerators of the conditions that every post-state is tested for."""
    names = [f"F_{p.name}_holds" for p in model.predicates]
    names += [f"F_{p.name}_due" for p in model.predicates if p.due is not None]
    return [*names, "F_postcondition"]


def _precondition(model: Model, leaves: Leaves) -> str:
    holds = leaves.condition("precondition_holds", model.precondition, print_formula(model.precondition))
    return function(
        f"static inline bool model_precondition({STATE})", [f"return {holds};"], "The problem's P, strict."
    )


def _facts(model: Model, leaves: Leaves) -> str:
    body: list[str] = []

    def add(fact: str, name: str, formula: Formula, about: str) -> None:
        nonlocal body
        body += each_lane(f"facts[{fact} * row + i]", leaves.condition(name, formula, about, lane))

    for predicate in model.predicates:
        name, where = predicate.name, place(predicate.span)
        about = f"{where}  @{predicate.category} {name}: {print_formula(predicate.formula)}, within tolerance"
        add(f"F_{name}_holds", f"{name}_holds", predicate.relaxed, about)
        if predicate.due is not None:
            about = f"{where}  {name} is due: {print_formula(predicate.due)}"
            add(f"F_{name}_due", f"{name}_due", predicate.due, about)
    post = TRUE if model.postcondition is None else model.postcondition
    add("F_postcondition", "postcondition_holds", post, f"the problem's Q: {print_formula(post)}")
    return function(
        f"DL2C_LANES static void model_facts({LANES}, int64_t row, uint8_t *restrict facts)",
        body,
        "What a post-state is tested for.   facts: (NFACT, row)",
    )


def _judge(model: Model, leaves: Leaves) -> str:
    body = ["*out = (dl2c_judgement){.status = DL2C_NONE};"]
    for k, predicate in enumerate(model.predicates):
        body.append(f"const bool good{k} = facts[F_{predicate.name}_holds * row];")
        body += _rewards(k, predicate, leaves)
        if predicate.category == "safety":
            body.append(f"out->cost += !good{k};")
    return function(
        f"static inline void model_judge({STATE}, const uint8_t *facts, int64_t row, dl2c_judgement *out)",
        [*body, *_endings(model)],
        "Sums the rewards of all predicates; of those that end the episode the most important wins.",
    )


def _rewards(k: int, predicate: Predicate, leaves: Leaves) -> list[str]:
    lines: list[str] = []
    parts = (
        ("reward", predicate.reward, f"if (good{k}) "),
        ("penalty", predicate.penalty, f"if (!good{k}) "),
        ("shape", predicate.shape, ""),
    )
    for word, term, when in parts:
        if term is not None:
            lines += _reward(f"{predicate.name}_{word}", term, when, leaves)
    return lines


def _reward(name: str, term: Term, when: str, leaves: Leaves) -> list[str]:
    """Adds a reward term; one without a finite value adds nothing and says so."""
    value = leaves.term(name, term, f"{name.replace('_', ' ')} = {print_term(term)}")
    defined = leaves.defined(f"{name}_defined", [term], "it has a value")
    if defined is None:
        return [f"{when}out->reward += {value};"]
    return [
        f"{when}{{" if when else "{",
        f"  if ({defined}) out->reward += {value};",
        "  else out->undefined = true;",
        "}",
    ]


def _endings(model: Model) -> list[str]:
    """Triggers as an if-chain, most important first; a `continue` counts only where nothing ends."""
    ending: list[tuple[tuple[int, int, int], list[str]]] = []
    going_on: list[str] = []
    for k, predicate in enumerate(model.predicates):
        fired = {"on_success": f"good{k}", "on_failure": _failed(k, predicate)}
        for trigger, when in (
            (predicate.on_success, fired["on_success"]),
            (predicate.on_failure, fired["on_failure"]),
        ):
            if trigger is None or when is None:
                continue
            if trigger.action == "continue":
                going_on.append(f"if ({when}) out->status = {STATUS[trigger.status]};")
            else:
                ending.append((_rank(k, predicate, trigger), _end(k, trigger, when)))
    lines: list[str] = []
    for j, (_, text) in enumerate(sorted(ending, key=lambda e: e[0])):
        head, *rest = text
        lines += [head if j == 0 else f"}} else {head}", *rest]
    if not ending:
        return going_on
    if going_on:
        lines += ["} else {", *(f"  {line}" for line in going_on)]
    return [*lines, "}"]


def _failed(k: int, predicate: Predicate) -> str | None:
    """When a predicate counts as failed; a progress predicate only once its obligation is due."""
    if predicate.category != "progress":
        return f"!good{k}"
    return None if predicate.due is None else f"!good{k} && facts[F_{predicate.name}_due * row]"


def _rank(k: int, predicate: Predicate, trigger: Trigger) -> tuple[int, int, int]:
    status = ("failure", "success", "none").index(trigger.status)
    return status, ("safety", "progress", "stability").index(predicate.category), k


def _end(k: int, trigger: Trigger, when: str) -> list[str]:
    return [
        f"if ({when}) {{",
        f"  out->end = {ENDS[trigger.action]};",
        f"  out->status = {STATUS[trigger.status]};",
        f"  out->reason = DL2C_REASON_PREDICATE + {k};",
    ]


def observed(model: Model, options: Options) -> list[tuple[str, Symbol, Bound]]:
    """The entries of an observation: observed variables, then sampled constants (semantics 7)."""
    entries = [(v.name, Symbol(v.name, "variable"), v.bound) for v in model.variables if v.observed]
    if options.observe_constants:
        entries += [(c.name, Symbol(c.name, "constant"), c.bound) for c in model.constants if c.value is None]
    return entries


def observation_limits(bound: Bound, options: Options) -> tuple[float, float]:
    """The declared bound rounded outward to the observation's type; infinite where open or not wanted."""
    if options.observation_bounds == "unbounded":
        return -math.inf, math.inf
    low = -math.inf if bound.low is None else _outward(bound.low, -1, options)
    return low, math.inf if bound.high is None else _outward(bound.high, 1, options)


def _outward(value: Fraction, direction: int, options: Options) -> float:
    kind = np.float32 if options.obs_dtype == "float32" else np.float64
    near = kind(float(value))
    if (Fraction(float(near)) - value) * direction < 0:
        near = np.nextafter(near, kind(direction * math.inf))
    return float(near)


def _observe(environment: Environment, leaves: Leaves) -> str:
    kind = "float" if environment.options.obs_dtype == "float32" else "double"
    suffix = "f" if kind == "float" else ""
    body: list[str] = []
    for k, (_, symbol, bound) in enumerate(observed(environment.model, environment.options)):
        low, high = observation_limits(bound, environment.options)
        if math.isinf(low) and math.isinf(high):
            body.append(f"obs[{k}] = ({kind}){slot(symbol)};")
        else:
            limits = f"{_limit(low, suffix)}, {_limit(high, suffix)}"
            body.append(f"obs[{k}] = dl2c_observe_{kind}({slot(symbol)}, {limits}, saturated);")
    return function(
        f"static inline void model_observe({STATE}, dl2c_obs *obs, uint8_t *saturated)",
        body,
        "Observed variables and constants, inside their declared bounds.",
    )


def _limit(value: float, suffix: str) -> str:
    if math.isinf(value):
        return "-INFINITY" if value < 0 else "INFINITY"
    return number(value) + suffix
