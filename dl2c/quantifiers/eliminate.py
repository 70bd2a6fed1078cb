"""Quantifiers over the reals replaced by equivalent conditions.

Comes in: a formula in negation normal form, in which an undefined atom is false, and a symbol that
a quantifier binds. Goes out: an equivalent formula without the symbol, in the same sense: `exists`
holds where some value makes the formula true, `forall` where every value does. Atoms are at most
quadratic in the symbol once divisors, `abs`, `min`, `max` and products are resolved into cases;
others are refused with their place.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import (
    atoms,
    conjunction,
    difference,
    disjunction,
    mapped,
    negation,
    operands,
    rewritten,
    sides,
    substituted,
    symbols,
    with_operands,
)
from dl2c.ir.margins import TooManyCases, smooth
from dl2c.ir.model import (
    FALSE,
    ONE,
    TRUE,
    ZERO,
    And,
    Call,
    Compare,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Symbol,
    Term,
)
from dl2c.ir.normal import Normal, divided, normal_form, powers
from dl2c.quantifiers.signs import SIGNS, Signs, TooLarge, sign_in
from dl2c.quantifiers.virtual import exists
from dl2c.source import NOWHERE, Span

MAX_MONOMIALS = 200
"""Of the polynomial of one atom."""

TOO_MANY_MONOMIALS = f"polynomials of more than {MAX_MONOMIALS} monomials"


class DegreeTooHigh(Exception):
    """The bound symbol occurs with this power."""

    def __init__(self, degree: int) -> None:
        super().__init__(degree)
        self.degree = degree


@dataclass(frozen=True, slots=True)
class Quantifier:
    """`name` is what the user calls the symbol `bound`; `nested` where the text has quantifiers inside."""

    everything: bool
    name: str
    bound: Symbol
    nested: bool
    span: Span


def eliminated(quantifier: Quantifier, body: Formula) -> Formula:
    """The quantified formula without quantifier. Raises `CompileError` with every atom that prevents it."""
    if found := [d for a in atoms(body) if (d := _refused(a, quantifier)) is not None]:
        raise CompileError(found)
    try:
        return _pushed(quantifier, body)
    except (TooLarge, TooManyCases) as bound:
        raise CompileError(_too_large(quantifier, bound)) from None


def _pushed(quantifier: Quantifier, body: Formula) -> Formula:
    """The quantifier only where its symbol is."""
    x = quantifier.bound
    if x not in symbols(body):
        return body
    match body:
        case And(children) | Or(children):
            rejoin = conjunction if isinstance(body, And) else disjunction
            if isinstance(body, And) == quantifier.everything:
                return rejoin(_pushed(quantifier, c) for c in children)
            free = [c for c in children if x not in symbols(c)]
            if free:
                inner = rejoin(c for c in children if x in symbols(c))
                return rejoin([*free, _pushed(quantifier, inner)])
        case _:
            pass
    return _eliminated(quantifier, body)


def _eliminated(quantifier: Quantifier, body: Formula) -> Formula:
    preparation = _Preparation(quantifier.bound, quantifier.span)
    prepared = preparation.formula(body)
    if quantifier.everything:
        result = negation(exists(quantifier.bound, negation(prepared), preparation.defined))
    else:
        result = exists(quantifier.bound, prepared, preparation.defined)
    back: dict[Symbol, Term] = {symbol: term for term, symbol in preparation.names.items()}
    return mapped(result, lambda term: substituted(term, back))


@dataclass(frozen=True, slots=True)
class _Preparation:
    """Rewrites a formula into one over polynomials, at most quadratic in x, that is true where the formula
    is and false elsewhere, whatever undefined terms are taken to be.

    Conditions on x get the `span` of the quantified formula, of which what comes of them is a part.
    `names` are symbols that stand for terms without x that are not polynomials, `defined` says where these
    have values.
    """

    x: Symbol
    span: Span
    names: dict[Term, Symbol] = field(default_factory=dict[Term, Symbol])
    defined: dict[Symbol, Formula] = field(default_factory=dict[Symbol, Formula])

    def formula(self, formula: Formula) -> Formula:
        """Raises `DegreeTooHigh`, `TooLarge`, `TooManyCases`."""
        return rewritten(formula, self._atom)

    def _atom(self, atom: Compare) -> Formula:
        span = self.span if self.x in symbols(atom) else atom.span
        defined = conjunction(d for side in sides(atom) for d in self._defined(side, span))
        if defined == FALSE:
            return FALSE
        plain = Compare(atom.op, self._plain(atom.left), self._plain(atom.right), span=span)
        return conjunction([defined, self._signs(smooth(plain, self._moves))])

    def _moves(self, term: Term) -> bool:
        return self.x in symbols(term)

    def _plain(self, term: Term) -> Term:
        """The term with names for what is not a polynomial and has no x. Raises `TooLarge`."""
        match term:
            case Div(left, Number(value)) if value:
                return Div(self._plain(left), Number(value))
            case Div() | Call() if not self._moves(term):
                return self._named(term)
            case Div(left, right) if not self._moves(right):
                return Mul(self._plain(left), self._plain(Div(ONE, right)))
            case _:
                return with_operands(term, tuple(map(self._plain, operands(term))))

    def _named(self, term: Term) -> Symbol:
        if term not in self.names:
            symbol = self.names[term] = Symbol(f"term {len(self.names)}", "variable")
            self.defined[symbol] = conjunction(self._defined(term, NOWHERE))
        return self.names[term]

    def _defined(self, term: Term, span: Span) -> Iterator[Formula]:
        """When the parts of a term have values that are without x."""
        for operand in operands(term):
            yield from self._defined(operand, span)
        match term:
            case Div(_, divisor) if not self._moves(divisor):
                yield self._signs(Compare("!=", self._plain(divisor), ZERO, span=span))
            case Call("sqrt", (argument,)) if not self._moves(term):
                yield self._signs(Compare(">=", self._plain(argument), ZERO, span=span))
            case Call(function) if not FUNCTIONS[function].total and not self._moves(term):
                yield Compare("=", term, term, span=span)
            case _:
                pass

    def _signs(self, formula: Formula) -> Formula:
        """Every atom as a sign of a polynomial, of products of high degree the signs of their factors."""
        return rewritten(formula, self._sign)

    def _sign(self, atom: Compare) -> Formula:
        form = normal_form(difference(atom))
        if form is None or len(form) > MAX_MONOMIALS:
            raise TooLarge(TOO_MANY_MONOMIALS)
        if self._degree(form) <= 2:
            return sign_in(form, SIGNS[atom.op], atom.span)
        factors = [f for factor in _factors(difference(atom)) for f in self._without_powers(factor)]
        if (worst := max(map(self._degree, factors))) > 2:
            raise DegreeTooHigh(worst)
        return _product_sign(factors, SIGNS[atom.op], atom.span)

    def _degree(self, form: Normal) -> int:
        return max(powers(form, self.x), default=0)

    def _without_powers(self, form: Normal) -> Iterator[Normal]:
        """A power of x that divides a polynomial, as far as the sign goes, and the quotient."""
        x = self.x
        lowest = min(powers(form, x), default=0)
        if lowest and self._degree(form) > 2:
            yield {((x.kind, x.name, 2 - lowest % 2),): Fraction(1)}
            form = divided(form, (x.kind, x.name), lowest)
        yield form


def _factors(term: Term) -> Iterator[Normal]:
    """Polynomials whose product has the sign of a polynomial. Raises `TooLarge`."""
    match term:
        case Neg(child):
            yield {(): Fraction(-1)}
            yield from _factors(child)
        case Mul(left, right):
            yield from _factors(left)
            yield from _factors(right)
        case Pow(base, exponent):
            for _ in range(2 - exponent % 2):
                yield from _factors(base)
        case _:
            form = normal_form(term)
            if form is None:
                raise TooLarge(TOO_MANY_MONOMIALS)
            yield form


def _product_sign(factors: list[Normal], signs: Signs, span: Span) -> Formula:
    """That the sign of a product is one of `signs`."""
    first, *others = factors
    if not others:
        return sign_in(first, signs, span)
    cases: list[Formula] = []
    for sign in (-1, 0, 1):
        here = sign_in(first, frozenset({sign}), span)
        wanted = frozenset(s for s in (-1, 0, 1) if sign * s in signs)
        if here != FALSE and wanted:
            rest = TRUE if len(wanted) == 3 else _product_sign(others, wanted, span)
            cases.append(conjunction([here, rest]))
    return disjunction(cases)


# Refusals -----------------------------------------------------------------------


def _refused(atom: Compare, quantifier: Quantifier) -> Diagnostic | None:
    """What is wrong with an atom on its own."""
    x = quantifier.bound
    call = _transcendental(atom.left, x) or _transcendental(atom.right, x)
    if call is not None:
        label = f"`{quantifier.name}` stands inside `{call.function}` here"
        return _not_eliminated(quantifier, atom.span, label)
    try:
        _Preparation(x, quantifier.span).formula(atom)
    except DegreeTooHigh as high:
        return _degree(quantifier, atom.span, high.degree)
    except (TooLarge, TooManyCases) as bound:
        return _too_large(quantifier, bound)
    return None


def _transcendental(term: Term, x: Symbol) -> Call | None:
    """A function of x that has no polynomial cases."""
    match term:
        case Call(function) if function not in ("abs", "min", "max") and x in symbols(term):
            return term
        case _:
            return next((c for t in operands(term) if (c := _transcendental(t, x)) is not None), None)


def _degree(quantifier: Quantifier, span: Span, degree: int) -> Diagnostic:
    name = quantifier.name
    after = " once the quantifiers inside are eliminated" if quantifier.nested else " here"
    return _not_eliminated(quantifier, span, f"`{name}` has degree {degree}{after}; at most 2 can go")


def _too_large(quantifier: Quantifier, bound: TooLarge | TooManyCases) -> Diagnostic:
    label = f"the condition without it would be too large: {bound}"
    return _not_eliminated(quantifier, quantifier.span, label)


def _not_eliminated(quantifier: Quantifier, span: Span, label: str) -> Diagnostic:
    word = "forall" if quantifier.everything else "exists"
    return error(
        "quantifier",
        f"`\\{word} {quantifier.name}` cannot be eliminated",
        span,
        label,
        f"replace it by an equivalent condition without `{quantifier.name}`",
    )
