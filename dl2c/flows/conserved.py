"""What flows conserve: terms whose Lie derivative is zero, or a multiple of the term, whatever the state.

Functions of a term, such as sqrt(x), count as further symbols with a derivative of their own, so that
what is decided is whether quotients of polynomials are zero. That is exact where it says yes; it says
no where terms are too long, and where two functions would have to be known to belong together.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction

from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import minus, number, operands, plus, raised, subterms, times, with_operands
from dl2c.ir.margins import fraction
from dl2c.ir.model import ONE, ZERO, Add, Call, Div, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.ir.normal import (
    MAX_TERMS,
    Monomial,
    Normal,
    added,
    multiplied,
    normal_form,
    powers,
    quotient,
    symbol_of,
)

LARGEST_ROOT = 12
"""Powers by a number are powers of a root of at most this degree, else not looked into."""


def is_invariant(term: Term, rates: Mapping[str, Term]) -> bool:
    """Whether the Lie derivative of the term along an ODE is identically zero (dL's rule dI)."""
    flow = _Derivation(rates)
    try:
        return flow.numerator(flow.derivative(flow.algebraic(term))) == {}
    except _Unknown:
        return False


def is_darboux(term: Term, rates: Mapping[str, Term], zeros: Sequence[Term] = ()) -> bool:
    """Whether the Lie derivative of the term along an ODE is the term times a factor that has a value
    wherever the ODE has one: where the term is zero it stays zero (dL's rule dbx). `zeros` are terms that
    are zero along the ODE, which may be used (a differential cut).

    Not found out for terms with roots of what moves, whose derivatives divide by the root.
    """
    flow = _Derivation(rates, roots=False)
    try:
        above, _ = fraction(flow.algebraic(term), _always)
        forms = [flow.numerator(flow.derivative(above)), flow.numerator(above)]
        zero = [flow.numerator(flow.algebraic(z)) for z in zeros]
    except _Unknown:
        return False
    for _ in zeros:
        found = next(filter(None, map(_solved, zero)), None)
        if found is None:
            break
        symbol, value = found
        forms, zero = ([_replaced(f, symbol, value) for f in part] for part in (forms, zero))
    return _is_multiple(*forms)


def _solved(form: Normal) -> tuple[Symbol, Normal] | None:
    """A name of the polynomial and the value for which it is zero, where that is a polynomial."""
    for monomial, factor in form.items():
        if len(monomial) == 1 and monomial[0][2] == 1:
            (kind, name, _) = monomial[0]
            symbol = symbol_of(kind, name)
            rest = {m: c / -factor for m, c in form.items() if m != monomial}
            if all(0 in powers({m: c}, symbol) for m, c in rest.items()):
                return symbol, rest
    return None


def _replaced(form: Normal, symbol: Symbol, value: Normal) -> Normal:
    """The polynomial with a name replaced by its value; unchanged where the result would be too long."""
    total: Normal | None = {}
    power: Normal | None = {(): Fraction(1)}
    by_exponent = powers(form, symbol)
    for exponent in range(max(by_exponent, default=0) + 1):
        total = added(total, multiplied(power, by_exponent.get(exponent, {})))
        power = multiplied(power, value)
    return form if total is None else total


def _is_multiple(form: Normal, divisor: Normal) -> bool:
    """By division with the leading monomial in graded lexicographic order; False too where that is long."""
    names = sorted({(k, n) for m in (*form, *divisor) for k, n, _ in m})

    def place(monomial: Monomial) -> tuple[int, ...]:
        exponents = {(k, n): e for k, n, e in monomial}
        return sum(exponents.values()), *(exponents.get(name, 0) for name in names)

    if not divisor:
        return not form
    first = max(divisor, key=place)
    leading = {first: divisor[first]}
    rest: Normal | None = form
    for _ in range(MAX_TERMS):
        if not rest:
            return rest is not None
        highest = max(rest, key=place)
        factor = quotient(highest, -rest[highest], leading)
        if factor is None:
            return False
        rest = added(rest, multiplied(factor, divisor))
    return False


class _Unknown(Exception):
    """A term with a function that has no derivative here, or one that is too long."""


def _always(_: Term) -> bool:
    return True


class _Derivation:
    """Lie derivatives along an ODE of terms in which functions were replaced by symbols."""

    def __init__(self, rates: Mapping[str, Term], roots: bool = True) -> None:
        self._rates = rates
        self._roots = roots
        self._symbols: dict[Term, Symbol] = {}
        self._functions: dict[Symbol, Call] = {}

    def numerator(self, term: Term) -> Normal:
        form = normal_form(fraction(term, _always)[0])
        if form is None:
            raise _Unknown
        return form

    def algebraic(self, term: Term) -> Term:
        """The term with a symbol for each function, roots of one term being powers of one symbol."""
        match term:
            case Call("sqrt", (argument,)):
                return self._root(argument, Fraction(1, 2))
            case Call("pow", (argument, Number(exponent))):
                return self._root(argument, exponent)
            case _:
                parts = with_operands(term, tuple(map(self.algebraic, operands(term))))
                return self._symbol(parts) if isinstance(parts, Call) else parts

    def _root(self, argument: Term, exponent: Fraction) -> Term:
        if exponent == 0 or max(abs(exponent.numerator), exponent.denominator) > LARGEST_ROOT:
            raise _Unknown
        degree = Number(Fraction(1, exponent.denominator))
        base = self.algebraic(argument)
        root = base if degree == ONE else self._symbol(Call("pow", (base, degree)))
        power = Pow(root, abs(exponent.numerator))
        return power if exponent > 0 else Div(ONE, power)

    def _symbol(self, call: Call) -> Symbol:
        symbol = self._symbols.setdefault(call, Symbol(f"function{len(self._symbols)}", "start"))
        self._functions[symbol] = call
        return symbol

    def derivative(self, term: Term) -> Term:
        match term:
            case Number():
                return ZERO
            case Symbol(name, "variable"):
                return self.algebraic(self._rates.get(name, ZERO))
            case Symbol():
                return self._of_function(term) if term in self._functions else ZERO
            case Neg(child):
                return minus(ZERO, self.derivative(child))
            case Add(left, right):
                return plus(self.derivative(left), self.derivative(right))
            case Sub(left, right):
                return minus(self.derivative(left), self.derivative(right))
            case Mul(left, right):
                return plus(times(self.derivative(left), right), times(left, self.derivative(right)))
            case Div(left, right):
                slope = minus(self.derivative(left), times(term, self.derivative(right)))
                return ZERO if slope == ZERO else Div(slope, right)
            case Pow(base, exponent):
                return times(times(number(exponent), raised(base, exponent - 1)), self.derivative(base))
            case Call():
                raise AssertionError("functions are symbols here")

    def _of_function(self, symbol: Symbol) -> Term:
        """By the chain rule."""
        call = self._functions[symbol]
        inner = self.derivative(call.args[0])
        if inner == ZERO and all(self.derivative(a) == ZERO for a in call.args[1:]):
            return ZERO
        match call:
            case Call("pow", (_, Number(exponent))) if self._roots:
                slope = Div(Number(exponent), Pow(symbol, exponent.denominator - 1))
            case Call(function, (argument,)) if (derivative := FUNCTIONS[function].slope) is not None:
                slope = derivative(symbol, argument)
                if any(isinstance(t, Call) and t.function == "sqrt" for t in subterms(slope)):
                    raise _Unknown
                slope = self.algebraic(slope)
            case _:
                raise _Unknown
        return times(slope, inner)
