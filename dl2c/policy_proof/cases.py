"""What must hold of a request, case by case: which alternatives are chosen, and where each value lies.

A conclusion compares requests with numbers, at which its truth may change: the limits to which requests are
clipped, 0 where it divides by one. So there is a case for each such number and for what lies between two.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import combinations, pairwise, product

import numpy as np

from dl2c.diagnostics import CompileError
from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import (
    atoms,
    conjunction,
    conjuncts,
    disjunction,
    fold,
    folded,
    holds,
    negation,
    operands,
    rewritten,
    subterms,
    symbols,
    with_operands,
    with_sides,
)
from dl2c.ir.model import (
    ZERO,
    Call,
    Compare,
    Comparison,
    Div,
    Formula,
    Model,
    Number,
    Or,
    Symbol,
    Term,
    Truth,
)
from dl2c.paths.enumerate import Draft, assignments_of, decisions_of
from dl2c.paths.path import Decision
from dl2c.policy_proof.acting import Acting
from dl2c.policy_proof.question import Arithmetic, Case, NotCovered, Premise, Request
from dl2c.quantifiers.eliminate import Quantifier, eliminated
from dl2c.quantifiers.linear import some_between

MOST_CASES = 4096

MOST_ALTERNATIVES = 40
"""Of which pairs are looked at."""

HALF = Fraction(1, 2)

SLACK: dict[Arithmetic, Fraction] = {
    "real": Fraction(0),
    "double": Fraction(1, 2**50),
    "float32": Fraction(1, 2**21),
}
"""More than rounding errors can move the limits between alternatives that are spread over -1..1: an addition
and a multiplication, of numbers up to 2.
"""


def cases_of(
    model: Model,
    policy: Acting,
    drafts: Sequence[Draft],
    observed: Callable[[Formula], Formula],
    arithmetic: Arithmetic,
) -> tuple[tuple[Request, ...], tuple[Case, ...]]:
    """The requests of a policy, and all cases. Raises `NotCovered`."""
    keys = _agents(model)
    if policy.choices or policy.runs:
        return (), tuple(_discrete(policy, drafts, keys, observed))
    requests = _requests(policy, arithmetic)
    given = {s: r.symbol for s, r in _targets(policy, requests).items()}
    counts = policy.rounded
    if counts and tuple(len(d.alternatives) for d in keys) != counts:
        raise NotCovered("its choices are not those of the model")
    own = len(requests) - len(counts)
    divided = () if policy.squash else requests[:own]
    cases: list[Case] = []
    for taken in product(*map(range, counts)):
        chosen = {d.key: k for d, k in zip(keys, taken, strict=False)}
        met = [d for d in drafts if _agrees(d, chosen)]
        if policy.squash:
            paths = [_enabled(model, d, observed) for d in met]
            fixed = [_spread(own + k, a, requests[own + k], arithmetic) for k, a in enumerate(taken)]
        else:
            paths = [observed(_possible(d, policy.variables, given, requests)) for d in met]
            fixed = [_alternative(own + k, a, counts[k]) for k, a in enumerate(taken)]
        about = ", ".join(f"{key}={k}" for key, k in chosen.items())
        cases += _divided(divided, exhausted(disjunction(paths)), tuple(fixed), about)
        if len(cases) > MOST_CASES:
            raise NotCovered(f"there are more than {MOST_CASES} cases")
    return requests, tuple(cases)


def _agents(model: Model) -> tuple[Decision, ...]:
    found = {d.key: d for d in decisions_of(model.body) if d.role == "agent"}
    return tuple(found.values())


def _agrees(draft: Draft, chosen: Mapping[str, int]) -> bool:
    return all(chosen.get(key, k) == k for key, k, _ in draft.line.decisions)


def _meets(draft: Draft, keys: Sequence[Decision]) -> set[str]:
    """The decisions of the agent on a path. A run names all of its own, and no others."""
    return {d.key for d in keys} & draft.alternatives.keys()


def _discrete(
    policy: Acting, drafts: Sequence[Draft], keys: Sequence[Decision], observed: Callable[[Formula], Formula]
) -> Iterator[Case]:
    """A case for each vector of alternatives, of which each is the largest of its group."""
    if any(d.inputs for d in drafts):
        raise NotCovered("the policy decides between alternatives only; the model has inputs too")
    if policy.runs:
        vectors = [(run, (r,)) for r, run in enumerate(policy.runs)]
        groups = [range(len(policy.runs))]
    else:
        starts = [sum(policy.choices[:k]) for k in range(len(policy.choices))]
        groups = [range(s, s + n) for s, n in zip(starts, policy.choices, strict=True)]
        vectors = [(tuple(o - g.start for o, g in zip(v, groups, strict=True)), v) for v in product(*groups)]
    if len(vectors) > MOST_CASES:
        raise NotCovered(f"there are more than {MOST_CASES} cases")
    if len(keys) != len(vectors[0][0]):
        raise NotCovered("its choices are not those of the model")
    for taken, winners in vectors:
        chosen = {d.key: k for d, k in zip(keys, taken, strict=True) if k >= 0}
        met = [d for d in drafts if not policy.runs or chosen.keys() == _meets(d, keys)]
        paths = [conjunction([d.tests, *_assigned(d)]) for d in met if _agrees(d, chosen)]
        pairs = tuple((w, o) for w, g in zip(winners, groups, strict=True) for o in g if o != w)
        about = ", ".join(f"{key}={k}" for key, k in chosen.items())
        yield Case((), pairs, exhausted(observed(disjunction(paths))), about)


def _requests(policy: Acting, arithmetic: Arithmetic) -> tuple[Request, ...]:
    values = (*policy.inputs, *policy.variables)
    names = (*values, *(f"choice {k}" for k in range(len(policy.rounded))))
    last = (*(None for _ in values), *(n - 1 if policy.squash else None for n in policy.rounded))
    low, high = ([in_arithmetic(v, arithmetic) for v in ends] for ends in (policy.low, policy.high))
    return tuple(
        Request(Fraction(low), Fraction(high), policy.network.bounded, Symbol(f"request {name}", "input"), to)
        for name, low, high, to in zip(names, low, high, last, strict=True)
    )


def in_arithmetic(limit: float, arithmetic: Arithmetic) -> float:
    """A limit as the program has it."""
    return float(np.float32(limit)) if arithmetic == "float32" else limit


def _targets(policy: Acting, requests: Sequence[Request]) -> dict[Symbol, Request]:
    """What inputs are given."""
    keys = (Symbol(key, "input") for key in policy.inputs)
    return dict(zip(keys, requests, strict=False))


def _possible(
    draft: Draft, variables: Sequence[str], given: Mapping[Symbol, Symbol], requests: Sequence[Request]
) -> Formula:
    """That a path can be taken with what is requested: of inputs, or of the variables that it leads to."""
    values: dict[Symbol, Term] = dict(given)
    updates = dict(draft.updates)
    equalities: list[Formula] = []
    for name, request in zip(variables, requests, strict=False):
        value = updates.get(name, Symbol(name, "variable"))
        if isinstance(value, Symbol) and value.kind == "input" and value not in values:
            values[value] = request.symbol
        else:
            equalities.append(Compare("=", request.symbol, value))
    found = conjunction([draft.tests, *_assigned(draft), *equalities])
    free = {s for s in symbols(found) if s.kind == "input" and s.name in draft.inputs} - {*values}
    if free:
        name = min(s.name for s in free).removeprefix("assign_")
        raise NotCovered(f"no output of the policy gives `{name}` its value", draft.span)
    return substituted(found, values)


def _enabled(model: Model, draft: Draft, observed: Callable[[Formula], Formula]) -> Formula:
    """That some values of its inputs take a path, also of those that the environment gives, and that what it
    assigns has a value whichever these are. Values are within the bounds of their variables. Raises
    `NotCovered`.
    """
    bounds = {v.name: v.bound for v in model.variables}
    variable = {a.key: a.variable for a in assignments_of(model.body)}
    inputs = {key: Symbol(key, "input") for key in draft.inputs}
    passing = [observed(draft.tests)]
    for key, symbol in inputs.items():
        low, high = (bound := bounds[variable[key]]).low, bound.high
        if low is None or high is None:
            name = variable[key]
            why, advice = f"`{name}` has no bounds", f"declare `bound=[...]` of {name}"
            raise NotCovered(f"{why}, within which values are looked for", draft.place_of(key), advice)
        passing += [Compare(">=", symbol, Number(low)), Compare("<=", symbol, Number(high))]

    def some(formulas: Iterable[Formula]) -> Formula:
        found = conjunction(formulas)
        for key, symbol in reversed(inputs.items()):
            if (between := some_between(symbol, found)) is not None:
                found = between
                continue
            span = draft.place_of(key)
            try:
                found = eliminated(Quantifier(False, variable[key], symbol, False, span), found)
            except CompileError as problem:
                why = f"whether `{variable[key]}` has an admissible value is not known in general"
                raise NotCovered(why, span, problem.diagnostics[0].label) from None
        return found

    undefined = [some([*passing, observed(negation(defined))]) for defined in _assigned(draft)]
    return conjunction([some(passing), *map(negation, undefined)])


def _assigned(draft: Draft) -> Iterator[Formula]:
    """That every value that a path assigns is there."""
    return _defined(value for _, value in draft.updates)


def _defined(terms: Iterable[Term]) -> Iterator[Formula]:
    """That terms have a value."""
    for term in subterms(*terms):
        if isinstance(term, Div):
            yield _decided(Compare("!=", term.right, ZERO))
        if isinstance(term, Call) and (domain := FUNCTIONS[term.function].domain) is not None:
            yield from domain(*term.args)


def _alternative(request: int, taken: int, count: int) -> Premise:
    """That a request is rounded to an alternative; a request between two may be rounded to both."""
    low = None if taken == 0 else taken - HALF
    high = None if taken == count - 1 else taken + HALF
    return Premise(request, low, high, False, Fraction(taken))


def _spread(request: int, taken: int, spread: Request, arithmetic: Arithmetic) -> Premise:
    """That a request is rounded to an alternative of those that are spread over its limits."""
    assert spread.last is not None
    among, slack = _alternative(request, taken, spread.last + 1), SLACK[arithmetic]
    low, high = (None if end is None else -1 + 2 * end / spread.last for end in (among.low, among.high))
    low, high = low if low is None else low - slack, high if high is None else high + slack
    return replace(among, low=low, high=high)


def _divided(
    requests: Sequence[Request], conclusion: Formula, fixed: tuple[Premise, ...], about: str
) -> Iterator[Case]:
    """Cases by where each request lies: at a number that the conclusion compares it with, or between two."""
    parts = [list(_parts(k, r, conclusion)) for k, r in enumerate(requests)]
    for chosen in product(*parts):
        known = {requests[p.request].symbol: p for p in chosen}
        yield Case((*chosen, *fixed), (), _known(conclusion, known), about)


def _parts(k: int, request: Request, conclusion: Formula) -> Iterator[Premise]:
    low, high = request.low, request.high
    if low == high:
        yield Premise(k, None, None, False, low)
        return
    inner = {c for c in _numbers(conclusion, request.symbol) if low < c < high}
    marks = [low, *sorted(inner), high]
    yield Premise(k, None, low, False, low)
    for before, after in pairwise(marks):
        yield Premise(k, before, after, True, None)
        if after != high:
            yield Premise(k, after, after, False, after)
    yield Premise(k, high, None, False, high)


def _numbers(formula: Formula, symbol: Symbol) -> Iterator[Fraction]:
    """Numbers that a symbol is compared with, and 0 where it divides."""
    for atom in atoms(formula):
        for a, b in ((atom.left, atom.right), (atom.right, atom.left)):
            if a == symbol and isinstance(b, Number):
                yield b.value
        yield from (Fraction(0) for term in (atom.left, atom.right) if _divides(term, symbol))


def _divides(term: Term, symbol: Symbol) -> bool:
    return (isinstance(term, Div) and term.right == symbol) or any(
        _divides(t, symbol) for t in operands(term)
    )


def _known(formula: Formula, known: Mapping[Symbol, Premise]) -> Formula:
    """The formula with what is known of requests: their value, or on which side of a number they are."""
    values: dict[Symbol, Term] = {s: Number(p.value) for s, p in known.items() if p.value is not None}

    def simplified(atom: Compare) -> Formula:
        for symbol, premise in known.items():
            if premise.value is not None:
                continue
            if atom.left == symbol and isinstance(atom.right, Number):
                return _compared(atom, premise, atom.right.value, False)
            if atom.right == symbol and isinstance(atom.left, Number):
                return _compared(atom, premise, atom.left.value, True)
        return atom

    return exhausted(rewritten(substituted(formula, values), simplified))


def _compared(atom: Compare, premise: Premise, number: Fraction, turned: bool) -> Formula:
    """An atom that compares what lies strictly between two numbers with a number that does not."""
    assert premise.low is not None and premise.high is not None
    if premise.low < number < premise.high:
        return atom
    middle = (premise.low + premise.high) / 2
    return Truth(holds(atom.op, number, middle) if turned else holds(atom.op, middle, number))


SIGNS: dict[Comparison, frozenset[int]] = {
    "<": frozenset({-1}),
    "<=": frozenset({-1, 0}),
    "=": frozenset({0}),
    "!=": frozenset({-1, 1}),
    ">": frozenset({1}),
    ">=": frozenset({0, 1}),
}
"""Of the difference of both sides."""


def exhausted(formula: Formula) -> Formula:
    """The formula, alternatives that leave no case out, such as `a <= b | a > b`, replaced by what it takes
    for a and b to have a value; also where both stand beside the same conditions.
    """
    return fold(formula, Truth, lambda atom: atom, conjunction, _alternatives)


def _alternatives(formulas: Iterable[Formula]) -> Formula:
    joined = disjunction(formulas)
    parts = list(joined.children) if isinstance(joined, Or) else [joined]
    while len(parts) <= MOST_ALTERNATIVES and (pair := _complementary(parts)) is not None:
        first, second, merged = pair
        parts = [merged, *(p for k, p in enumerate(parts) if k not in (first, second))]
    return disjunction(parts)


def _complementary(parts: Sequence[Formula]) -> tuple[int, int, Formula] | None:
    """The places of two alternatives that differ in one comparison each, and what they say together where
    that is less.
    """
    for (i, first), (j, second) in combinations(enumerate(map(conjuncts, parts)), 2):
        own = [c for c in first if c not in second]
        other = [c for c in second if c not in first]
        if len(own) == len(other) == 1 and (both := _either(own[0], other[0])) is not None:
            return i, j, conjunction([*(c for c in first if c in second), both])
    return None


def _either(one: Formula, other: Formula) -> Formula | None:
    """What it takes that one of two comparisons of the same terms holds, if that is one condition."""
    if not isinstance(one, Compare) or not isinstance(other, Compare):
        return None
    sides, signs = (one.left, one.right), SIGNS[other.op]
    if sides == (other.right, other.left):
        signs = frozenset(-sign for sign in signs)
    elif sides != (other.left, other.right):
        return None
    either = SIGNS[one.op] | signs
    if len(either) == 3:
        return conjunction(_defined(sides))
    return next(Compare(op, *sides) for op, known in SIGNS.items() if known == either)


# Substitution --------------------------------------------------------------------------------------


def substituted(formula: Formula, values: Mapping[Symbol, Term]) -> Formula:
    """With symbols replaced, numbers folded, and atoms between numbers decided exactly."""
    replaced = with_sides(formula, lambda term: term_with(term, values))
    return rewritten(replaced, _decided)


def _decided(atom: Compare) -> Formula:
    if isinstance(atom.left, Number) and isinstance(atom.right, Number):
        return Truth(holds(atom.op, atom.left.value, atom.right.value))
    return atom


def term_with(term: Term, values: Mapping[Symbol, Term]) -> Term:
    if isinstance(term, Symbol):
        return values.get(term, term)
    return folded(with_operands(term, tuple(term_with(t, values) for t in operands(term))))
