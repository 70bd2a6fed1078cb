"""What is watched along flows, in C: margins, their Taylor models, and conditions over their signs.

Margin j of a flow is positive inside its atom. `model_margin` is its value in a state, `model_taylor`
has models of all margins along a stretch, `model_condition` decides a formula from signs alone: 0 is
the domain, then for watch w 1 + 3w what must stay, 2 + 3w what is due, 3 + 3w the goal. `model_keeps_watches`
is a quick proof that no watch fails.
"""

from collections.abc import Mapping
from functools import partial

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import function, table, wrapped
from dl2c.emit.leaf import Leaves, Locals
from dl2c.emit.names import after, index
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.enclosed_c import Enclosed
from dl2c.emit.simulator.hull_c import event_free_function, over_atoms
from dl2c.emit.simulator.labels import Label, atom_name, margin_labels, quoted
from dl2c.emit.simulator.rates_c import selected
from dl2c.flows.kernel import KERNELS, QUICK, FlowPlan, constant_along
from dl2c.flows.watch import watches_of
from dl2c.ir.logic import atoms, conjunction, operands, symbols
from dl2c.ir.model import TRUE, And, Compare, Formula, Number, Or, Symbol, Term, Truth
from dl2c.ir.polynomial import Coefficients
from dl2c.ir.printer import print_formula

STATE = "const real *x, const real *p"
STAYS = {
    ">=": "dl2c_stays_nonnegative",
    ">": "dl2c_stays_positive",
    "!=": "dl2c_stays_nonzero",
    "=": "dl2c_stays_zero",
}
SPANS = ("constant", "line", "parabola")


def watch_functions(build: BuildPlan, leaves: Leaves) -> list[str]:
    """All functions of this file that the flows need."""
    return [
        *(_search_functions(build, leaves) if searched(build) else []),
        _holds(build),
        _keeps(build, leaves),
    ]


def searched(build: BuildPlan) -> bool:
    """Whether some flow is followed track by track, or may have to be."""
    return any(plan.kernel != "exact" or plan.margins for plan in build.flows)


def _search_functions(build: BuildPlan, leaves: Leaves) -> list[str]:
    return [
        _margin(build, leaves),
        _taylor(build, leaves),
        event_free_function(build, leaves),
        _solution(build, leaves),
    ]


def watch_tables(build: BuildPlan) -> list[str]:
    """Everything about watches and kernels that is data."""
    cuts = [str(int(w.cuts)) for w in watches_of(build.model)]
    kinds = [_kind(plan) for plan in build.flows]
    counts = [str(len(plan.margins)) for plan in build.flows]
    tables = [
        table("uint8_t", "FLOW_KERNEL", f"[{max(1, len(kinds))}]", kinds or ["0"]),
        table("int32_t", "FLOW_DURATION", f"[{max(1, len(kinds))}]", _durations(build) or ["-1"]),
    ]
    if searched(build):
        reaches = [number(float(flow.reach or 0)) for flow in build.model.flows]
        tables += [
            table("real", "FLOW_REACH", f"[{max(1, len(reaches))}]", reaches or ["0.0"]),
            table("uint8_t", "WATCH_CUTS", f"[{max(1, len(cuts))}]", cuts or ["0"]),
            table("int32_t", "FLOW_MARGINS", f"[{max(1, len(counts))}]", counts or ["0"]),
        ]
    return tables


def margin_count(build: BuildPlan) -> int:
    """The largest number of margins of a flow."""
    return max((len(plan.margins) for plan in build.flows), default=0)


def _durations(build: BuildPlan) -> list[str]:
    """For every flow the input that decides how long it lasts, -1 for none."""
    keys = [i.key for i in build.paths.inputs]
    wanted = [f"duration_{k}" for k in range(len(build.flows))]
    return [str(keys.index(key)) if key in keys else "-1" for key in wanted]


def _kind(plan: FlowPlan) -> str:
    return f"DL2C_{QUICK if plan.quick is not None else KERNELS[plan.kernel].code}"


def _margin(build: BuildPlan, leaves: Leaves) -> str:
    body: list[str] = []
    for k, plan in enumerate(build.flows):
        labels = margin_labels(build, k)
        local = Locals(leaves)
        lines: list[str] = []
        for j, (margin, label) in enumerate(zip(plan.margins, labels, strict=True)):
            value = leaves.term(label.margin, margin, label.text, local.symbol)
            lines += wrapped(f"if (margin == {j}) return {value};")
        body += selected(k, [*local.begun(), *lines])
    return function(
        f"static inline real model_margin(int flow, int margin, {STATE})",
        [*body, "return 0.0;"],
        "A margin in a state.",
    )


def _taylor(build: BuildPlan, leaves: Leaves) -> str:
    body: list[str] = []
    for k, plan in enumerate(build.flows):
        local = Locals(leaves)
        terms = Enclosed("taylor", lambda t, flow=plan.flow: not constant_along(t, flow), local)
        terms.count(iter(plan.margins))
        lines: list[str] = []
        for j, (margin, label) in enumerate(zip(plan.margins, margin_labels(build, k), strict=True)):
            value = terms.value(margin) if terms.uses[margin] == 1 else terms.term(margin)
            lines += [*label.remark, *terms.lines, *wrapped(f"g[{j}] = {value};")]
            terms.lines.clear()
        body += selected(k, [*local.begun(), *lines])
    return function(
        f"static void model_taylor(int flow, const dl2c_taylor *z, {STATE}, dl2c_taylor *g)",
        body,
        "Models of all margins where the state moves like z; what does not move is taken from x.   "
        "g: (NMARGIN)",
    )


def _solution(build: BuildPlan, leaves: Leaves) -> str:
    """Coefficients by powers of the time, of variables that move."""
    body: list[str] = []
    for k, plan in enumerate(build.flows):
        if plan.solution is None:
            continue
        local = Locals(leaves)
        lines: list[str] = []
        for variable, coefficients in plan.solution.variables.items():
            for i, coefficient in enumerate(coefficients[1:], 1):
                value = local.term(coefficient)
                lines += wrapped(f"c[{index(Symbol(variable, 'variable'))}][{i}] = {value};")
        degree = max((len(c) - 1 for c in plan.solution.variables.values()), default=0)
        body += selected(k, [*local.begun(), *lines, f"return {degree};"])
    return function(
        f"static int model_solution(int flow, {STATE}, real (*c)[DL2C_TRACK_DEGREE + 1])",
        [*body, "return 0;"],
        "Motion from x as polynomials of the time; returns their degree.   c: (NX), the constant "
        "coefficients are there",
    )


def _holds(build: BuildPlan) -> str:
    body: list[str] = []
    for k, plan in enumerate(build.flows):
        lines: list[str] = []
        for f, formula in enumerate(plan.formulas):
            if isinstance(formula, Truth) and formula.value:
                continue
            condition = _over_signs(formula, plan.margins)
            lines += [f"if (formula == {f})", *(f"  {x}" for x in wrapped(f"return {condition};"))]
        body += selected(k, lines)
    return function(
        "static inline bool model_condition(int flow, int formula, const int8_t *sign)",
        [*body, "return true;"],
        "Whether a condition watched along a flow holds where its margins have these signs.",
    )


def _over_signs(formula: Formula, margins: tuple[Term, ...]) -> str:
    match formula:
        case Truth(value):
            return "true" if value else "false"
        case Compare(op, left):
            return f"(sign[{margins.index(left)}] {'==' if op == '=' else op} 0)"
        case And(children):
            return f"({' & '.join(_over_signs(c, margins) for c in children)})"
        case Or(children):
            return f"({' | '.join(_over_signs(c, margins) for c in children)})"


def _keeps(build: BuildPlan, leaves: Leaves) -> str:
    body: list[str] = []
    for k, plan in enumerate(build.flows):
        if not plan.watches:
            continue
        if plan.quick is None or plan.still is None:
            body += [f"if (flow == {k}) return false;"]
            continue
        body += selected(k, _kept(build, k, plan, leaves))
    return function(
        f"DL2C_INLINE bool model_keeps_watches(int flow, {STATE}, real duration, const real *y)",
        [*body, "return true;"],
        "Whether a flow of that duration, which ends in y, changes no watch that matters, "
        "by a sufficient condition.",
    )


def _kept(build: BuildPlan, k: int, plan: FlowPlan, leaves: Leaves) -> list[str]:
    assert plan.still is not None
    local, labels = Locals(leaves), margin_labels(build, k)
    curves = dict(zip(plan.still_margins, plan.still_curves, strict=True))
    truths: dict[Compare, str] = {}
    taken: list[str] = []
    lines: list[str] = []
    for atom in dict.fromkeys(atoms(plan.still)):
        truths[atom] = atom_name(labels, f"flow{k}", atom, taken)
        span = _span(curves[atom.left], plan, labels, local)
        lines += [*quoted(atom), *local.lines]
        local.lines.clear()
        lines += wrapped(f"const bool {truths[atom]} = {STAYS[atom.op]}({span});")
    parts = [over_atoms(plan.still, truths)]
    at_end = conjunction(w.at_end for w in plan.watches)
    if at_end != TRUE:
        parts.append(leaves.condition(f"flow{k}_at_end", at_end, print_formula(at_end), after))
    return [*local.begun(), *lines, *wrapped(f"return {' & '.join(parts)};")]


def _span(curve: Coefficients, plan: FlowPlan, labels: tuple[Label, ...], local: Locals) -> str:
    """What encloses a margin of degree two at most."""
    first = _shared_margin(curve[0], plan, labels, local) or local.term(curve[0])
    length = ["duration"] if len(curve) > 1 else []
    return f"dl2c_{SPANS[len(curve) - 1]}({', '.join([first, *map(local.term, curve[1:]), *length])})"


def _shared_margin(term: Term, plan: FlowPlan, labels: tuple[Label, ...], local: Locals) -> str | None:
    """The call of a margin's function, with a number for its slack, that does the operations of the term;
    None where none does.
    """
    for margin, label in zip(plan.margins, labels, strict=True):
        slacks = [s for s in symbols(margin) if s.kind == "start"]
        if isinstance(margin, Symbol) or len(slacks) > 1:
            continue
        for value in _numbers(term) if slacks else [0.0]:
            if local.leaves.same_operations(margin, term, {s.name: value for s in slacks}):
                place = partial(_given, local, {s: number(value) for s in slacks})
                return local.leaves.term(label.margin, margin, label.text, place)
    return None


def _given(local: Locals, values: Mapping[Symbol, str], symbol: Symbol) -> str:
    """Where a symbol's value is: some are numbers."""
    return values.get(symbol) or local.symbol(symbol)


def _numbers(term: Term) -> list[float]:
    """The numbers in a term."""
    if isinstance(term, Number):
        return [float(term.value)]
    return list(dict.fromkeys(v for t in operands(term) for v in _numbers(t)))
