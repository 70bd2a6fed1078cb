"""What follows of admissible requests: whether steps stay within the bounds, and whether that goes on.

Three claims about the model, asked of its prover: J holds where the loop begins, a step keeps J, and a step
from J and the bounds ends within the bounds. They are about every request that is admissible, whatever the
network is: so they hold for a policy whose requests are, and where they are not proved the policy may keep
to the bounds all the same.
"""

import hashlib
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Literal, TypeAlias

from dl2c.interval.bounded import interval_of
from dl2c.interval.contract import contract
from dl2c.ir.liveness import written
from dl2c.ir.model import UNBOUNDED, Bound, Model, Symbol
from dl2c.monitor.control import leading_drafts
from dl2c.parse import tree
from dl2c.parse.tree import Entry
from dl2c.paths.enabled import with_exact_domains
from dl2c.paths.enumerate import assignments_of
from dl2c.resolve.symbols import nodes
from dl2c.smt.portfolio import Portfolio
from dl2c.verify.arithmetic.prover import Prover
from dl2c.verify.execution import Kind
from dl2c.verify.prove import Limits, Proof
from dl2c.verify.theorem import Theorem, obligation, theorem_of

Kept: TypeAlias = Literal["proved", "unknown", "not checked"]
Lasting: TypeAlias = Literal["proved", "until the bounds are left", "unknown", "not checked"]


@dataclass(frozen=True, slots=True)
class Onward:
    """`kept`: steps end within the bounds of what is observed. `lasting`: from every state in which the loop
    may begin, all that is claimed goes on. `about` is the digest of what that was asked of.
    """

    kept: Kept = "not checked"
    lasting: Lasting = "not checked"
    about: str = field(default="", compare=False)
    interrupted: bool = False


def subject(entry: Entry, model: Model, fixed: Mapping[str, Fraction]) -> str:
    """A digest of the theorem and of the bounds of its names: of other ones, other claims are proved. Empty
    where the theorem is nested too deeply.
    """
    try:
        facts = [repr(theorem_of(entry, {}).formula), repr(sorted(fixed.items()))]
    except RecursionError:
        return ""
    facts += [repr((v.name, v.bound, v.observed)) for v in model.variables]
    facts += [repr((c.name, c.bound, c.value)) for c in model.constants]
    return hashlib.sha256("\0".join(facts).encode("utf-8", "surrogatepass")).hexdigest()


def onward(entry: Entry, model: Model, fixed: Mapping[str, Fraction], limits: Limits) -> Onward:
    """What is proved for a policy whose requests are admissible. `fixed` has the values of constants, and
    those that the claim about its requests is limited to.
    """
    try:
        return Onward(*_answers(entry, model, fixed, limits), subject(entry, model, fixed))
    except KeyboardInterrupt:  # what is proved of the requests by then stays proved
        return Onward(interrupted=True)


def _answers(
    entry: Entry, model: Model, fixed: Mapping[str, Fraction], limits: Limits
) -> tuple[Kept, Lasting]:
    changed = written((*model.prefix, *model.lead, *model.body), model.flows)
    steady = {name: value for name, value in fixed.items() if name not in changed}
    theorem = theorem_of(entry, steady)
    loops = [n for n in nodes(theorem.formula) if isinstance(n, tree.Loop)]
    if len(loops) != 1 or not loops[0].invariants:
        return "not checked", "not checked"
    loop, bounded = loops[0], {v.name: v.bound for v in model.variables if v.observed}
    always = {v.name: v.bound for v in model.variables if v.name not in changed}
    always |= {c.name: c.bound for c in model.constants}
    inside = tuple(_inside(bounded))
    assumed = (*loop.invariants, *_inside(always), *inside)

    def holds(kind: Kind, before: Sequence[tree.Formula], after: Sequence[tree.Formula]) -> bool:
        asked = obligation(theorem, loop, kind, before, after)
        return asked is not None and _proved(asked[0], limits, portfolio)

    with Portfolio(limits.jobs) as portfolio:
        kept = holds("step", assumed, inside)
        first = inside if model.prefix else ()  # else the first state is within its bounds
        begins = holds("initially", loop.invariants, (*loop.invariants, *first))
        invariant = begins or holds("initially", loop.invariants, loop.invariants)
        invariant = invariant and holds("step", loop.invariants, loop.invariants)
    if not invariant or steady.keys() != fixed.keys():
        return "proved" if kept else "unknown", "unknown"
    lasting = kept and begins and _drawn_inside(model)
    return "proved" if kept else "unknown", "proved" if lasting else "until the bounds are left"


def _drawn_inside(model: Model) -> bool:
    """Whether all values that the environment may give to observed variables before the policy observes are
    within their bounds, whatever the rest is within its own.
    """
    declared = {v.name: v.bound for v in model.variables if v.observed}
    drawn = {a.key: declared.get(a.variable, UNBOUNDED) for a in assignments_of(model.lead)}
    around = {v.symbol: interval_of(v.bound) for v in model.variables}
    around |= {c.symbol: interval_of(c.bound) for c in model.constants}
    for lead in leading_drafts(with_exact_domains(model)):
        free = {Symbol(key, "input"): interval_of(UNBOUNDED) for key in lead.inputs}
        inside = contract(lead.tests, around | free) or {}
        for symbol, found in inside.items():
            bound = drawn.get(symbol.name, UNBOUNDED) if symbol in free else UNBOUNDED
            if bound.low is not None and found.low < bound.low:
                return False
            if bound.high is not None and found.high > bound.high:
                return False
    return True


def _inside(bounds: Mapping[str, Bound]) -> Iterator[tree.Formula]:
    """That names are within their bounds."""
    for name, bound in bounds.items():
        if bound.low is not None:
            yield tree.Compare("<=", _number(bound.low), tree.Variable(name))
        if bound.high is not None:
            yield tree.Compare("<=", tree.Variable(name), _number(bound.high))


def _number(value: Fraction) -> tree.Term:
    return tree.Number(value) if value >= 0 else tree.Neg(tree.Number(-value))


def _proved(theorem: Theorem, limits: Limits, portfolio: Portfolio) -> bool:
    """Whether a claim is proved, without the safety predicates of the model, which are not part of it."""
    prover = Prover(portfolio, limits.each, time.monotonic() + limits.total)
    found = Proof(replace(theorem, safety=()), prover).best(refute=False)
    if prover.interrupted:
        raise KeyboardInterrupt
    return found.answer == "proved"
