"""What every run needs of the state in which it begins.

A model goes in; a formula over the state after a reset is drawn comes out: the tests and domains of each way
through the program, as far as nothing has changed yet what they are about. It holds wherever there is a run,
and may hold elsewhere too. Equalities that a flow conserves are relaxed there by the slack of the model, or
exact, as models mean them.
"""

from collections.abc import Set
from dataclasses import replace
from fractions import Fraction
from typing import assert_never

from dl2c.ir.liveness import written
from dl2c.ir.logic import conjunction, conjuncts, disjunction, symbols
from dl2c.ir.model import (
    Assign,
    AssignAny,
    Block,
    Choice,
    Evolve,
    Flow,
    Formula,
    If,
    Model,
    Repeat,
    Symbol,
    Test,
    While,
)
from dl2c.ir.slack import relaxed


def enabling(model: Model, *, exact: bool = False) -> Formula:
    """True in every state from which the prefix and a first step have a run."""
    flows = with_exact_domains(model).flows if exact else model.flows
    return _needed((*model.prefix, *model.lead, *model.body), flows, set())


def with_exact_domains(model: Model) -> Model:
    """The model with equalities of domains as they are written, without slack."""
    flows = (replace(f, domain=_exact_domain(f, model.tolerance)) for f in model.flows)
    return replace(model, flows=tuple(flows))


def _exact_domain(flow: Flow, tolerance: Fraction) -> Formula:
    slack = {relaxed(equality, tolerance): equality for equality in flow.invariants}
    return conjunction(slack.get(c, c) for c in conjuncts(flow.domain))


def _needed(block: Block, flows: tuple[Flow, ...], changed: Set[str]) -> Formula:
    """Of a block, some variables having changed before it."""
    found: list[Formula] = []
    for statement in block:
        match statement:
            case Test(formula):
                found.append(_kept(formula, changed))
            case Evolve(k):
                found.append(_kept(flows[k].domain, changed))
            case Choice(_, alternatives):
                found.append(disjunction(_needed(a.body, flows, changed) for a in alternatives))
            case If(condition, otherwise, then, orelse):
                ways = ((condition, then), (otherwise, orelse))
                found.append(
                    disjunction(
                        conjunction([_kept(c, changed), _needed(body, flows, changed)]) for c, body in ways
                    )
                )
            case Assign() | AssignAny() | While() | Repeat():
                pass
            case _:
                assert_never(statement)
        changed = changed | written((statement,), flows)
    return conjunction(found)


def _kept(formula: Formula, changed: Set[str]) -> Formula:
    """The conjuncts that are about the state in which the run began."""
    gone = {Symbol(name, "variable") for name in changed}
    return conjunction(
        c for c in conjuncts(formula) if not symbols(c) & gone and all(map(_is_of_state, symbols(c)))
    )


def _is_of_state(symbol: Symbol) -> bool:
    return symbol.kind in ("variable", "constant")
