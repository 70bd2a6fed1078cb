"""Flows as ODEs in C: rates, margins of the domain and their Lie derivatives.

For flow k: leaf functions `flowK_rate_x` for each equation, `flowK_rootJ` for atom J of the
domain without clock bounds, `flowK_lieJ` for the derivative of that margin along the flow;
then `model_rates` and `model_roots`, which select a flow. A margin is positive inside.
"""

from dl2c.emit.cfile import function, place, wrapped
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import index
from dl2c.emit.plan import BuildPlan
from dl2c.ir.logic import atoms
from dl2c.ir.margins import margin_of
from dl2c.ir.model import Flow, Symbol
from dl2c.ir.printer import print_flow, print_formula, print_term

STATE = "const real *x, const real *p"


def rate_functions(build: BuildPlan, leaves: Leaves) -> list[str]:
    """`model_rates`, `model_moves` where it is needed, and `model_roots`."""
    dopri = any(plan.kernel == "dopri5" for plan in build.flows)
    moves = [_moves(build)] if dopri else []
    return [_rates(build, leaves), *moves, _roots(build, leaves)]


def root_count(build: BuildPlan) -> int:
    """The largest number of margins that a flow has."""
    return max((len(list(atoms(f.watched))) for f in build.model.flows), default=0)


def _rates(build: BuildPlan, leaves: Leaves) -> str:
    body = ["for (int k = 0; k < NX; k++) dx[k] = 0.0;"]
    for k, flow in enumerate(build.model.flows):
        lines: list[str] = []
        for variable, rate in flow.equations:
            about = f"{place(flow.span)}  {variable}' = {print_term(rate)}"
            value = leaves.term(f"flow{k}_rate_{variable}", rate, about)
            lines += wrapped(f"dx[{index(Symbol(variable, 'variable'))}] = {value};")
        body += selected(k, lines)
    return function(
        f"static inline void model_rates(int flow, {STATE}, real *dx)",
        body,
        "How fast the variables change along a flow; 0 where its ODE does not name one.",
    )


def _moves(build: BuildPlan) -> str:
    flows = build.model.flows
    body: list[str] = []
    for k, flow in enumerate(flows):
        moved = [f"variable == {index(Symbol(variable, 'variable'))}" for variable, _ in flow.equations]
        holds = wrapped(f"return {' || '.join(moved)};")
        body += holds if len(flows) == 1 else selected(k, holds)
    return function(
        "static inline bool model_moves(int flow, int variable)",
        body if len(flows) == 1 else [*body, "return false;"],
        "Whether the ODE of a flow names a variable.",
    )


def _roots(build: BuildPlan, leaves: Leaves) -> str:
    body = ["for (int k = 0; k < NROOT; k++) {", "  g[k] = 1.0;", "  dg[k] = 0.0;", "}"]
    for k, flow in enumerate(build.model.flows):
        body += selected(k, _margins(k, flow, leaves))
    return function(
        f"static inline void model_roots(int flow, {STATE}, real *g, real *dg)",
        body if root_count(build) else [],
        "Margins of a flow's domain and their Lie derivatives; 1 and 0 where it has fewer than NROOT.",
    )


def _margins(k: int, flow: Flow, leaves: Leaves) -> list[str]:
    lines: list[str] = []
    for j, atom in enumerate(atoms(flow.watched)):
        margin = margin_of(atom)
        where, text = place(atom.span), print_term(margin)
        value = leaves.term(f"flow{k}_root{j}", margin, f"{where}  {print_formula(atom)}, margin {text}")
        about = f"{where}  d/dt ({text}) along {print_flow(flow)}"
        slope = leaves.lie(f"flow{k}_lie{j}", margin, flow, about)
        lines += [*wrapped(f"g[{j}] = {value};"), *wrapped(f"dg[{j}] = {slope};")]
    return lines


def selected(k: int, lines: list[str]) -> list[str]:
    """Statements for flow k alone; nothing where there are none."""
    return [f"if (flow == {k}) {{", *(f"  {line}" for line in lines), "}"] if lines else []
