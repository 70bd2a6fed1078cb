"""Differential equations of the syntax tree as IR flows: rates, domain, horizon (semantics 4)."""

from dl2c.ir import model as ir
from dl2c.ir.logic import conjunction, conjuncts, symbols
from dl2c.ir.lower_terms import Scope, lower_formula, lower_term
from dl2c.options import DEFAULT_DT, Options
from dl2c.parse import tree


def lower_flow(ode: tree.ODESystem, scope: Scope, options: Options) -> ir.Flow:
    """The flow of an ODE. Where no clock limits it, it lasts `dt`."""
    equations = tuple(
        (e.name, lower_term(e.term, scope)) for e in ode.equations if isinstance(e, tree.AtomicODE)
    )
    domain = lower_formula(ode.domain, scope)
    rates = dict(equations)
    horizons: list[ir.Horizon] = []
    watched: list[ir.Formula] = []
    for part in conjuncts(domain):
        horizon = _horizon(part, rates)
        if horizon is None:
            watched.append(part)
        else:
            horizons.append(horizon)
    cap = options.dt if options.dt is not None or horizons else DEFAULT_DT
    return ir.Flow(equations, domain, conjunction(watched), tuple(horizons), cap, span=ode.span)


def _horizon(part: ir.Formula, rates: dict[str, ir.Term]) -> ir.Horizon | None:
    """`t <= e` or `e >= t` with t' = 1 and e constant along the flow."""
    match part:
        case ir.Compare("<=", ir.Symbol(clock, "variable"), bound) | ir.Compare(
            ">=", bound, ir.Symbol(clock, "variable")
        ):
            if rates.get(clock) == ir.ONE and not _changes(bound, rates):
                return ir.Horizon(clock, bound)
            return None
        case _:
            return None


def _changes(term: ir.Term, rates: dict[str, ir.Term]) -> bool:
    return any(s.kind == "variable" and rates.get(s.name, ir.ZERO) != ir.ZERO for s in symbols(term))
