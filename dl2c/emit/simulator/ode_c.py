"""What following a flow step by step needs in C: the Jacobian of its ODE, Lie derivatives of margins.

For flow k: leaf functions `flowK_jac_x_y` for d x' / d y where it is not zero throughout, and
`flowK_watch_marginJ_lie1` to `..._lie3` for derivatives of margin J along the flow; then
`model_jacobian` and `model_lie`, which select a flow. Flows not asked for get zeros.
"""

from collections.abc import Collection, Mapping, Sequence

from dl2c.emit.cfile import function, place, wrapped
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import index
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.rates_c import STATE, selected
from dl2c.ir.model import Flow, Symbol, Term
from dl2c.ir.printer import print_flow, print_term

ORDERS = 3
"""How many Lie derivatives decide where a flow that begins on a boundary goes."""


def jacobian_function(build: BuildPlan, leaves: Leaves, flows: Collection[int]) -> str:
    """`model_jacobian` for some flows, given by index."""
    body = ["for (int k = 0; k < NX * NX; k++) jac[k] = 0.0;"]
    variables = [Symbol(v.name, "variable") for v in build.model.variables]
    for k in sorted(flows):
        body += selected(k, _entries(k, build.model.flows[k], variables, leaves))
    return function(
        f"static inline void model_jacobian(int flow, {STATE}, real *jac)",
        body,
        "How the rates of a flow depend on the variables: d x_i' / d x_j is jac[i * NX + j].",
    )


def lie_function(build: BuildPlan, leaves: Leaves, margins: Mapping[int, Sequence[Term]]) -> str:
    """`model_lie`; `margins` are the terms watched along each flow, by its index, at most NMARGIN."""
    body = [f"for (int k = 0; k < {ORDERS} * NMARGIN; k++) lie[k] = 0.0;"] if any(margins.values()) else []
    for k, terms in sorted(margins.items()):
        lines: list[str] = []
        for j, term in enumerate(terms):
            lines += _derivatives(k, j, term, build.model.flows[k], leaves)
        body += selected(k, lines)
    return function(
        f"static inline void model_lie(int flow, {STATE}, real *lie)",
        body,
        f"Lie derivatives of order 1 to {ORDERS} of what is watched along a flow, ({ORDERS}, NMARGIN); "
        "0 where it has fewer than NMARGIN.",
    )


def _entries(k: int, flow: Flow, variables: Sequence[Symbol], leaves: Leaves) -> list[str]:
    lines: list[str] = []
    for name, rate in flow.equations:
        for by in variables:
            about = f"{place(flow.span)}  d({name}')/d({by.name}) of {name}' = {print_term(rate)}"
            value = leaves.partial(f"flow{k}_jac_{name}_{by.name}", rate, by, about)
            if value is not None:
                target = f"jac[{index(Symbol(name, 'variable'))} * NX + {index(by)}]"
                lines += wrapped(f"{target} = {value};")
    return lines


def _derivatives(k: int, j: int, term: Term, flow: Flow, leaves: Leaves) -> list[str]:
    lines: list[str] = []
    for order in range(1, ORDERS + 1):
        power = f"^{order}" if order > 1 else ""
        about = f"{place(flow.span)}  d{power}/dt{power} ({print_term(term)}) along {print_flow(flow)}"
        value = leaves.lie(f"flow{k}_watch_margin{j}_lie{order}", term, flow, about, order=order)
        row = f"{order - 1} * NMARGIN + " if order > 1 else ""
        lines += wrapped(f"lie[{row}{j}] = {value};")
    return lines
