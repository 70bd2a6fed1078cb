"""Conditions in interval arithmetic, as C without switches of the rounding mode.

Every operation widens its result by more than the rounding error of one operation to nearest, and by
the smallest normal number, which covers results that are denormal or flushed to zero (after Rump,
Zimmermann, Boldo, Melquiond: "Computing predecessor and successor in rounding to nearest", 2009). So a
contraction to fused operations does no harm. An interval with `lo > hi` says nothing: an operand is
undefined, or a number too large or a divisor too small. Truth is 0, 1 (not decided) or 2.
"""

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from typing import assert_never

from dl2c.diagnostics import CompileError, error
from dl2c.interval.arithmetic import enclosure
from dl2c.ir.model import (
    Add,
    And,
    Call,
    Compare,
    Comparison,
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
from dl2c.source import Span

COMPARISONS: dict[Comparison, str] = {
    "<": "is_less",
    "<=": "is_at_most",
    "=": "is_equal",
    "!=": "is_unequal",
    ">": "is_less",
    ">=": "is_at_most",
}

PAIR = """\
typedef struct {
  real lo, hi;
} iv_pair;
"""

OPERATIONS = {
    "iv_between": """\
static inline iv_pair iv_between(real lo, real hi)
{
  const iv_pair pair = {lo, hi};
  return pair;
}
""",
    "iv_smaller": """\
static inline real iv_smaller(real a, real b) { return a < b ? a : b; }
""",
    "iv_larger": """\
static inline real iv_larger(real a, real b) { return a > b ? a : b; }
""",
    "is_known": """\
static inline bool is_known(iv_pair a) { return a.lo <= a.hi; }
""",
    "iv_widened": """\
/* Room for the rounding error of one operation; nothing known where numbers are too large. */
static inline iv_pair iv_widened(real lo, real hi)
{
  const real down = lo - (iv_larger(lo, -lo) * IV_EPSILON + IV_SMALLEST);
  const real up = hi + (iv_larger(hi, -hi) * IV_EPSILON + IV_SMALLEST);
  const iv_pair nothing = {1, 0}, found = {down, up};
  return -IV_LARGEST <= down && up <= IV_LARGEST ? found : nothing;
}
""",
    "iv_point": """\
static inline iv_pair iv_point(real a) { return iv_between(a, a); }
""",
    "iv_negative": """\
static inline iv_pair iv_negative(iv_pair a) { return iv_between(-a.hi, -a.lo); }
""",
    "iv_sum": """\
static inline iv_pair iv_sum(iv_pair a, iv_pair b)
{
  return is_known(a) && is_known(b) ? iv_widened(a.lo + b.lo, a.hi + b.hi) : iv_between(1, 0);
}
""",
    "iv_difference": """\
static inline iv_pair iv_difference(iv_pair a, iv_pair b)
{
  return is_known(a) && is_known(b) ? iv_widened(a.lo - b.hi, a.hi - b.lo) : iv_between(1, 0);
}
""",
    "iv_around": """\
static inline iv_pair iv_around(real p, real q, real r, real s)
{
  const real lo = iv_smaller(iv_smaller(p, q), iv_smaller(r, s));
  return iv_widened(lo, iv_larger(iv_larger(p, q), iv_larger(r, s)));
}
""",
    "iv_product": """\
static inline iv_pair iv_product(iv_pair a, iv_pair b)
{
  const real p = a.lo * b.lo, q = a.lo * b.hi, r = a.hi * b.lo, s = a.hi * b.hi;
  if (!(is_known(a) && is_known(b)))
    return iv_between(1, 0);
  return iv_around(p, q, r, s);
}
""",
    "iv_quotient": """\
static inline iv_pair iv_quotient(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && (b.lo >= IV_TINY || b.hi <= -IV_TINY) && b.lo <= b.hi))
    return iv_between(1, 0);
  const real p = a.lo / b.lo, q = a.lo / b.hi, r = a.hi / b.lo, s = a.hi / b.hi;
  return iv_around(p, q, r, s);
}
""",
    "iv_magnitude": """\
static inline iv_pair iv_magnitude(iv_pair a)
{
  if (!is_known(a))
    return a;
  return iv_between(iv_larger(0, iv_larger(a.lo, -a.hi)), iv_larger(a.hi, -a.lo));
}
""",
    "iv_square": """\
static inline iv_pair iv_square(iv_pair a)
{
  const iv_pair m = iv_magnitude(a);
  if (!is_known(a))
    return a;
  const iv_pair found = iv_widened(m.lo * m.lo, m.hi * m.hi);
  return is_known(found) ? iv_between(iv_larger(0, found.lo), found.hi) : found;
}
""",
    "iv_root": """\
static inline iv_pair iv_root(iv_pair a)
{
  if (!(is_known(a) && a.lo >= 0))
    return iv_between(1, 0);
  const iv_pair found = iv_widened(IV_SQRT(a.lo), IV_SQRT(a.hi));
  return iv_between(iv_larger(0, found.lo), found.hi);
}
""",
    "iv_least": """\
static inline iv_pair iv_least(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return iv_between(1, 0);
  return iv_between(iv_smaller(a.lo, b.lo), iv_smaller(a.hi, b.hi));
}
""",
    "iv_greatest": """\
static inline iv_pair iv_greatest(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return iv_between(1, 0);
  return iv_between(iv_larger(a.lo, b.lo), iv_larger(a.hi, b.hi));
}
""",
    "is_less": """\
static inline int is_less(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return IV_UNKNOWN;
  return a.hi < b.lo ? IV_TRUE : a.lo >= b.hi ? IV_FALSE : IV_UNKNOWN;
}
""",
    "is_at_most": """\
static inline int is_at_most(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return IV_UNKNOWN;
  return a.hi <= b.lo ? IV_TRUE : a.lo > b.hi ? IV_FALSE : IV_UNKNOWN;
}
""",
    "is_unequal": """\
static inline int is_unequal(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return IV_UNKNOWN;
  if (a.hi < b.lo || b.hi < a.lo)
    return IV_TRUE;
  return a.hi <= b.lo && b.hi <= a.lo ? IV_FALSE : IV_UNKNOWN;
}
""",
    "is_equal": """\
static inline int is_equal(iv_pair a, iv_pair b) { return IV_TRUE - is_unequal(a, b); }
""",
    "iv_both": """\
static inline int iv_both(int a, int b) { return a < b ? a : b; }
""",
    "iv_either": """\
static inline int iv_either(int a, int b) { return a > b ? a : b; }
""",
}
"""Definitions by name, each after those that it uses."""


def prelude(body: str) -> str:
    """What code of intervals needs before it."""
    needed: list[str] = []
    for name, text in reversed(OPERATIONS.items()):
        if any(re.search(rf"\b{name}\(", user) for user in (body, *needed)):
            needed.append(text)
    return "\n".join([PAIR, *reversed(needed)])


@dataclass(slots=True)
class Statements:
    """Code that computes terms once each, over parameters named by `name`. `span` is where mistakes are."""

    name: Callable[[Symbol], str]
    single: bool
    span: Span
    lines: list[str] = field(default_factory=list[str])
    known: dict[Term, str] = field(default_factory=dict[Term, str])

    def condition(self, formula: Formula) -> str:
        """An expression of the formula's truth. Raises `CompileError`."""
        match formula:
            case Truth(value):
                return "IV_TRUE" if value else "IV_FALSE"
            case Compare(op, left, right):
                a, b = self.term(left), self.term(right)
                first, second = (b, a) if op in (">", ">=") else (a, b)
                return f"{COMPARISONS[op]}({first}, {second})"
            case And(children) | Or(children):
                joined = "iv_both" if isinstance(formula, And) else "iv_either"
                text = self.condition(children[0])
                for child in children[1:]:
                    text = f"{joined}({text}, {self.condition(child)})"
                return text
            case _:
                assert_never(formula)

    def term(self, term: Term) -> str:
        """The name of an interval that encloses the term's value. Raises `CompileError`."""
        if term not in self.known:
            text = self._operation(term)
            self.known[term] = f"t_v{len(self.known)}"
            self.lines.append(f"const iv_pair {self.known[term]} = {text};")
        return self.known[term]

    def _operation(self, term: Term) -> str:
        match term:
            case Number(value):
                return enclosing(value, self.single)
            case Symbol():
                return f"iv_point({self.name(term)})"
            case Neg(child):
                return f"iv_negative({self.term(child)})"
            case Add(left, right):
                return f"iv_sum({self.term(left)}, {self.term(right)})"
            case Sub(left, right):
                return f"iv_difference({self.term(left)}, {self.term(right)})"
            case Mul(left, right) if left == right:
                return f"iv_square({self.term(left)})"
            case Mul(left, right):
                return f"iv_product({self.term(left)}, {self.term(right)})"
            case Div(left, right):
                return f"iv_quotient({self.term(left)}, {self.term(right)})"
            case Pow(base, 1):
                return self.term(base)
            case Pow(base, exponent) if exponent % 2:
                return f"iv_product({self.term(base)}, {self.term(Pow(base, exponent - 1))})"
            case Pow(base, exponent):
                return f"iv_square({self.term(Pow(base, exponent // 2))})"
            case Call("abs", (arg,)):
                return f"iv_magnitude({self.term(arg)})"
            case Call("sqrt", (arg,)):
                return f"iv_root({self.term(arg)})"
            case Call("min", (left, right)):
                return f"iv_least({self.term(left)}, {self.term(right)})"
            case Call("max", (left, right)):
                return f"iv_greatest({self.term(left)}, {self.term(right)})"
            case Call(function):
                title = f"the sound monitor has no enclosure of `{function}`"
                advice = "leave out --sound, or choose other checks with --kind"
                raise CompileError(error("no-enclosure", title, self.span, "in this condition", advice))
            case _:
                assert_never(term)


def enclosing(value: Fraction, single: bool) -> str:
    """An interval around an exact number, a point where it is a number of the machine."""
    low, high = _singles(value) if single else (enclosure(value).low, enclosure(value).high)
    suffix = "f" if single else ""
    if low == high:
        return f"iv_point({low!r}{suffix})"
    return f"iv_between({low!r}{suffix}, {high!r}{suffix})"


def _singles(value: Fraction) -> tuple[float, float]:
    """The nearest floats below and above."""
    (nearest,) = struct.unpack("f", struct.pack("f", float(value)))
    if Fraction(nearest) == value:
        return nearest, nearest
    (bits,) = struct.unpack("i", struct.pack("f", nearest))
    away, towards = (struct.unpack("f", struct.pack("i", bits + k))[0] for k in (1, -1))
    around = sorted((nearest, away, towards))
    return (around[0], around[1]) if value < Fraction(nearest) else (around[1], around[2])
