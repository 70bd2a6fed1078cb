"""Flows in C: the exact kernel of one ODE as straight-line code (see dl2c/ir/exact.py).

For flow k: leaf functions of coefficients, margins, horizon and domain, then `flowK_at`
(the state after a time) and `flowK` (how long the flow lasts and where it ends); at the
end `model_flow`, which selects one.
"""

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import function, place, wrapped
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import index, slot
from dl2c.emit.plan import Environment
from dl2c.ir.exact import ExactPlan, Watch
from dl2c.ir.model import TRUE, Symbol
from dl2c.ir.polynomial import Coefficients
from dl2c.ir.printer import print_flow, print_formula, print_term

EXITS = {"closed": "dl2c_exit_closed", "open": "dl2c_exit_open", "apart": "dl2c_exit_apart"}


def flow_functions(environment: Environment, leaves: Leaves) -> list[str]:
    """All functions of all flows."""
    texts: list[str] = []
    for k, plan in enumerate(environment.flows):
        inside = _inside(k, plan, leaves)
        texts += [_at(k, plan, leaves), _flow(k, plan, leaves, inside)]
    body: list[str] = []
    body += [f"if (flow == {k}) return flow{k}(p, x, duration);" for k in range(len(environment.flows))]
    texts.append(
        function(
            "static inline bool model_flow(int flow, real *x, const real *p, real *duration)",
            [*body, "return true;"],
            "Moves x along a flow as long as its domain allows. False where a value is undefined.",
        )
    )
    return texts


def _inside(k: int, plan: ExactPlan, leaves: Leaves) -> str:
    """An expression for whether y is in the domain."""
    if plan.flow.domain == TRUE:
        return "true"
    about = f"{place(plan.flow.span)}  {print_formula(plan.flow.domain)}"
    return leaves.condition(f"flow{k}_inside", plan.flow.domain, about, "y")


def _coefficients(stem: str, coefficients: Coefficients, about: str, leaves: Leaves) -> list[str]:
    return [
        leaves.term(f"{stem}_c{j}", c, f"{about}, coefficient of tau^{j}") for j, c in enumerate(coefficients)
    ]


def _at(k: int, plan: ExactPlan, leaves: Leaves) -> str:
    body: list[str] = []
    for variable, coefficients in plan.solution.variables.items():
        if len(coefficients) == 1:
            continue
        terms = _coefficients(f"flow{k}_{variable}", coefficients, f"{variable}(tau)", leaves)
        value = {"1.0": "tau", "-1.0": "-tau"}.get(terms[-1], f"{terms[-1]} * tau") + f" + {terms[-2]}"
        for term in reversed(terms[:-2]):
            value = f"({value}) * tau + {term}"
        body += wrapped(f"y[{index(Symbol(variable, 'variable'))}] = {value};")
    return function(
        f"static inline void flow{k}_at(const real *x, const real *p, real tau, real *y)",
        body,
        f"{place(plan.flow.span)}  {print_flow(plan.flow)} solved: y is x moved by the time tau.",
    )


def _flow(k: int, plan: ExactPlan, leaves: Leaves, inside: str) -> str:
    body = ["*duration = 0.0;"]
    terms = [c for cs in plan.solution.variables.values() for c in cs]
    terms += [c for w in plan.watches for c in w.margin] + [h.bound for h in plan.flow.horizons]
    if (defined := leaves.defined(f"flow{k}_defined", terms, "all coefficients have a value")) is not None:
        body.append(f"if (!{defined}) return false;")
    limits: list[str] = []
    for j, horizon in enumerate(plan.flow.horizons):
        clock = Symbol(horizon.clock, "variable")
        bound = leaves.term(
            f"flow{k}_until{j}", horizon.bound, f"{horizon.clock} <= {print_term(horizon.bound)}"
        )
        body.append(f"const real until{j} = {bound};")
        body.append(f"const real left{j} = until{j} - {slot(clock)};")
        limits.append(f"left{j}")
    if plan.flow.cap is not None:
        limits.append(number(float(plan.flow.cap)))
    for j, watch in enumerate(plan.watches):
        body += _exit(k, j, watch, leaves)
    body.append(f"real end = {limits[0]};")
    body += [f"if ({limit} < end) end = {limit};" for limit in limits[1:]]
    exits = [f"exit{j}" for j in range(len(plan.watches))]
    body += [f"if ({name} < end) end = {name};" for name in exits]
    body += [f"if (!isfinite({limit})) return false;" for limit in limits if limit.startswith("left")]
    body.append("if (!(end > 0.0)) return true;")
    for j in range(len(plan.watches)):
        body.append(f"const bool hit{j} = exit{j} <= end;")
    shy = [f"hit{j}" for j, w in enumerate(plan.watches) if w.kind in ("open", "apart")]
    if shy:
        body.append(f"if ({' || '.join(shy)}) end = dl2c_before(end);")
    body += [
        "",
        "real y[NX];",
        "memcpy(y, x, sizeof y);",
        f"flow{k}_at(x, p, end, y);",
        *_settled(k, plan, leaves),
    ]
    body += [
        f"if (dl2c_all_finite(y, NX) && {inside}) {{"
        if inside != "true"
        else "if (dl2c_all_finite(y, NX)) {",
        "  memcpy(x, y, sizeof y);",
        "  *duration = end;",
        "  return true;",
        "}",
        "if (!dl2c_all_finite(y, NX)) return false;",
        *_retreat(k, inside),
    ]
    return function(
        f"static inline bool flow{k}(const real *p, real *x, real *duration)",
        body,
        f"{place(plan.flow.span)}  {print_flow(plan.flow)}",
    )


def _exit(k: int, j: int, watch: Watch, leaves: Leaves) -> list[str]:
    """When the motion leaves one condition of the domain."""
    if watch.kind == "equal":
        return [f"const real exit{j} = dl2c_exit_equal();"]
    stem = f"flow{k}_margin{j}"
    terms = _coefficients(stem, watch.margin, f"{place(watch.span)}  {watch.span.text}, margin", leaves)
    padded = [*terms, "0.0", "0.0"][:3]
    return wrapped(f"const real exit{j} = {EXITS[watch.kind]}({', '.join(padded)});")


def _settled(k: int, plan: ExactPlan, leaves: Leaves) -> list[str]:
    """A clock that ran out and a bound that was met are met exactly (semantics 4, snap)."""
    lines: list[str] = []
    for j, horizon in enumerate(plan.flow.horizons):
        lines.append(f"if (left{j} == end) y[{index(Symbol(horizon.clock, 'variable'))}] = until{j};")
    for j, watch in enumerate(plan.watches):
        if watch.snap is not None:
            target = leaves.term(f"flow{k}_snap{j}", watch.snap.target, f"{watch.snap.variable} at its bound")
            lines.append(f"if (hit{j}) y[{index(Symbol(watch.snap.variable, 'variable'))}] = {target};")
    return lines


def _retreat(k: int, inside: str) -> list[str]:
    """Rounding put the end point outside the domain: step back until it is inside."""
    if inside == "true":
        return []
    return [
        "real part = DL2C_RETREAT_FIRST;",
        "for (int k = 0; k < DL2C_RETREATS; k++, part *= 4.0) {",
        "  const real earlier = end - end * part;",
        "  memcpy(y, x, sizeof y);",
        f"  flow{k}_at(x, p, earlier, y);",
        f"  if ({inside}) {{",
        "    memcpy(x, y, sizeof y);",
        "    *duration = earlier;",
        "    return true;",
        "  }",
        "}",
        "return true;",
    ]
