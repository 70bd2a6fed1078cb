"""Formulas without quotients, roots and other functions, for solvers of polynomial arithmetic.

Each such subterm gets a name and facts that hold of it. A quotient, root or power outside of its domain is
any number: the facts say nothing of it there. What a solver finds impossible is then impossible whatever
undefined terms are taken to be, as long as atoms of the goal also say that their terms are defined: that
makes the goal stronger than under either reading of undefined terms, and the hypotheses weaker.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TypeAlias

from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import conjunction, disjunction, negation, operands, rewritten, subterms, with_operands
from dl2c.ir.model import (
    ONE,
    ZERO,
    Add,
    Call,
    Compare,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Pow,
    Symbol,
    Term,
)

PI = Symbol("pi()", "constant")
E = Symbol("e()", "constant")
"""The numbers, as symbols of which only enclosures are known."""

_ENCLOSURES = {
    PI: (Fraction(314159265358979323846, 10**20), Fraction(314159265358979323847, 10**20)),
    E: (Fraction(271828182845904523536, 10**20), Fraction(271828182845904523537, 10**20)),
}

MAX_BITS = 20_000
"""Of a number."""

LARGEST_ROOT = 6
"""Of powers with rational exponents that become roots."""


Conditions: TypeAlias = Callable[[Formula], Iterable[Compare]]
"""On the terms of an atom."""


@dataclass(slots=True)
class Totals:
    """Names of subterms, and the facts that hold of them."""

    names: dict[Term, Symbol] = field(default_factory=dict[Term, Symbol])
    facts: list[Formula] = field(default_factory=list[Formula])

    def formula(self, formula: Formula, conditions: Conditions) -> Formula:
        """The formula, in which an atom holds only under conditions on its terms."""

        def atom(a: Compare) -> Formula:
            plain = Compare(a.op, self.term(a.left), self.term(a.right), span=a.span)
            defined = (Compare(d.op, self.term(d.left), self.term(d.right)) for d in conditions(a))
            return conjunction([*defined, plain])

        return rewritten(formula, atom)

    def term(self, term: Term) -> Term:
        """The term as a polynomial of symbols and names."""
        if isinstance(term, Number) or not operands(term):
            self._number(term)
            return term
        parts = tuple(self.term(t) for t in operands(term))
        match term:
            case Div(_, Number(value)) if value:
                return Mul(Number(1 / value), parts[0])
            case Call("pow", (Number(base), Number(exponent))) if _is_short(base, exponent):
                return Number(base ** int(exponent))
            case Div() | Call():
                return self._named(with_operands(term, parts))
            case _:
                return with_operands(term, parts)

    def _number(self, term: Term) -> None:
        """Note the enclosure of pi and e."""
        if isinstance(term, Symbol) and term in _ENCLOSURES and term not in self.names:
            self.names[term] = term
            low, high = _ENCLOSURES[term]
            self.facts += [Compare("<", Number(low), term), Compare("<", term, Number(high))]

    def _named(self, term: Term) -> Symbol:
        if term not in self.names:
            kind = term.function if isinstance(term, Call) else "quotient"
            name = self.names[term] = Symbol(f"{kind} {len(self.names)}", "variable")
            self.facts += self._facts(term, name)
        return self.names[term]

    def _facts(self, term: Term, value: Symbol) -> Iterable[Formula]:
        match term:
            case Div(left, right):
                return [_either(_is("=", right, ZERO), _is("=", Mul(value, right), left))]
            case Call("abs", (a,)):
                return [_cases(_is(">=", a, ZERO), value, a, Neg(a))]
            case Call("min", (a, b)):
                return [_cases(_is("<", a, b), value, a, b)]
            case Call("max", (a, b)):
                return [_cases(_is(">", a, b), value, a, b)]
            case Call("sqrt", (a,)):
                return [
                    _either(
                        _is("<", a, ZERO), conjunction([_is(">=", value, ZERO), _is("=", Pow(value, 2), a)])
                    )
                ]
            case Call("pow", (base, exponent)):
                return list(_facts_of_power(value, base, exponent))
            case Call("sin" | "cos" as name, (a,)):
                other = self._named(Call("cos" if name == "sin" else "sin", (a,)))
                return [_is("=", Add(Pow(value, 2), Pow(other, 2)), ONE)]
            case Call("exp", (a,)):
                signs = [_either(_is(s, a, ZERO), _is(t, value, ONE)) for s, t in ((">", "<="), ("<", ">="))]
                return [_is(">", value, ZERO), _is(">=", value, Add(ONE, a)), *signs]
            case Call("tanh", (a,)):
                return [_is("<", value, ONE), _is(">", value, Number(Fraction(-1))), *_same_sign(value, a)]
            case Call("arctan", (a,)):
                limit = Mul(Number(Fraction(1, 2)), self.term(PI))
                return [_is("<", value, limit), _is(">", value, Neg(limit)), *_same_sign(value, a)]
            case _:
                return []


def _is_short(base: Fraction, exponent: Fraction) -> bool:
    """Whether a power of a positive number is a rational number that can be written down."""
    digits = max(base.numerator.bit_length(), base.denominator.bit_length())
    return base > 0 and exponent.denominator == 1 and abs(exponent) * digits <= MAX_BITS


def _is(op: str, left: Term, right: Term) -> Formula:
    return Compare(op, left, right)  # pyright: ignore[reportArgumentType]


def _either(*formulas: Formula) -> Formula:
    return disjunction(formulas)


def _cases(condition: Formula, value: Symbol, then: Term, otherwise: Term) -> Formula:
    one = conjunction([condition, _is("=", value, then)])
    return _either(one, conjunction([negation(condition), _is("=", value, otherwise)]))


def _same_sign(value: Symbol, a: Term) -> list[Formula]:
    """That an odd rising function has the sign of its argument."""
    return [
        _either(_is("<=", a, ZERO), _is(">", value, ZERO)),
        _either(_is(">=", a, ZERO), _is("<", value, ZERO)),
        _either(_is("!=", a, ZERO), _is("=", value, ZERO)),
    ]


def _facts_of_power(value: Symbol, base: Term, exponent: Term) -> Iterator[Formula]:
    """Of a power of a positive number."""
    beyond = _is("<=", base, ZERO)
    yield _either(beyond, _is(">", value, ZERO))
    if isinstance(exponent, Number) and exponent.value.denominator <= LARGEST_ROOT:
        above, below = abs(exponent.value.numerator), exponent.value.denominator
        if 0 < above <= LARGEST_ROOT:
            root, power = Pow(value, below), Pow(base, above)
            plain = _is("=", root, power) if exponent.value > 0 else _is("=", Mul(root, power), ONE)
            yield _either(beyond, plain)


def domains(*parts: Term | Formula) -> Iterator[Compare]:
    """The conditions under which all terms have values, over the reals."""
    for term in dict.fromkeys(subterms(*parts)):
        yield from _own_domain(term)


def _own_domain(term: Term) -> Iterator[Compare]:
    """Where a term has a value if its parts have."""
    match term:
        case Div(_, Number(value)) if value:
            pass
        case Div(_, right):
            yield Compare("!=", right, ZERO)
        case Call("sqrt", (Number(value),)) if value >= 0:
            pass
        case Call("pow", (Number(value), _)) if value > 0:
            pass
        case Call(function, args) if (domain := FUNCTIONS[function].domain) is not None:
            yield from domain(*args)
        case _:
            pass


def needed(*parts: Term | Formula) -> Iterator[Compare]:
    """Conditions that hold wherever all terms have values. They are those of `domains` but for powers, which
    have values for some bases that are not positive: whole powers, and where the exponent is not a number.
    """
    for term in dict.fromkeys(subterms(*parts)):
        match term:
            case Call("pow", (base, exponent)):
                value = exponent.value if isinstance(exponent, Number) else Fraction(0)
                if not value.denominator % 2:
                    yield Compare(">=", base, ZERO)
                if value < 0:
                    yield Compare("!=", base, ZERO)
            case _:
                yield from _own_domain(term)


def is_total(*parts: Term | Formula) -> bool:
    """Whether every term has a value in every state."""
    return next(domains(*parts), None) is None


def totalised(
    hypotheses: Sequence[Formula], goal: Formula, if_defined: bool
) -> tuple[list[Formula], Formula]:
    """A question for a solver: hypotheses with the facts of all names, and the goal.

    Hypotheses are taken as they are if undefined terms may be any number, and, `if_defined`, only where
    their terms are defined.
    """
    totals = Totals()
    given = [totals.formula(h, needed if if_defined else _nothing) for h in hypotheses]
    wanted = totals.formula(goal, domains)
    return [*given, *totals.facts], wanted


def _nothing(_: Formula) -> Iterable[Compare]:
    return ()


# abs, min and max as cases ----------------------------------------------------------


def without_cases(formula: Formula, total: Callable[[Compare], bool] = is_total) -> Formula:
    """An equivalent formula without abs, min and max where a comparison has one of them as a side, and all of
    its terms have values, as `total` says: a case may do without those that have none.
    """

    def atom(a: Compare) -> Formula:
        if not any(isinstance(side, Call) for side in (a.left, a.right)) or not total(a):
            return a
        found = first_case(a)
        return a if found is None else without_cases(found, total)

    return rewritten(formula, atom)


def first_case(atom: Compare) -> Formula | None:
    """The atom without the first abs, min or max in it; None where it has none."""
    for call in _calls_in(atom.left, atom.right):
        if call.function == "abs":
            one, other = call.args[0], Neg(call.args[0])
        else:
            one, other = call.args
        first, second = (_with(atom, call, value) for value in (one, other))
        larger = call.function != "min"
        if (sign := _direction(atom, call)) is not None:
            return conjunction([first, second]) if sign == larger else disjunction([first, second])
        condition = Compare(">=" if larger else "<=", one, other)
        return disjunction([conjunction([condition, first]), conjunction([negation(condition), second])])
    return None


def _direction(atom: Compare, call: Call) -> bool | None:
    """True where the atom says that the call is small, False where it says that it is large."""
    if atom.op in ("=", "!="):
        return None
    small = atom.op in ("<", "<=")
    for side, sign in ((atom.left, small), (atom.right, not small)):
        other = atom.right if side is atom.left else atom.left
        if side == call and not any(c == call for c in _calls_in(other)):
            return sign
    return None


def _calls_in(*terms: Term) -> Iterator[Call]:
    for term in terms:
        for part in operands(term):
            yield from _calls_in(part)
        if isinstance(term, Call) and term.function in ("abs", "min", "max"):
            yield term


def _with(atom: Compare, old: Term, new: Term) -> Compare:
    def changed(term: Term) -> Term:
        return new if term == old else with_operands(term, tuple(map(changed, operands(term))))

    return Compare(atom.op, changed(atom.left), changed(atom.right), span=atom.span)
