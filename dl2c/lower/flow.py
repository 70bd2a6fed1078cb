"""Differential equations of the syntax tree as IR flows: rates, domain, horizon (semantics 4)."""

from dl2c.flows.conserved import is_invariant
from dl2c.ir import model as ir
from dl2c.ir.logic import conjunction, conjuncts, symbols
from dl2c.ir.slack import relaxed
from dl2c.lower.terms import Scope, lower_formula, lower_term
from dl2c.options import DEFAULT_DT, Options
from dl2c.parse import tree


def lower_flow(ode: tree.ODESystem, scope: Scope, options: Options, once: bool = False) -> ir.Flow:
    """The flow of an ODE, limited by its clocks, and by `dt` if that is given. With neither, it lasts
    `DEFAULT_DT`; in a program that runs `once`, to the end of its domain if that comes within `max_flow`.
    """
    equations = tuple(
        (e.name, lower_term(e.term, scope)) for e in ode.equations if isinstance(e, tree.AtomicODE)
    )
    rates = dict(equations)
    domain: list[ir.Formula] = []
    horizons: list[ir.Horizon] = []
    watched: list[ir.Formula] = []
    invariants: list[ir.Compare] = []
    for part in conjuncts(lower_formula(ode.domain, scope)):
        horizon = _horizon(part, rates)
        if horizon is not None:
            horizons.append(horizon)
        elif isinstance(part, ir.Compare) and _is_invariant(part, rates):
            invariants.append(part)
            domain.append(relaxed(part, options.tolerance))
            continue
        else:
            watched.append(part)
        domain.append(part)
    cap = options.dt if options.dt is not None or horizons else DEFAULT_DT
    reaches = once and options.dt is None and not horizons and conjunction(watched) != ir.TRUE
    return ir.Flow(
        equations,
        conjunction(domain),
        conjunction(watched),
        tuple(horizons),
        cap,
        tuple(invariants),
        max(options.max_flow, DEFAULT_DT) if reaches else None,
        span=ode.span,
    )


def _is_invariant(part: ir.Compare, rates: dict[str, ir.Term]) -> bool:
    """Whether the atom is an equality whose sides change along the flow, but not their difference."""
    difference = ir.Sub(part.left, part.right)
    return part.op == "=" and _changes(difference, rates) and is_invariant(difference, rates)


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
