"""Whether doubles are an initial state, decided with fractions: it shares no code with the sampler.

Terms are enclosed between fractions, exactly but for square roots, which are enclosed to 200 bits; so a
verdict is "yes", "no", or "unknown". Where equalities were solved, the doubles are only close to a real
solution: its defined names are enclosed first, from the drawn ones, and an equality counts as solved
where the difference of its sides is enclosed around 0 within 2**-120 of their size.
"""

from fractions import Fraction
from itertools import product
from math import isqrt

from dl2c.ir.model import (
    Add,
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
    Sub,
    Symbol,
    Term,
    Truth,
)
from dl2c.sampling.equalities.root_of import RootOf

BITS = 200
SOLVED = Fraction(1, 2**120)

Range = tuple[Fraction, Fraction]
Bounds = dict[Symbol, tuple[Fraction | None, Fraction | None]]


def enclosed(t: Term, state: dict[Symbol, Range]) -> Range | None:
    """Where the value lies; None where it is or may be undefined."""
    match t:
        case Number(value):
            return value, value
        case Symbol():
            return state[t]
        case Pow(base, n):
            inner = enclosed(base, state)
            return None if inner is None else _power(inner, n)
        case Neg(child):
            inner = enclosed(child, state)
            return None if inner is None else (-inner[1], -inner[0])
        case Call(name, args):
            parts = [enclosed(a, state) for a in args]
            return None if None in parts else _called(name, parts)
    a, b = enclosed(t.left, state), enclosed(t.right, state)
    if a is None or b is None:
        return None
    match t:
        case Add():
            return a[0] + b[0], a[1] + b[1]
        case Sub():
            return a[0] - b[1], a[1] - b[0]
        case Mul():
            return _around(x * y for x in a for y in b)
        case Div():
            return None if b[0] <= 0 <= b[1] else _around(x / y for x in a for y in b)
    raise AssertionError(t)


def _around(values) -> Range:
    found = list(values)
    return min(found), max(found)


def _power(a: Range, n: int) -> Range:
    low, high = _around(x**n for x in a)
    return (Fraction(0), high) if n % 2 == 0 and a[0] < 0 < a[1] else (low, high)


def _called(name: str, parts: list[Range]) -> Range | None:
    match name, parts:
        case "min", [a, b]:
            return min(a[0], b[0]), min(a[1], b[1])
        case "max", [a, b]:
            return max(a[0], b[0]), max(a[1], b[1])
        case "abs", [(low, high)]:
            return (Fraction(0), max(-low, high)) if low < 0 < high else _around((abs(low), abs(high)))
        case "sqrt", [(low, high)]:
            return None if low < 0 else (_root(low)[0], _root(high)[1])
    raise AssertionError(name)


def _root(value: Fraction) -> Range:
    """Two fractions around the root, equal where it is rational."""
    above, below = isqrt(value.numerator), isqrt(value.denominator)
    if above**2 == value.numerator and below**2 == value.denominator:
        return Fraction(above, below), Fraction(above, below)
    scale = 1 << (BITS + max(0, value.denominator.bit_length() - value.numerator.bit_length()))
    floor = isqrt(value.numerator * scale**2 // value.denominator)
    return Fraction(floor, scale), Fraction(floor + 1, scale)


def verdict(f: Formula, state: dict[Symbol, Range]) -> str:
    """ "yes", "no" or "unknown"."""
    match f:
        case Truth(value):
            return "yes" if value else "no"
        case And(children):
            found = [verdict(c, state) for c in children]
            return "no" if "no" in found else "unknown" if "unknown" in found else "yes"
        case Or(children):
            found = [verdict(c, state) for c in children]
            return "yes" if "yes" in found else "unknown" if "unknown" in found else "no"
        case Compare(op, left, right):
            a, b = enclosed(left, state), enclosed(right, state)
            return "unknown" if a is None or b is None else _compared(op, a, b)
    raise AssertionError(f)


def _compared(op: str, a: Range, b: Range) -> str:
    low, high = a[0] - b[1], a[1] - b[0]
    size = max(1, abs(a[0]), abs(b[0]))
    solved = low < high and low <= 0 <= high and high - low <= SOLVED * size
    always, never = {
        "=": (low == high == 0 or solved, low > 0 or high < 0),
        "!=": (low > 0 or high < 0, low == high == 0),
        "<": (high < 0, low >= 0),
        "<=": (high <= 0, low > 0),
        ">": (low > 0, high <= 0),
        ">=": (low >= 0, high < 0),
    }[op]
    return "yes" if always else "no" if never else "unknown"


def audited(f: Formula, bounds: Bounds, state: dict[Symbol, Fraction]) -> str:
    """Whether the doubles themselves satisfy the formula and the bounds."""
    return _inside(f, bounds, {s: (v, v) for s, v in state.items()})


def audited_witness(
    f: Formula,
    bounds: Bounds,
    state: dict[Symbol, Fraction],
    definitions: list[tuple[Symbol, Term]],
    error: float,
) -> str:
    """Whether a real solution does, with the same drawn names and the others off by at most `error`."""
    ranges = {s: (v, v) for s, v in state.items()}
    for symbol, term in definitions:
        is_root = isinstance(term, RootOf)
        exact = _rooted(term, state[symbol], error, ranges) if is_root else enclosed(term, ranges)
        if exact is None:
            return "unknown"
        if max(exact[1] - state[symbol], state[symbol] - exact[0]) > Fraction(error):
            return "no"
        ranges[symbol] = exact
    return _inside(f, bounds, ranges)


def _rooted(root: RootOf, value: Fraction, error: float, state: dict[Symbol, Range]) -> Range | None:
    """A root of the polynomial within the error of the value, bisected; None where no sign changes there."""
    row = [enclosed(c, state) for c in root.coefficients]

    def sign(at: Fraction) -> int | None:
        ends = [sorted((c[0] * at**k, c[1] * at**k)) for k, c in enumerate(row) if c is not None]
        low, high = sum(e[0] for e in ends), sum(e[1] for e in ends)
        return 1 if low > 0 else -1 if high < 0 else 0 if low == high else None

    low, high = value - Fraction(error), value + Fraction(error)
    first, last = sign(low), sign(high)
    if None in row or None in (first, last) or first * last > 0:
        return None
    for _ in range(BITS):
        middle = (low + high) / 2
        here = sign(middle)
        if not here:
            return None if here is None else (middle, middle)
        low, high = (middle, high) if here == first else (low, middle)
    return low, high


def definitions_of(plan):
    """The definitions of all combinations of one chart of each block."""
    chosen = product(*([c.definitions for c in block.charts] for block in plan.blocks))
    return [[d for definitions in parts for d in definitions] for parts in chosen]


def _inside(f: Formula, bounds: Bounds, ranges: dict[Symbol, Range]) -> str:
    found = [verdict(f, ranges)]
    for symbol, (low, high) in bounds.items():
        value = ranges[symbol]
        found += [] if low is None else [_compared(">=", value, (low, low))]
        found += [] if high is None else [_compared("<=", value, (high, high))]
    return "no" if "no" in found else "unknown" if "unknown" in found else "yes"
