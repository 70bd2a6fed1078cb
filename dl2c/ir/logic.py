"""Algebra on terms and formulas of the IR: build, negate, measure, substitute.

All functions are total on well-formed trees and keep the order of floating-point
operations; only subterms made of numbers alone are folded, exactly.
"""

import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from fractions import Fraction
from functools import reduce
from typing import Any, TypeVar, assert_never

from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.model import (
    ONE,
    ZERO,
    Add,
    And,
    Binary,
    Bound,
    Call,
    Compare,
    Comparison,
    Div,
    Flow,
    Formula,
    Junction,
    Model,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Sub,
    Symbol,
    Term,
    Truth,
)
from dl2c.source import NOWHERE, Span
from dl2c.work import spend

T = TypeVar("T")

NEGATED: dict[Comparison, Comparison] = {"=": "!=", "!=": "=", "<": ">=", "<=": ">", ">": "<=", ">=": "<"}

ARITHMETIC: Mapping[type[Binary], Callable[[Any, Any], Any]] = {
    Add: operator.add,
    Sub: operator.sub,
    Mul: operator.mul,
    Div: lambda a, b: a / b,
}
"""How Python computes them: with numbers, arrays, and the expressions of solvers."""

COMPARISONS: Mapping[Comparison, Callable[[Any, Any], Any]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def number(value: int | Fraction) -> Number:
    """An exact number."""
    return Number(Fraction(value))


MAX_BITS = 100_000
"""A power is computed exactly as long as numerator and denominator have no more bits."""


def folded(term: Term) -> Term:
    """The term itself, or its exact value where all its direct operands are numbers.

    A power with too many digits stays as it is.
    """
    match term:
        case Neg(Number(a)):
            return Number(-a)
        case Div(Number(), Number(b)) if b == 0:
            return term
        case Binary(Number(a), Number(b)):
            return Number(ARITHMETIC[type(term)](a, b))
        case Pow(Number(a), n) if n * max(a.numerator.bit_length(), a.denominator.bit_length()) <= MAX_BITS:
            return Number(a**n)
        case Call("abs", (Number(a),)):
            return Number(abs(a))
        case Call("min" | "max" as name, (Number(a), Number(b))):
            return Number(FUNCTIONS[name].value(a, b))
        case _:
            return term


def plus(a: Term, b: Term) -> Term:
    """a + b, without structural zeros."""
    return b if a == ZERO else a if b == ZERO else folded(Add(a, b))


def minus(a: Term, b: Term) -> Term:
    """a - b, without structural zeros."""
    return a if b == ZERO else folded(Neg(b) if a == ZERO else Sub(a, b))


def times(a: Term, b: Term) -> Term:
    """a * b, without structural zeros and ones."""
    if ZERO in (a, b):
        return ZERO
    return b if a == ONE else a if b == ONE else folded(Mul(a, b))


def raised(base: Term, exponent: int) -> Term:
    """base^exponent, without structural exponents 0 and 1."""
    return ONE if exponent == 0 else base if exponent == 1 else Pow(base, exponent)


def conjunction(formulas: Iterable[Formula]) -> Formula:
    """Their n-ary conjunction, flattened, with truth values absorbed."""
    return _joined(And, formulas)


def disjunction(formulas: Iterable[Formula]) -> Formula:
    """Their n-ary disjunction, flattened, with truth values absorbed."""
    return _joined(Or, formulas)


def _joined(kind: type[And | Or], formulas: Iterable[Formula]) -> Formula:
    neutral = kind is And
    parts: list[Formula] = []
    for formula in formulas:
        if isinstance(formula, Truth):
            if formula.value != neutral:
                return formula
        elif isinstance(formula, kind):
            parts.extend(formula.children)
        else:
            parts.append(formula)
    return Truth(neutral) if not parts else parts[0] if len(parts) == 1 else kind(tuple(parts))


def domain_at_end(flow: Flow) -> Formula:
    """What must hold where a flow ends."""
    clocks = [Compare("<=", Symbol(h.clock, "variable"), h.bound) for h in flow.horizons]
    return conjunction([*clocks, flow.watched])


def limits_of(term: Term, bound: Bound, span: Span = NOWHERE) -> Iterator[Compare]:
    """That a term is inside a bound."""
    if bound.low is not None:
        yield Compare(">=", term, Number(bound.low), span=span)
    if bound.high is not None:
        yield Compare("<=", term, Number(bound.high), span=span)


def conjuncts(formula: Formula) -> tuple[Formula, ...]:
    """The top-level conjuncts; none of `true`."""
    match formula:
        case And(children):
            return children
        case Truth(True):
            return ()
        case _:
            return (formula,)


def fold(
    formula: Formula,
    truth: Callable[[bool], T],
    atom: Callable[[Compare], T],
    every: Callable[[Iterable[T]], T],
    some: Callable[[Iterable[T]], T],
) -> T:
    """What is made of a formula: of its truth values and atoms, joined by `every` in conjunctions and by
    `some` in disjunctions, which may stop early.
    """
    match formula:
        case Truth(value):
            return truth(value)
        case Compare():
            return atom(formula)
        case And(children):
            return every(fold(c, truth, atom, every, some) for c in children)
        case Or(children):
            return some(fold(c, truth, atom, every, some) for c in children)
        case _:
            assert_never(formula)


def true_where(formula: Formula, atom: Callable[[Compare], bool]) -> bool:
    """The truth of a formula from that of its atoms, which are asked as far as they decide it."""
    return fold(formula, bool, atom, all, any)


def rewritten(formula: Formula, change: Callable[[Compare], Formula]) -> Formula:
    """The formula with every atom replaced, truth values absorbed."""
    return fold(formula, Truth, change, conjunction, disjunction)


def with_atoms(formula: Formula, change: Callable[[Compare], Compare]) -> Formula:
    """The formula with every atom replaced, and nothing simplified."""
    match formula:
        case Truth():
            return formula
        case Compare():
            return change(formula)
        case And(children) | Or(children):
            return type(formula)(tuple(with_atoms(c, change) for c in children))
        case _:
            assert_never(formula)


def with_sides(formula: Formula, change: Callable[[Term], Term]) -> Formula:
    """The formula with both sides of every atom changed, and nothing simplified."""
    return with_atoms(formula, lambda a: Compare(a.op, change(a.left), change(a.right), span=a.span))


def negation(formula: Formula) -> Formula:
    """The negation in normal form. An undefined atom is false in both."""
    return fold(formula, lambda value: Truth(not value), negated, disjunction, conjunction)


def negated(atom: Compare) -> Compare:
    """The opposite comparison."""
    return Compare(NEGATED[atom.op], atom.left, atom.right, span=atom.span)


def oriented(formula: Formula) -> Formula:
    """The same formula with `>` and `>=` turned round, so that equal conditions compare equal."""
    return with_atoms(formula, ascending)


def ascending(atom: Compare) -> Compare:
    """The atom with `<` for `>` and `<=` for `>=`."""
    if atom.op not in (">", ">="):
        return atom
    return Compare("<" if atom.op == ">" else "<=", atom.right, atom.left, span=atom.span)


def difference(atom: Compare) -> Term:
    """Left minus right."""
    return atom.left if atom.right == ZERO else Sub(atom.left, atom.right)


def delta(formula: Formula) -> Term | None:
    """The signed distance to satisfaction (paper eq. 4-5; & is min, | is max, != is |e1-e2|).

    None where a truth value decides alone, which has no finite distance.
    """
    if isinstance(formula, Truth):
        return None
    if isinstance(formula, Compare):
        left, right = formula.left, formula.right
        if formula.op in ("<", "<="):
            return folded(Sub(right, left))
        signed = folded(Sub(left, right))
        if formula.op in (">", ">="):
            return signed
        size = folded(Call("abs", (signed,)))
        return size if formula.op == "!=" else folded(Neg(size))
    terms = [t for c in formula.children if (t := delta(c)) is not None]
    assert len(terms) == len(formula.children), "conjunction and disjunction absorb truth values"
    function = "min" if isinstance(formula, And) else "max"
    return reduce(lambda a, b: Call(function, (a, b)), terms)


def substituted(term: Term, values: Mapping[Symbol, Term]) -> Term:
    """The term with symbols replaced, all at once. Nothing is folded: each operation keeps its rounding."""
    if isinstance(term, Symbol):
        return values.get(term, term)
    return with_operands(term, tuple(substituted(t, values) for t in operands(term)))


def fixed_values(model: Model) -> dict[Symbol, Term]:
    """The constants of a model that have one value."""
    return {c.symbol: Number(c.value) for c in model.constants if c.value is not None}


def with_term(term: Term, old: Term, new: Term) -> Term:
    """The term with every occurrence of a subterm replaced; numbers that meet are folded."""
    if term == old:
        return new
    return folded(with_operands(term, tuple(with_term(t, old, new) for t in operands(term))))


def with_operands(term: Term, parts: tuple[Term, ...]) -> Term:
    """The term with other direct subterms. Nothing is folded."""
    match term:
        case Number() | Symbol():
            return term
        case Neg():
            return Neg(*parts)
        case Pow(_, exponent):
            return Pow(parts[0], exponent)
        case Binary():
            return type(term)(*parts)
        case Call(function):
            return Call(function, parts)
        case _:
            assert_never(term)


def mapped(formula: Formula, change: Callable[[Term], Term]) -> Formula:
    """The formula with `change` applied to both sides of every atom; decided atoms become truth values."""
    return rewritten(with_sides(formula, change), decided)


def decided(atom: Compare) -> Formula:
    """The atom, or its truth value where both sides are numbers that round to the same verdict."""
    if not (isinstance(atom.left, Number) and isinstance(atom.right, Number)):
        return atom
    a, b = atom.left.value, atom.right.value
    verdict = holds(atom.op, a, b)
    return Truth(verdict) if verdict == holds(atom.op, float(a), float(b)) else atom


def holds(op: Comparison, a: Fraction | float, b: Fraction | float) -> bool:
    """Whether `a op b`."""
    return COMPARISONS[op](a, b)


def operands(term: Term) -> tuple[Term, ...]:
    """The direct subterms."""
    match term:
        case Number() | Symbol():
            return ()
        case Neg(child):
            return (child,)
        case Pow(base, _):
            return (base,)
        case Binary():
            return (term.left, term.right)
        case Call(_, args):
            return args
        case _:
            assert_never(term)


def subterms(*parts: Term | Formula) -> Iterator[Term]:
    """Every term before what is inside it, from left to right."""
    stack = list(reversed([t for part in parts for t in _terms(part)]))
    while stack:
        term = stack.pop()
        yield term
        stack.extend(reversed(operands(term)))


def leaves(*parts: Term | Formula) -> Iterator[Term]:
    """Every number and symbol, from left to right."""
    return (t for t in subterms(*parts) if isinstance(t, Number | Symbol))


def _terms(part: Term | Formula) -> Iterable[Term]:
    return sides(part) if isinstance(part, Truth | Compare | Junction) else (part,)


def always_defined(term: Term) -> bool:
    """Whether no state of reasonable size leaves the term without a value."""
    return not any(
        isinstance(t, Div) or (isinstance(t, Call) and not FUNCTIONS[t.function].total)
        for t in subterms(term)
    )


def atoms(formula: Formula) -> Iterator[Compare]:
    """Every atom, left to right."""
    if isinstance(formula, Compare):
        yield formula
    elif isinstance(formula, Junction):
        for child in formula.children:
            yield from atoms(child)


def sides(formula: Formula) -> Iterator[Term]:
    """Both sides of every atom, left to right."""
    for atom in atoms(formula):
        yield from (atom.left, atom.right)


def symbols(*parts: Term | Formula) -> set[Symbol]:
    """All symbols that occur."""
    spend()
    found: set[Symbol] = set()
    stack = [t for part in parts for t in _terms(part)]
    while stack:
        term = stack.pop()
        if isinstance(term, Symbol):
            found.add(term)
        stack += operands(term)
    return found


def size(*parts: Term | Formula) -> int:
    """How many numbers, symbols and operations are written."""
    return sum(1 for _ in subterms(*parts))
