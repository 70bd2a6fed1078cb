"""From a model and a policy to the questions whether every request is admissible.

A step begins with statements that the environment executes before the policy observes; each way through
them is a question of its own. What follows up to the first flow is a set of control paths. A request is
admissible where some path that it names has all its tests satisfied, with the domain of the flow that it
leads to.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from dl2c.interval.bounded import interval_of
from dl2c.interval.contract import contract
from dl2c.ir.evaluate import value_of
from dl2c.ir.liveness import written
from dl2c.ir.logic import (
    always_defined,
    conjunction,
    conjuncts,
    negation,
    sides,
    symbols,
)
from dl2c.ir.logic import substituted as substituted_term
from dl2c.ir.model import (
    TRUE,
    UNBOUNDED,
    Bound,
    Formula,
    Model,
    Neg,
    Number,
    Symbol,
    Term,
)
from dl2c.lower.invariant import invariant
from dl2c.monitor.control import leading_drafts
from dl2c.parse import tree
from dl2c.paths.enabled import with_exact_domains
from dl2c.paths.enumerate import Draft, assignments_of, control_drafts, decisions_of
from dl2c.paths.path import END
from dl2c.policy.network import LARGEST_FLOAT, Layer, Network
from dl2c.policy_proof.acting import Acting
from dl2c.policy_proof.cases import cases_of, in_arithmetic, substituted, term_with
from dl2c.policy_proof.computed import dimension, symbol_of
from dl2c.policy_proof.question import (
    Arithmetic,
    NotCovered,
    Observed,
    Question,
    Range,
)
from dl2c.resolve.problem import Problem
from dl2c.resolve.symbols import nodes


@dataclass(frozen=True, slots=True)
class Claim:
    """About a model: which states, and in which arithmetic. `invariant` is that of its loop, `outside` are
    states of which nothing is claimed, `fixed` are names with one value.
    """

    model: Model
    invariant: Formula
    outside: Formula
    fixed: Mapping[str, Fraction]
    arithmetic: Arithmetic

    @property
    def values(self) -> dict[str, Fraction]:
        """Of constants that have one, and those that are fixed."""
        return {c.name: c.value for c in self.model.constants if c.value is not None} | dict(self.fixed)


def claim_of(
    problem: Problem,
    model: Model,
    outside: Formula = TRUE,
    fixed: Mapping[str, Fraction] | None = None,
    arithmetic: Arithmetic = "double",
) -> Claim:
    """The claim about any policy of a problem, which `model` is, with bounds of its own. `outside` holds in
    the states of which something is claimed. Raises `NotCovered`.
    """
    expanded = nodes(problem.expanded)
    if any(isinstance(n, tree.FuncOf) and n.name in ("pi", "e") and not n.args for n in expanded):
        raise NotCovered("it mentions pi or e, which are not exact numbers here")
    proved = invariant(problem)
    written_down = problem.shape.loop is not None and bool(problem.shape.loop.invariants)
    if proved is None and written_down:
        raise NotCovered("its loop invariant cannot be evaluated")
    return Claim(model, proved or TRUE, outside, fixed or {}, arithmetic)


def questions(claim: Claim, policy: Acting) -> tuple[Question, ...]:
    """One for each way through the statements before the policy observes. Raises `NotCovered`."""
    model = with_exact_domains(claim.model)
    drafts = control_drafts(model, model.body)
    leads = leading_drafts(model)
    if not leads:
        raise NotCovered("no run of the model comes to where the policy decides")
    for lead in leads:
        if lead.flow is not None or lead.target != END:
            raise NotCovered("there is a flow or a loop before the policy observes", lead.span)
    _check(model, drafts, {key for lead in leads for key in lead.alternatives}, policy.squash)
    return tuple(_question(claim, model, policy, drafts, lead) for lead in leads)


def _following(lead: Draft, drafts: Sequence[Draft]) -> list[Draft]:
    """The drafts that take the alternatives that were taken before."""
    taken = lead.alternatives
    return [d for d in drafts if all(taken.get(k, a) == a for k, a in d.alternatives.items())]


def _check(model: Model, drafts: Sequence[Draft], before: Set[str], shares: bool) -> None:
    """Raises `NotCovered`. Decisions taken `before` the policy observes are known. With `shares` of what is
    admissible, the environment may give values afterwards: it gives such that are.
    """
    if not drafts:
        raise NotCovered("no control path can be executed")
    for draft in drafts:
        if draft.flow is None and draft.target != END:
            why = "there is a while loop before the first flow, or a branch after what the environment gives"
            raise NotCovered(why, draft.span)
    own = {key for draft in drafts for key in draft.alternatives}
    for decision in decisions_of(model.body):
        if decision.role != "agent" and decision.key in own - before:
            raise NotCovered(f"the environment decides {decision.key} after the policy", drafts[0].span)
        if decision.role == "agent" and decision.key not in own:
            raise NotCovered(f"{decision.key} is decided after the first motion of a step", drafts[0].span)
    given = {key for draft in drafts for key in draft.inputs}
    for assignment in assignments_of(model.body):
        if assignment.role != "agent" and assignment.key in given and not shares:
            why = f"the environment gives {assignment.variable} its value after the policy"
            raise NotCovered(why, assignment.span)
        if assignment.role == "agent" and assignment.key not in given:
            why = f"{assignment.variable} is given its value after the first motion of a step"
            raise NotCovered(why, assignment.span)


def _question(claim: Claim, model: Model, policy: Acting, drafts: Sequence[Draft], lead: Draft) -> Question:
    """The question after one way through the leading statements."""
    shown = {Symbol(name, "variable"): term for name, term in lead.updates}
    given = _given(claim, bounds := _bounds(model, lead), shown, lead)
    known = {c.symbol: c.value for c in model.constants if c.value is not None} | given
    values: dict[Symbol, Term] = {symbol: Number(value) for symbol, value in known.items()}

    def at_start(formula: Formula) -> Formula:
        return substituted(formula, values)

    def observed(formula: Formula) -> Formula:
        return at_start(substituted(formula, shown))

    always = (c for c in conjuncts(model.precondition) if _is_steady(model, c))
    assumed = map(at_start, (*always, claim.invariant, lead.tests))
    hypothesis = conjunction([*assumed, observed(claim.outside)])
    requests, cases = cases_of(model, policy, _following(lead, drafts), observed, claim.arithmetic)
    names = [_seen(claim, policy, entry, shown, values) for entry in policy.observations]
    terms = {n.name: substituted_term(dict(lead.updates)[n.name], values) for n in names if _is_computed(n)}
    used = symbols(hypothesis, *(c.conclusion for c in cases), *terms.values()) - {r.symbol for r in requests}
    used |= {o.value for o in names if isinstance(o.value, Symbol) and not _is_computed(o)}
    dimensions = tuple(sorted(used, key=lambda s: (s.kind, s.name)))
    box = _box(bounds, hypothesis, dimensions, lead)
    where = dict(zip(dimensions, box, strict=True)), claim.arithmetic, lead.span
    computed = [dimension(n, term, *where) for n, term in terms.items()]
    return Question(
        (*dimensions, *(c.symbol for c in computed)),
        (*box, *(c.range for c in computed)),
        conjunction([hypothesis, *(c.close for c in computed)]),
        tuple(names),
        policy.network.scalings,
        _layers(policy.network),
        requests,
        cases,
        claim.arithmetic,
        computed=tuple((c.symbol, c.term) for c in computed),
        lead=tuple(lead.alternatives.items()),
        given=tuple((s.name, value) for s, value in given.items()),
        shares=policy.squash,
    )


def _given(
    claim: Claim, bounds: Mapping[Symbol, Bound], shown: Mapping[Symbol, Term], lead: Draft
) -> dict[Symbol, Fraction]:
    """Names with one value: what has bounds that are equal, and what the claim fixes; of what the environment
    draws before the policy observes, what it draws. Raises `NotCovered`.
    """
    given = {s: b.low for s, b in bounds.items() if b.low is not None and b.low == b.high}
    for name, value in claim.fixed.items():
        now = shown.get(Symbol(name, "variable"))
        if now is None:
            given |= {Symbol(name, kind): value for kind in ("variable", "constant")}
        elif isinstance(now, Symbol) and now.kind == "input":
            given[now] = value
        elif now != Number(value):
            why = f"--fix {name}: the environment computes `{name}` before the policy observes"
            raise NotCovered(why, lead.span)
    return given


def _is_computed(seen: Observed) -> bool:
    return seen.value == symbol_of(seen.name)


def _layers(network: Network) -> tuple[Layer, ...]:
    """Layers with the tanh of actions that are bounded."""
    last = network.layers[-1]
    if not network.bounded:
        return network.layers
    if last.activation == "identity":
        return (*network.layers[:-1], replace(last, activation="tanh"))
    size = len(last.bias)
    return (*network.layers, Layer(np.eye(size), np.zeros(size), "tanh"))


def _changed(model: Model) -> frozenset[str]:
    return frozenset(written((*model.prefix, *model.lead, *model.body), model.flows))


def _is_steady(model: Model, part: Formula) -> bool:
    """Whether a conjunct of the precondition is about what nothing writes, and so holds throughout."""
    changed = _changed(model)
    return all(
        s.kind == "constant" or (s.kind == "variable" and s.name not in changed) for s in symbols(part)
    )


def _seen(
    claim: Claim,
    policy: Acting,
    entry: tuple[str, float, float],
    shown: Mapping[Symbol, Term],
    values: Mapping[Symbol, Term],
) -> Observed:
    """What an observation shows. Raises `NotCovered`."""
    name, low, high = entry
    known = {
        s.name: s
        for s in (*(v.symbol for v in claim.model.variables), *(c.symbol for c in claim.model.constants))
    }
    if name not in known:
        raise NotCovered(f"the policy observes `{name}`, which the model does not have")
    written_down = substituted_term(substituted_term(known[name], shown), values)
    narrowed = policy.narrowed and claim.arithmetic != "real"
    low, high = in_arithmetic(low, claim.arithmetic), in_arithmetic(high, claim.arithmetic)
    if narrowed:
        low, high = max(low, -LARGEST_FLOAT), min(high, LARGEST_FLOAT)
    match _as_program(written_down, claim.arithmetic):
        case Number(value):
            return Observed(name, value, low, high, narrowed)
        case Symbol() as symbol:
            return Observed(name, symbol, low, high, narrowed)
        case _:
            return Observed(name, symbol_of(name), low, high, narrowed)


def _as_program(term: Term, arithmetic: Arithmetic) -> Term:
    """A term of numbers as its value where the program computes just that; else the term itself."""
    match term_with(term, {}):
        case Number(value) as number:
            literal = isinstance(term.child if isinstance(term, Neg) else term, Number)
            same = arithmetic == "double" and value_of(term, {}) == value
            return number if literal or same or arithmetic == "real" else term
        case _:
            return term


def _bounds(model: Model, lead: Draft) -> dict[Symbol, Bound]:
    """Declared ones, of what is observed, or never changes, or is drawn before the policy observes."""
    changed = _changed(model)
    kept = [v for v in model.variables if v.observed or v.name not in changed]
    bounds = {v.symbol: v.bound for v in kept} | {c.symbol: c.bound for c in model.constants}
    of_key = {a.key: a.variable for a in assignments_of(model.lead)}
    declared = {v.name: v.bound for v in kept}
    for key in lead.inputs:
        bounds[Symbol(key, "input")] = declared.get(of_key.get(key, ""), UNBOUNDED)
    return bounds


def _box(
    bounds: Mapping[Symbol, Bound], hypothesis: Formula, dimensions: Sequence[Symbol], lead: Draft
) -> tuple[Range, ...]:
    """Limits of the states: declared bounds of what is observed or never changes, and what the hypothesis
    implies of others. Raises `NotCovered`.
    """
    around = {s: interval_of(bounds.get(s, UNBOUNDED)) for s in {*dimensions, *symbols(hypothesis)}}
    inside = contract(hypothesis, around)
    box: list[Range] = []
    for s in dimensions:
        bound = bounds.get(s, UNBOUNDED)
        low, high = bound.low, bound.high
        if inside is not None:
            low = Fraction(inside[s].low) if low is None and inside[s].low > -1e300 else low
            high = Fraction(inside[s].high) if high is None and inside[s].high < 1e300 else high
        if low is None or high is None:
            if inside is None:
                low, high = low or Fraction(0), high or Fraction(0)
            else:
                advice = f"declare `bound=[...]` of {s.name}, or give a value with --set {s.name}=VALUE"
                raise NotCovered(f"`{s.name}` has no bounds", lead.span, advice)
        box.append((low, high))
    return tuple(box)


def outside_of(excepted: Formula) -> Formula:
    """States in which a condition does not hold, of terms that always have a value."""
    if not all(map(always_defined, sides(excepted))):
        raise NotCovered("the states that are left out are described by a term without a value somewhere")
    return negation(excepted)
