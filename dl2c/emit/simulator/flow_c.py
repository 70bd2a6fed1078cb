"""Flows in C: the exact kernel of one ODE as straight-line code (see dl2c/flows/exact.py).

For flow k: leaf functions of horizon and domain, then `flowK_at`
(the state after a time), `flowK_stays` (the domain) and `flowK_motion` (how long the flow
lasts and where it ends), all without branches; at the end `model_motion` and `model_at`,
which select one.
"""

import re

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import comment, function, place, wrapped
from dl2c.emit.leaf import Leaves, Locals
from dl2c.emit.names import after, index, slot
from dl2c.emit.plan import BuildPlan
from dl2c.flows.exact import Edge, ExactPlan
from dl2c.flows.kernel import FlowPlan
from dl2c.flows.solution import Solution
from dl2c.ir.logic import domain_at_end
from dl2c.ir.model import TRUE, Flow, Symbol
from dl2c.ir.printer import print_flow, print_formula, print_term

EXITS = {"closed": "dl2c_exit_nonnegative", "open": "dl2c_exit_positive", "unequal": "dl2c_exit_nonzero"}


def flow_functions(build: BuildPlan, leaves: Leaves) -> list[str]:
    """All functions of all flows."""
    texts: list[str] = []
    for k, plan in enumerate(build.flows):
        texts.append(_stays(k, plan, leaves))
        if plan.solution is not None:
            texts.append(_at(k, plan.flow, plan.solution, leaves))
        if plan.quick is not None:
            texts.append(_motion(k, plan.quick, leaves))
    texts += [_model_motion(build), _model_at(build), _model_inside(build)]
    texts += [_model_begin(build, leaves), _model_settle(build, leaves)]
    return [t for t in texts if t]


def _model_motion(build: BuildPlan) -> str:
    quick = [k for k, plan in enumerate(build.flows) if plan.quick is not None]
    body = [f"if (flow == {k}) return flow{k}_motion(x, p, y, duration);" for k in quick]
    return function(
        "static inline int64_t model_motion(int flow, const real *x, const real *p, real *y, real *duration)",
        [*body, "return DL2C_UNDEFINED;"],
        "Moves x along a simple flow into y as long as its domain allows.",
    )


def _model_at(build: BuildPlan) -> str:
    solved = [k for k, plan in enumerate(build.flows) if plan.solution is not None]
    body = [f"if (flow == {k}) flow{k}_at(x, p, tau, y);" for k in solved]
    return function(
        "static inline void model_at(int flow, const real *x, const real *p, real tau, real *y)",
        body,
        "Moves x along a flow for the time tau into its copy y.",
    )


def _model_inside(build: BuildPlan) -> str:
    bounded = [k for k, plan in enumerate(build.flows) if domain_at_end(plan.flow) != TRUE]
    body = [f"if (flow == {k}) return flow{k}_stays(y, p);" for k in bounded]
    return function(
        "static inline bool model_inside(int flow, const real *y, const real *p)",
        [*body, "return true;"],
        "Whether y is a state in which a flow may end.",
    )


def _model_begin(build: BuildPlan, leaves: Leaves) -> str:
    body: list[str] = []
    for k, plan in enumerate(build.flows):
        terms = [] if plan.solution is None else [c for cs in plan.solution.variables.values() for c in cs]
        terms += [h.bound for h in plan.flow.horizons]
        defined = leaves.defined(f"flow{k}_begins", terms, "all coefficients have a value")
        limits, lines = _limits(k, plan.flow, leaves)
        lines.append(f"real end = {limits[0]};")
        lines += [f"end = dl2c_select({name} < end, {name}, end);" for name in limits[1:]]
        conditions = [] if defined is None else [defined]
        conditions += [f"isfinite({limit})" for limit in limits if limit.startswith("left")]
        lines += ["*horizon = end;", *wrapped(f"return {' & '.join(conditions) or 'true'};")]
        body += [f"if (flow == {k}) {{", *(f"  {line}" for line in lines), "}"]
    return function(
        "static inline bool model_begin(int flow, const real *x, const real *p, real *horizon)",
        [*body, "return false;"],
        "How long the clocks of a flow let it last. False where a value is undefined.",
    )


def _model_settle(build: BuildPlan, leaves: Leaves) -> str:
    body: list[str] = []
    for k, plan in enumerate(build.flows):
        lines = _limits(k, plan.flow, leaves)[1]
        lines += _clocks(plan.flow, "end")
        for margin, snap in plan.snaps:
            target = leaves.term(f"flow{k}_bound{margin}", snap.target, f"{snap.variable} at its bound")
            snapped = f"y[{index(Symbol(snap.variable, 'variable'))}]"
            lines.append(f"if (sign[{margin}] == 0) {snapped} = {target};")
        body += [f"if (flow == {k}) {{", *(f"  {line}" for line in lines), "}"] if lines else []
    return function(
        "static inline void model_snap(int flow, const real *x, const real *p, real end, "
        "const int8_t *sign, real *y)",
        body,
        "Where a flow ends after the time end with margins of these signs, clocks that ran out and "
        "bounds that were met hold exactly.",
    )


def _at(k: int, flow: Flow, solution: Solution, leaves: Leaves) -> str:
    local = Locals(leaves)
    body: list[str] = []
    for variable, coefficients in solution.variables.items():
        if len(coefficients) == 1:
            continue
        terms = [_operand(local.term(c)) for c in coefficients]
        value = {"1.0": "tau", "-1.0": "-tau"}.get(terms[-1], f"{terms[-1]} * tau") + f" + {terms[-2]}"
        for term in reversed(terms[:-2]):
            value = f"({value}) * tau + {term}"
        body += wrapped(f"y[{index(Symbol(variable, 'variable'))}] = {value};")
    return function(
        f"static inline void flow{k}_at(const real *x, const real *p, real tau, real *y)",
        [*local.begun(), *body],
        f"{place(flow.span)}  {print_flow(flow)} solved: y is x moved by the time tau.",
    )


def _operand(expression: str) -> str:
    """An expression that stands beside any operator."""
    return expression if re.fullmatch(r"-?[\w.]+", expression) else f"({expression})"


def _motion(k: int, plan: ExactPlan, leaves: Leaves) -> str:
    terms = [c for cs in plan.solution.variables.values() for c in cs]
    terms += [c for w in plan.edges for c in w.margin] + [h.bound for h in plan.flow.horizons]
    defined = leaves.defined(f"flow{k}_defined", terms, "all coefficients have a value")
    limits, body = _limits(k, plan.flow, leaves)
    local = Locals(leaves)
    crossings = [line for j, edge in enumerate(plan.edges) for line in _exit(j, edge, local)]
    body += [*local.begun(), *crossings]
    exits = [f"exit{j}" for j in range(len(plan.edges))]
    body += _reached(k, plan, exits) if plan.flow.reach is not None else [f"real end = {limits[0]};"]
    body += [f"end = dl2c_select({name} < end, {name}, end);" for name in (*limits[1:], *exits)]
    short = [f"hit{j}" for j, w in enumerate(plan.edges) if w.kind in ("open", "unequal")]
    used = {*short, *(f"hit{j}" for j, w in enumerate(plan.edges) if w.snap is not None)}
    hits = {f"hit{j}": name for j, name in enumerate(exits)}
    body += [f"const bool {hit} = {name} <= end;" for hit, name in hits.items() if hit in used]
    body.append("const bool moves = end > 0.0;")
    if short:
        body.append(f"end = dl2c_select({' | '.join(short)}, dl2c_before(end), end);")
    conditions = [] if defined is None else [defined]
    conditions += [f"isfinite({limit})" for limit in limits if limit.startswith("left")]
    conditions.append(f"((!moves) | ({_finite('y', plan)}))")
    doubts = [f"doubt{j}" for j, w in enumerate(plan.edges) if w.kind != "equal" and len(w.margin) > 2]
    body += [
        "",
        "dl2c_copy(x, NX, y);",
        f"flow{k}_at(x, p, end, y);",
        *_snapped(k, plan, leaves),
        *wrapped(f"const bool defined = {' & '.join(conditions)};"),
        f"const bool inside = !moves | {_ends_inside(k, plan.flow)};",
        *(f"y[{v}] = dl2c_select(moves, y[{v}], x[{v}]);" for v in _moving(plan)),
        "*duration = dl2c_select(moves, end, 0.0);",
        *([f"if ({' | '.join(doubts)}) return DL2C_DOUBTFUL;"] if doubts else []),
        "return !defined ? DL2C_UNDEFINED : inside ? DL2C_ARRIVED : DL2C_OUTSIDE;",
    ]
    head = f"static inline int64_t flow{k}_motion(const real *x, const real *p, real *y, real *duration)"
    return function(head, body, f"{place(plan.flow.span)}  {print_flow(plan.flow)}")


def _reached(k: int, plan: ExactPlan, exits: list[str]) -> list[str]:
    """How long a flow without a clock may last: longer than `cap` where its domain ends it in time."""
    flow = plan.flow
    assert flow.reach is not None and flow.cap is not None
    return [
        f"const real reach = {number(float(flow.reach))};",
        "real first = (real)INFINITY;",
        *(f"first = dl2c_select({name} < first, {name}, first);" for name in exits),
        "const bool met = first <= reach;",
        "first = dl2c_select(met, first, 0.0);",
        "real there[NX];",
        "dl2c_copy(x, NX, there);",
        f"flow{k}_at(x, p, first, there);",
        f"const bool bounded = met & {_finite('there', plan)};",
        f"real end = dl2c_select(bounded, reach, {number(float(flow.cap))});",
    ]


def _ends_inside(k: int, flow: Flow) -> str:
    return "true" if domain_at_end(flow) == TRUE else f"flow{k}_stays(y, p)"


def _moving(plan: ExactPlan) -> list[str]:
    """Indices of the variables that the flow changes."""
    solution = plan.solution.variables
    return [index(Symbol(v, "variable")) for v, cs in solution.items() if len(cs) > 1]


def _finite(state: str, plan: ExactPlan) -> str:
    """That a finite state is finite still where the flow has led it."""
    return " & ".join(f"dl2c_finite({state}[{v}])" for v in _moving(plan)) or "true"


def _stays(k: int, plan: FlowPlan, leaves: Leaves) -> str:
    """The domain of a flow as a condition of y; nothing where there is none."""
    inside = domain_at_end(plan.flow)
    if inside == TRUE:
        return ""
    about = f"{place(plan.flow.span)}  {print_formula(inside)}"
    holds = leaves.condition(f"flow{k}_inside", inside, about, after)
    head = f"static inline bool flow{k}_stays(const real *y, const real *p)"
    return function(head, [f"return {holds};"], "Whether y is in the domain of the flow.")


def _limits(k: int, flow: Flow, leaves: Leaves) -> tuple[list[str], list[str]]:
    """Names or numbers of the times at which the flow must end, and the lines that compute them."""
    limits: list[str] = []
    lines: list[str] = []
    for j, horizon in enumerate(flow.horizons):
        clock = Symbol(horizon.clock, "variable")
        bound = leaves.term(
            f"flow{k}_until{j}", horizon.bound, f"{horizon.clock} <= {print_term(horizon.bound)}"
        )
        lines += [f"const real until{j} = {bound};", f"const real left{j} = until{j} - {slot(clock)};"]
        limits.append(f"left{j}")
    if flow.cap is not None:
        limits.append(number(float(flow.cap)))
    return limits, lines


def _clocks(flow: Flow, end: str) -> list[str]:
    """A clock that ran out holds its limit exactly."""
    lines: list[str] = []
    for j, horizon in enumerate(flow.horizons):
        clock = f"y[{index(Symbol(horizon.clock, 'variable'))}]"
        lines.append(f"{clock} = dl2c_select(left{j} == {end}, until{j}, {clock});")
    return lines


def _exit(j: int, edge: Edge, local: Locals) -> list[str]:
    """When the motion leaves one condition of the domain."""
    about = comment(f"{place(edge.span)}  {' '.join(edge.span.text.split())}").split("\n")
    if edge.kind == "equal":
        return [*about, f"const real exit{j} = dl2c_exit_zero();"]
    padded = ", ".join([*map(local.term, edge.margin), "0.0", "0.0"][:3])
    leaves = f"{EXITS[edge.kind]}({padded})"
    if len(edge.margin) <= 2 and edge.kind != "unequal":
        leaves = f"dl2c_exit_linear({padded.rpartition(', ')[0]})"
    lines = [*about, *wrapped(f"const real exit{j} = {leaves};")]
    if len(edge.margin) > 2:
        lines += wrapped(f"const bool doubt{j} = dl2c_doubtful({padded});")
    return lines


def _snapped(k: int, plan: ExactPlan, leaves: Leaves) -> list[str]:
    """A clock that ran out and a bound that was met are met exactly (semantics 4, snap)."""
    lines = _clocks(plan.flow, "end")
    for j, edge in enumerate(plan.edges):
        if edge.snap is not None:
            target = leaves.term(f"flow{k}_snap{j}", edge.snap.target, f"{edge.snap.variable} at its bound")
            snapped = f"y[{index(Symbol(edge.snap.variable, 'variable'))}]"
            lines.append(f"{snapped} = dl2c_select(hit{j}, {target}, {snapped});")
    return lines
