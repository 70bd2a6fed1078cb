"""What is computed where a flow begins, and what its end is moved onto, in C (see dl2c/flows/starts.py).

`model_freeze` writes values of kind "start" behind the constants of an environment, from p[NP] on.
`model_invariants` writes the equalities that a numerical flow conserves, and their gradients.
"""

from dl2c.emit.cfile import function, place, wrapped
from dl2c.emit.leaf import Leaves, Locals
from dl2c.emit.names import after, index, slot
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.rates_c import STATE, selected
from dl2c.flows.kernel import FlowPlan
from dl2c.flows.starts import Projection
from dl2c.ir.margins import margin_of
from dl2c.ir.model import Compare, Flow, Symbol
from dl2c.ir.printer import print_formula


def start_functions(build: BuildPlan, leaves: Leaves) -> list[str]:
    """`model_freeze` and, where a flow is followed numerically, `model_invariants`."""
    tracked = any(plan.kernel != "exact" for plan in build.flows)
    return [_freeze(build, leaves), *([_invariants(build, leaves)] if tracked else [])]


def start_symbols(build: BuildPlan) -> list[Symbol]:
    """Every symbol of kind "start" that some flow has."""
    found = [s.symbol for plan in build.flows for s in plan.starts]
    found += [j.held for plan in build.flows for j in _projected(plan) if j.held is not None]
    return list(dict.fromkeys(found))


def projection_count(build: BuildPlan) -> int:
    """The largest number of equalities that the end of a flow is moved onto."""
    return max((len(_projected(plan)) for plan in build.flows), default=0)


def _projected(plan: FlowPlan) -> tuple[Projection, ...]:
    return () if plan.kernel == "exact" else plan.projections


def _freeze(build: BuildPlan, leaves: Leaves) -> str:
    body: list[str] = []
    for k, plan in enumerate(build.flows):
        lines: list[str] = []
        local = Locals(leaves)
        for start in plan.starts:
            value = local.term(start.value)
            lines += [*local.lines, *wrapped(f"{slot(start.symbol)} = dl2c_frozen({value});")]
            local.lines.clear()
        for projection in _projected(plan):
            if projection.held is not None and projection.holds is not None:
                equality = projection.equality
                about = f"{place(equality.span)}  {print_formula(equality)}, within tolerance"
                holds = leaves.condition(f"flow{k}_{projection.held.name}", projection.holds, about)
                lines += wrapped(f"{slot(projection.held)} = {holds} ? 1.0 : 0.0;")
        body += selected(k, [*local.begun(), *lines])
    return function(
        f"static inline void model_freeze(int flow, {STATE.split(',')[0]}, real *p)",
        body,
        "What does not change along a flow from x, behind the constants.   p: (NP + NFROZEN)",
    )


def _invariants(build: BuildPlan, leaves: Leaves) -> str:
    body: list[str] = []
    for k, plan in enumerate(build.flows):
        lines: list[str] = []
        for j, projection in enumerate(_projected(plan)):
            found = _gradient(k, j, projection.equality, plan.flow, leaves)
            if projection.held is None:
                lines += found
            else:
                lines += [f"if ({slot(projection.held)} > 0.0) {{", *(f"  {line}" for line in found), "}"]
        body += selected(k, lines)
    return function(
        "static inline void model_invariants(int flow, const real *y, const real *p, "
        "real *off, real (*by)[NX])",
        body,
        "How far y, the end of a flow, is off the equalities that the flow conserves, with gradients; "
        "left alone where one need not hold.   off: (NPROJECTION)   by: (NPROJECTION, NX)",
    )


def _gradient(k: int, j: int, equality: Compare, flow: Flow, leaves: Leaves) -> list[str]:
    off = margin_of(equality)
    about = f"{place(equality.span)}  {print_formula(equality)}"
    lines = wrapped(f"off[{j}] = {leaves.term(f'flow{k}_invariant_off{j}', off, about, after)};")
    for name, _ in flow.equations:
        symbol = Symbol(name, "variable")
        slope = leaves.partial(f"flow{k}_invariant_off{j}_{name}", off, symbol, about, after)
        if slope is not None:
            lines += wrapped(f"by[{j}][{index(symbol)}] = {slope};")
    return lines
