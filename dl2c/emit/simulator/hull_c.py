"""A quick look at a whole track or a part of one, in C: that nothing happens, proved by intervals (hull.h).

`model_calm` evaluates the margins of a flow's conditions, as they are written, on hulls of the
state. It holds only if its domain and every watch that is still open hold in every state inside.
"""

from dl2c.emit.cfile import function, wrapped
from dl2c.emit.leaf import Leaves
from dl2c.emit.plan import Environment
from dl2c.emit.simulator.enclosed_c import Enclosed
from dl2c.flows.kernel import FlowPlan, constant_along
from dl2c.ir.margins import margin_of
from dl2c.ir.model import And, Compare, Formula, Or, Truth

HOLDS = dict.fromkeys((">=", "<=", ">", "<"), "positive") | {"!=": "apart", "=": "equal"}
"""A margin that gets to zero is not plain: where it goes, its derivatives tell."""


def calm_function(environment: Environment, leaves: Leaves) -> str:
    """`model_calm` for all flows."""
    body: list[str] = []
    for k, plan in enumerate(environment.flows):
        lines = _calm(k, plan, leaves)
        body += [f"if (flow == {k}) {{", *(f"  {line}" for line in lines), "}"]
    return function(
        "static inline bool model_calm(int flow, const dl2c_hull *z, const real *x, const real *p, "
        "bool bounded, const uint8_t *watch)",
        [*body, "return false;"],
        "Whether the domain of a flow, if it counts, and the watches still open plainly hold in all "
        "states within z; what does not move is taken from x.",
    )


def _calm(k: int, plan: FlowPlan, leaves: Leaves) -> list[str]:
    terms = Enclosed(
        "hull", f"flow{k}_calm", lambda t: not constant_along(t, plan.flow), leaves, "does not move"
    )
    domain, *stays = (_holds(f, terms) for f in plan.written)
    waiting = [f"((watch[{w}] != DL2C_WATCHING) | {holds})" for w, holds in enumerate(stays)]
    return [*terms.lines, *wrapped(f"return {' & '.join([f'((!bounded) | {domain})', *waiting])};")]


def _holds(formula: Formula, terms: Enclosed) -> str:
    match formula:
        case Truth(value):
            return "true" if value else "false"
        case Compare(op):
            return f"dl2c_hull_{HOLDS[op]}({terms.term(margin_of(formula))})"
        case And(children):
            return f"({' & '.join(_holds(c, terms) for c in children)})"
        case Or(children):
            return f"({' | '.join(_holds(c, terms) for c in children)})"
