"""A differential equation as a polynomial vector field.

Functions of what moves become further symbols with equations of their own: sin and cos of an argument, exp,
and the inverse of a divisor. Functions of what does not move become constants. Facts tie all of these to the
terms that they stand for. Divisors must be known to be nonzero while the equation is followed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from dl2c.ir.logic import (
    disjunction,
    negated,
    operands,
    rewritten,
    substituted,
    symbols,
    with_operands,
)
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
    Sub,
    Symbol,
    Term,
)
from dl2c.verify.arithmetic.polynomials import NotPolynomial, Polynomial, Ring
from dl2c.verify.arithmetic.total import domains, first_case
from dl2c.verify.states import Names


@dataclass(slots=True)
class Field:
    """`rates` of the symbols that move. `nonzero(b)` says whether a divisor is proved to be so. `ties` are
    facts about the symbols that stand for other terms; `smooth` where all rates are polynomials.
    """

    rates: dict[Symbol, Term]
    names: Names
    nonzero: Callable[[Term], bool]
    ties: list[Formula] = field(default_factory=list[Formula])
    known: dict[Term, Symbol] = field(default_factory=dict[Term, Symbol])
    smooth: bool = True

    def __post_init__(self) -> None:
        """Make all rates polynomials, as far as that goes."""
        plain: dict[Symbol, Term] = {}
        for symbol, rate in list(self.rates.items()):
            try:
                plain[symbol] = self.plain(rate)
            except NotPolynomial:
                self.smooth = False
        self.rates.update(plain)

    def moves(self, *parts: Term | Formula) -> bool:
        """Whether the value of a term changes while the equation is followed."""
        return any(s in self.rates for s in symbols(*parts))

    def plain(self, term: Term) -> Term:
        """The term as a polynomial of symbols, with new ones where needed. Raises `NotPolynomial`."""
        parts = tuple(self.plain(t) for t in operands(term))
        match term:
            case Number() | Symbol():
                return term
            case Div(_, Number(value)) if value:
                return Mul(Number(1 / value), parts[0])
            case Div():
                return Mul(parts[0], self._inverse(parts[1]))
            case Call():
                return self._function(with_operands(term, parts))
            case _:
                return with_operands(term, parts)

    def _inverse(self, divisor: Term) -> Symbol:
        term = Div(ONE, divisor)
        if term not in self.known:
            if not self.nonzero(divisor):
                raise NotPolynomial("a divisor may be zero")
            inverse = self._named("inverse", term)
            self.ties.append(Compare("=", Mul(inverse, divisor), ONE))
            if self.moves(divisor):
                self.rates[inverse] = Neg(Mul(Pow(inverse, 2), self.derivative(divisor)))
        return self.known[term]

    def _function(self, call: Term) -> Symbol:
        if call in self.known:
            return self.known[call]
        match call:
            case Call("sin" | "cos", (a,)) if self.moves(a):
                sine, cosine = (self._named(f, Call(f, (a,))) for f in ("sin", "cos"))
                rate = self.derivative(a)
                self.rates[sine] = Mul(cosine, rate)
                self.rates[cosine] = Neg(Mul(sine, rate))
                self.ties += [Compare("=", s, Call(f, (a,))) for f, s in (("sin", sine), ("cos", cosine))]
            case Call("exp", (a,)) if self.moves(a):
                power = self._named("exp", call)
                self.rates[power] = Mul(power, self.derivative(a))
                self.ties.append(Compare("=", power, call))
            case _ if self.moves(call):
                raise NotPolynomial("a function of what moves")
            case _:
                tie = Compare("=", self._named("constant", call), call)
                self.ties.append(disjunction([*map(negated, domains(call)), tie]))
        return self.known[call]

    def _named(self, kind: str, term: Term) -> Symbol:
        self.known[term] = self.names.fresh(kind)
        return self.known[term]

    def derivative(self, term: Term) -> Term:
        """The Lie derivative of a polynomial term. Raises `NotPolynomial`, `TooLarge`."""
        ring = self.ring(term)
        p = ring.polynomial(term)
        result: Term = ZERO
        for symbol, rate in self.rates.items():
            if symbol in ring.generators:
                part = p.derivative(ring.symbols.index(symbol))
                if not part.is_zero():
                    result = (
                        Add(result, Mul(ring.term(part), rate))
                        if result != ZERO
                        else Mul(ring.term(part), rate)
                    )
        return result

    def ring(self, *parts: Term | Formula, ordering: str = "degrevlex") -> Ring:
        """Polynomials in all symbols of the field and of these terms, what moves first."""
        others = symbols(*parts, *self.rates.values()) - self.rates.keys()
        return Ring((*self.rates, *sorted(others, key=lambda s: s.name)), ordering)

    def flow(self, ring: Ring) -> dict[Symbol, Polynomial]:
        """The rates as polynomials. Raises `NotPolynomial`, `TooLarge`."""
        return {s: ring.polynomial(rate) for s, rate in self.rates.items()}

    def formula(self, formula: Formula) -> Formula:
        """The formula over polynomials, without abs, min and max. Raises `NotPolynomial`."""

        def atom(a: Compare) -> Formula:
            if (split := first_case(a)) is not None:
                return self.formula(split)
            return Compare(a.op, self.plain(Sub(a.left, a.right)), ZERO, span=a.span)

        return rewritten(formula, atom)

    def at(self, formula: Formula, values: Mapping[Symbol, Term]) -> Formula:
        """A formula with values for the symbols that move."""
        return rewritten(
            formula,
            lambda a: Compare(
                a.op, substituted(a.left, dict(values)), substituted(a.right, dict(values)), span=a.span
            ),
        )

    def spelled(self, term: Term) -> Term:
        """A polynomial term with what the new symbols stand for."""
        meaning: dict[Symbol, Term] = {symbol: t for t, symbol in self.known.items()}
        while symbols(term) & meaning.keys():
            term = substituted(term, meaning)
        return term
