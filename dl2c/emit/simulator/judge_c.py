"""Rewards, the end of episodes and observations in C (semantics 6 and 7).

Leaf functions of predicates, precondition and postcondition, then `model_facts`, `model_revise`,
`model_precondition`, `model_derive`, `model_observe`; `model_judge` and `model_shapes` with leaf
functions of rewards, for a file of their own.
"""

import math
from collections.abc import Sequence

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import BYTE, LANES, each_flag, each_lane, function, in_each_lane, place, wrapped
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import lane, slot
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.paths_c import guard_conditions
from dl2c.flows.watch import watches_of
from dl2c.ir.model import TRUE, Bound, Formula, Model, Predicate, Rank, Symbol, Term, rank
from dl2c.ir.printer import print_formula, print_term
from dl2c.ir.slack import equalities_relaxed
from dl2c.lower.observations import fixed_entries, observation_limits, observed

STATE = "const real *x, const real *p"
STATUS = {"none": "DL2C_NONE", "success": "DL2C_SUCCESS", "failure": "DL2C_FAILURE"}
ENDS = {"terminate": "DL2C_TERMINATE", "truncate": "DL2C_TRUNCATE"}


def judge_functions(build: BuildPlan, leaves: Leaves) -> list[str]:
    """All functions of this file."""
    model = build.model
    facts = _fact_conditions(model, leaves)
    return [
        _facts(facts),
        _facts_and_guards(build, facts, leaves),
        _revise(model),
        _precondition(build, leaves),
        _derive(leaves),
        *_observe(build),
    ]


def reward_functions(model: Model, leaves: Leaves) -> list[str]:
    """What rewards, penalties and shapes decide, and with them the endings."""
    return [_judge(model, leaves), _shapes(model, leaves)]


def fact_names(model: Model) -> list[str]:
    """Enumerators of the conditions that every post-state is tested for."""
    names = [f"F_{p.name}_holds" for p in model.predicates]
    names += [f"F_{p.name}_due" for p in model.predicates if p.due is not None]
    names += [f"F_{p.name}_failed" for p in model.predicates if p.category == "progress"]
    return [*names, "F_postcondition"]


def checked_precondition(build: BuildPlan) -> Formula:
    """What a given state must satisfy: P, equalities within the tolerance where doubles may miss them."""
    formula = build.model.precondition
    return equalities_relaxed(formula, build.options.tolerance) if _is_rounded(build) else formula


def _is_rounded(build: BuildPlan) -> bool:
    return build.sampling is None or build.sampling.certificate == "witness"


def _precondition(build: BuildPlan, leaves: Leaves) -> str:
    formula = checked_precondition(build)
    about = "The problem's P, strict."
    if _is_rounded(build):
        about = "The problem's P, equalities within the tolerance, all else strict."
    holds = leaves.condition("problem_precondition", formula, print_formula(formula))
    return function(f"static inline bool model_precondition({STATE})", [f"return {holds};"], about)


def _derive(leaves: Leaves) -> str:
    """Comes after all that names derived constants."""
    body: list[str] = []
    for term, symbol in leaves.derived.symbols.items():
        value = leaves.term(f"set_{symbol.name}", term, f"{symbol.name} = {print_term(term)}")
        body += wrapped(f"{slot(symbol)} = {value};")
    return function(
        "static inline void model_derive(real *p)",
        body,
        "Derived constants, behind those that they are made of.   p: (NP)",
    )


def _fact_conditions(model: Model, leaves: Leaves) -> list[tuple[str, str]]:
    """Which flag says what of a post-state, and when it does."""
    conditions: list[tuple[str, str]] = []

    def add(fact: str, name: str, formula: Formula, about: str) -> None:
        holds = leaves.condition(name, leaves.derived.in_formula(formula), about, lane)
        conditions.append((f"facts[{fact} * row + i]", holds))

    for predicate in model.predicates:
        name, where = predicate.name, place(predicate.span)
        about = f"{where}  @{predicate.category} {name}: {print_formula(predicate.formula)}, within tolerance"
        add(f"F_{name}_holds", f"{name}_holds", predicate.relaxed, about)
        if predicate.due is not None:
            about = f"{where}  {name} is due: {print_formula(predicate.due)}"
            add(f"F_{name}_due", f"{name}_due", predicate.due, about)
    post = TRUE if model.postcondition is None else model.postcondition
    add("F_postcondition", "problem_postcondition", post, f"the problem's Q: {print_formula(post)}")
    return conditions


def _facts(facts: list[tuple[str, str]]) -> str:
    return function(
        f"DL2C_INLINE void model_facts({LANES}, int64_t row, uint8_t *restrict facts)",
        each_flag(facts),
        "What a post-state is tested for.   facts: (NFACT, row)",
    )


def _facts_and_guards(build: BuildPlan, facts: list[tuple[str, str]], leaves: Leaves) -> str:
    """Few enough share what they are made of."""
    if len(facts) + len(build.paths.of(0)) <= BYTE:
        body = each_flag([*facts, *guard_conditions(build, 0, leaves)])
    else:
        arguments = "x, p, stride, count"
        body = [f"model_facts({arguments}, row, facts);", f"model_guards(0, {arguments}, enabled);"]
    return function(
        f"DL2C_INLINE void model_facts_and_guards({LANES}, int64_t row, uint8_t *restrict facts, "
        "uint8_t *restrict enabled)",
        body,
        "Both of a post-state: what it is tested for, and which paths of point 0 pass their tests.   "
        "facts: (NFACT, row)   enabled: (paths, stride)",
    )


def _revise(model: Model) -> str:
    """What happened on the way, and that the time is up."""
    watched = {watch.predicate: w for w, watch in enumerate(watches_of(model))}
    body: list[str] = []
    for k, predicate in enumerate(model.predicates):
        holds = f"facts[F_{predicate.name}_holds * row + i]"
        seen = f"watch[{watched[k]} * row + i]" if k in watched else ""
        if predicate.category == "safety" and seen:
            body += each_lane(holds, f"{holds} & ({seen} != DL2C_FAILED)")
        if predicate.category == "progress":
            due = "late[i]" if predicate.due is None else f"facts[F_{predicate.name}_due * row + i]"
            failed = f"(!{holds}) & {due}"
            if seen:
                failed = f"({seen} == DL2C_FAILED) | ({failed} & ({seen} != DL2C_MET))"
            body += each_lane(f"facts[F_{predicate.name}_failed * row + i]", failed)
    return function(
        "DL2C_INLINE void model_revise(int64_t count, const uint8_t *restrict watch, "
        "const uint8_t *restrict late, int64_t row, uint8_t *restrict facts)",
        body,
        "Completes the facts of post-states by what happened in the step.   facts: (NFACT, row)   "
        "watch: (NWATCH, row)   late: (count)",
    )


def _judge(model: Model, leaves: Leaves) -> str:
    body = ["dl2c_unjudged(count, judged);"]
    for predicate in model.predicates:
        body += _rewards(predicate, leaves)
        if predicate.category == "safety":
            good = f"facts[F_{predicate.name}_holds * row + i]"
            body += each_lane("judged->cost[i]", f"judged->cost[i] + !{good}")
    body += ["for (int64_t i = 0; i < count; i++) {", *(f"  {line}" for line in _endings(model)), "}"]
    return function(
        f"DL2C_INLINE void model_judge({LANES}, const uint8_t *restrict facts, int64_t row, "
        "dl2c_judgement *restrict judged)",
        body,
        "Sums the rewards of all predicates; of those that end the episode the most important wins.",
    )


def _rewards(predicate: Predicate, leaves: Leaves) -> list[str]:
    """Adds reward or penalty, then the shape."""
    good = f"facts[F_{predicate.name}_holds * row + i]"
    parts = (
        ("reward", predicate.reward, good),
        ("penalty", predicate.penalty, f"!{good}"),
        ("shape", predicate.shape, "true"),
    )
    return [
        line
        for word, term, when in parts
        if term is not None
        for line in _reward(f"{predicate.name}_{word}", term, when, leaves)
    ]


def _reward(name: str, term: Term, when: str, leaves: Leaves) -> list[str]:
    """Adds a reward term; one without a finite value adds nothing and says so."""
    about = f"{name.replace('_', ' ')} = {print_term(term)}"
    term = leaves.derived.in_term(term)
    value = leaves.term(name, term, about, lane)
    defined = leaves.defined(f"{name}_defined", [term], "it has a value", lane)
    if defined is None:
        return each_lane("judged->reward[i]", f"judged->reward[i] + dl2c_select({when}, {value}, 0.0)")
    return in_each_lane(f"dl2c_earn({when}, {defined}, {value}, i, judged);")


def _shapes(model: Model, leaves: Leaves) -> str:
    """What a step without a run earns."""
    body: list[str] = []
    for predicate in model.predicates:
        if predicate.shape is None:
            continue
        name = f"{predicate.name}_shape"
        about = f"{name.replace('_', ' ')} = {print_term(predicate.shape)}"
        shape = leaves.derived.in_term(predicate.shape)
        value = leaves.term(name, shape, about)
        defined = leaves.defined(f"{name}_defined", [shape], "it has a value")
        added = value if defined is None else f"dl2c_select({defined}, {value}, 0.0)"
        body += wrapped(f"sum = sum + {added};")
    return function(
        f"static inline real model_shapes({STATE})",
        ["real sum = 0.0;", *body, "return sum;"] if body else ["return 0.0;"],
        "The shapes of all predicates together.",
    )


def _endings(model: Model) -> list[str]:
    """Triggers as selections, the least important first; a `continue` counts only where nothing ends."""
    ending: list[tuple[Rank, str]] = []
    going_on: list[tuple[Rank, str]] = []
    for k, predicate in enumerate(model.predicates):
        good = f"facts[F_{predicate.name}_holds * row + i]"
        for trigger, when in ((predicate.on_success, good), (predicate.on_failure, _failed(predicate, good))):
            if trigger is None:
                continue
            status = STATUS[trigger.status]
            if trigger.action == "continue":
                line = f"ending.status = dl2c_pick({when}, {status}, ending.status);"
                going_on.append((rank(k, predicate, trigger), line))
            else:
                fired = f"{when}, {ENDS[trigger.action]}, {status}, DL2C_REASON_PREDICATE + {k}"
                ending.append((rank(k, predicate, trigger), f"dl2c_trigger({fired}, &ending);"))
    lines = [line for found in (going_on, ending) for _, line in sorted(found, reverse=True)]
    return [
        "dl2c_ending ending = {DL2C_GOES_ON, DL2C_NONE, DL2C_REASON_NONE};",
        *(part for line in lines for part in wrapped(line)),
        "dl2c_ends(ending, i, judged);",
    ]


def _failed(predicate: Predicate, good: str) -> str:
    """When a predicate counts as failed; a progress predicate only once its obligation is due."""
    return f"facts[F_{predicate.name}_failed * row + i]" if predicate.category == "progress" else f"!{good}"


def _observe(build: BuildPlan) -> list[str]:
    entries = observed(build.model, build.options)
    varying = len(entries) - fixed_entries(build.model, build.options)
    constants = "const real *restrict p, int64_t stride, int64_t count"
    about = "inside their declared bounds.   obs:"
    return [
        function(
            f"DL2C_INLINE void model_observe({LANES}, {_OBSERVED})",
            _clipped(build, entries[:varying]),
            f"Observed variables, {about} (NOBS - NFIXED, row)",
        ),
        function(
            f"DL2C_INLINE void model_observe_constants({constants}, {_OBSERVED})",
            _clipped(build, entries[varying:]),
            f"Observed constants, {about} (NFIXED, row)",
        ),
    ]


_OBSERVED = "int64_t row, dl2c_obs *restrict obs, uint8_t *restrict saturated"


def _clipped(build: BuildPlan, entries: Sequence[tuple[str, Symbol, Bound]]) -> list[str]:
    kind = "float" if build.options.obs_dtype == "float32" else "double"
    suffix = "f" if kind == "float" else ""
    body = ["for (int64_t i = 0; i < count; i++) {", "  int32_t clipped = 0;"]
    for k, (_, symbol, bound) in enumerate(entries):
        low, high = observation_limits(bound, build.options)
        limits = f"{_limit(low, suffix)}, {_limit(high, suffix)}"
        value = f"dl2c_observe_{kind}({lane(symbol)}, {limits}, &clipped)"
        body += [f"  {line}" for line in wrapped(f"obs[{k} * row + i] = {value};")]
    return [*body, "  saturated[i] = (uint8_t)clipped;", "}"]


def _limit(value: float, suffix: str) -> str:
    if math.isinf(value):
        return "-INFINITY" if value < 0 else "INFINITY"
    return number(value) + suffix
