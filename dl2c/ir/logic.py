"""Algebra on terms and formulas of the IR: build, negate, measure, substitute.

All functions are total on well-formed trees and keep the order of floating-point
operations; only subterms made of numbers alone are folded, exactly.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from fractions import Fraction
from typing import assert_never

from dl2c.ir.model import (
    FALSE,
    ONE,
    TRUE,
    ZERO,
    Add,
    And,
    Call,
    Compare,
    Comparison,
    Div,
    Flow,
    Formula,
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
from dl2c.work import spend

NEGATED: dict[Comparison, Comparison] = {"=": "!=", "!=": "=", "<": ">=", "<=": ">", ">": "<=", ">=": "<"}


def number(value: int | Fraction) -> Number:
    """An exact number."""
    return Number(Fraction(value))


MAX_BITS = 100_000
"""Of the numerator and the denominator of a power that is computed exactly."""


def folded(term: Term) -> Term:
    """The term itself, or its exact value where all its direct operands are numbers.

    A power with too many digits stays as it is.
    """
    match term:
        case Neg(Number(a)):
            return Number(-a)
        case Add(Number(a), Number(b)):
            return Number(a + b)
        case Sub(Number(a), Number(b)):
            return Number(a - b)
        case Mul(Number(a), Number(b)):
            return Number(a * b)
        case Div(Number(a), Number(b)) if b != 0:
            return Number(a / b)
        case Pow(Number(a), n) if n * max(a.numerator.bit_length(), a.denominator.bit_length()) <= MAX_BITS:
            return Number(a**n)
        case Call("abs", (Number(a),)):
            return Number(abs(a))
        case Call("min", (Number(a), Number(b))):
            return Number(min(a, b))
        case Call("max", (Number(a), Number(b))):
            return Number(max(a, b))
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


def conjunction(formulas: Iterable[Formula]) -> Formula:
    """Their n-ary conjunction, flattened, with truth values absorbed."""
    parts: list[Formula] = []
    for formula in formulas:
        match formula:
            case Truth(False):
                return FALSE
            case Truth(True):
                pass
            case And(children):
                parts.extend(children)
            case _:
                parts.append(formula)
    return TRUE if not parts else parts[0] if len(parts) == 1 else And(tuple(parts))


def disjunction(formulas: Iterable[Formula]) -> Formula:
    """Their n-ary disjunction, flattened, with truth values absorbed."""
    parts: list[Formula] = []
    for formula in formulas:
        match formula:
            case Truth(True):
                return TRUE
            case Truth(False):
                pass
            case Or(children):
                parts.extend(children)
            case _:
                parts.append(formula)
    return FALSE if not parts else parts[0] if len(parts) == 1 else Or(tuple(parts))


def domain_at_end(flow: Flow) -> Formula:
    """What must hold where a flow ends."""
    clocks = [Compare("<=", Symbol(h.clock, "variable"), h.bound) for h in flow.horizons]
    return conjunction([*clocks, flow.watched])


def conjuncts(formula: Formula) -> tuple[Formula, ...]:
    """The top-level conjuncts; none of `true`."""
    match formula:
        case And(children):
            return children
        case Truth(True):
            return ()
        case _:
            return (formula,)


def negation(formula: Formula) -> Formula:
    """The negation in normal form. An undefined atom is false in both."""
    match formula:
        case Truth(value):
            return Truth(not value)
        case Compare(op, left, right):
            return Compare(NEGATED[op], left, right, span=formula.span)
        case And(children):
            return disjunction(negation(c) for c in children)
        case Or(children):
            return conjunction(negation(c) for c in children)
        case _:
            assert_never(formula)


def oriented(formula: Formula) -> Formula:
    """The same formula with `>` and `>=` turned round, so that equal conditions compare equal."""
    match formula:
        case Compare(">", left, right):
            return Compare("<", right, left)
        case Compare(">=", left, right):
            return Compare("<=", right, left)
        case And(children):
            return And(tuple(oriented(c) for c in children))
        case Or(children):
            return Or(tuple(oriented(c) for c in children))
        case _:
            return formula


def delta(formula: Formula) -> Term | None:
    """The signed distance to satisfaction (paper eq. 4-5; & is min, | is max, != is |e1-e2|).

    None where a truth value decides alone, which has no finite distance.
    """
    match formula:
        case Truth():
            return None
        case Compare(op, left, right):
            match op:
                case "<" | "<=":
                    return folded(Sub(right, left))
                case ">" | ">=":
                    return folded(Sub(left, right))
                case "=":
                    return folded(Neg(folded(Call("abs", (folded(Sub(left, right)),)))))
                case "!=":
                    return folded(Call("abs", (folded(Sub(left, right)),)))
                case _:
                    assert_never(op)
        case And(children) | Or(children):
            terms = [delta(c) for c in children]
            present = [t for t in terms if t is not None]
            assert len(present) == len(terms), "conjunction and disjunction absorb truth values"
            result = present[0]
            for term in present[1:]:
                result = Call("min" if isinstance(formula, And) else "max", (result, term))
            return result
        case _:
            assert_never(formula)


def substituted(term: Term, values: Mapping[Symbol, Term]) -> Term:
    """The term with symbols replaced, all at once. Nothing is folded: each operation keeps its rounding."""
    match term:
        case Number():
            return term
        case Symbol():
            return values.get(term, term)
        case Neg(child):
            return Neg(substituted(child, values))
        case Pow(base, exponent):
            return Pow(substituted(base, values), exponent)
        case Add(left, right) | Sub(left, right) | Mul(left, right) | Div(left, right):
            return type(term)(substituted(left, values), substituted(right, values))
        case Call(function, args):
            return Call(function, tuple(substituted(a, values) for a in args))
        case _:
            assert_never(term)


def fixed_values(model: Model) -> dict[Symbol, Term]:
    """The constants of a model that have one value."""
    return {Symbol(c.name, "constant"): Number(c.value) for c in model.constants if c.value is not None}


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
        case Add() | Sub() | Mul() | Div():
            return type(term)(*parts)
        case Call(function):
            return Call(function, parts)
        case _:
            assert_never(term)


def mapped(formula: Formula, change: Callable[[Term], Term]) -> Formula:
    """The formula with `change` applied to both sides of every atom; decided atoms become truth values."""
    match formula:
        case Truth():
            return formula
        case Compare(op, left, right):
            return decided(Compare(op, change(left), change(right), span=formula.span))
        case And(children):
            return conjunction(mapped(c, change) for c in children)
        case Or(children):
            return disjunction(mapped(c, change) for c in children)
        case _:
            assert_never(formula)


def decided(atom: Compare) -> Formula:
    """The atom, or its truth value where both sides are numbers that round to the same verdict."""
    if not (isinstance(atom.left, Number) and isinstance(atom.right, Number)):
        return atom
    a, b = atom.left.value, atom.right.value
    verdict = holds(atom.op, a, b)
    return Truth(verdict) if verdict == holds(atom.op, float(a), float(b)) else atom


def holds(op: Comparison, a: Fraction | float, b: Fraction | float) -> bool:
    """Whether `a op b`."""
    match op:
        case "=":
            return a == b
        case "!=":
            return a != b
        case "<":
            return a < b
        case "<=":
            return a <= b
        case ">":
            return a > b
        case ">=":
            return a >= b
        case _:
            assert_never(op)


def operands(term: Term) -> tuple[Term, ...]:
    """The direct subterms."""
    match term:
        case Number() | Symbol():
            return ()
        case Neg(child):
            return (child,)
        case Pow(base, _):
            return (base,)
        case Add(left, right) | Sub(left, right) | Mul(left, right) | Div(left, right):
            return (left, right)
        case Call(_, args):
            return args
        case _:
            assert_never(term)


def always_defined(term: Term) -> bool:
    """Whether no state of reasonable size leaves the term without a value."""
    match term:
        case Div() | Call("sqrt" | "exp" | "tan" | "arcsin" | "pow"):
            return False
        case _:
            return all(always_defined(t) for t in operands(term))


def atoms(formula: Formula) -> Iterator[Compare]:
    """Every atom, left to right."""
    match formula:
        case Truth():
            return
        case Compare():
            yield formula
        case And(children) | Or(children):
            for child in children:
                yield from atoms(child)
        case _:
            assert_never(formula)


def symbols(*parts: Term | Formula) -> set[Symbol]:
    """All symbols that occur."""
    spend()
    found: set[Symbol] = set()
    stack: list[Term] = []
    for part in parts:
        if isinstance(part, (Truth, Compare, And, Or)):
            for atom in atoms(part):
                stack += (atom.left, atom.right)
        else:
            stack.append(part)
    while stack:
        term = stack.pop()
        if isinstance(term, Symbol):
            found.add(term)
        stack += operands(term)
    return found
