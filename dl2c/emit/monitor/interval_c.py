"""Conditions as C in the interval arithmetic of cgen/monitor, and how close to a boundary it is undecided."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from typing import assert_never

import numpy as np

from dl2c.code import cgen_dir
from dl2c.emit.cfile import wrapped
from dl2c.interval.arithmetic import enclosure
from dl2c.ir.functions import FUNCTIONS
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

COMPARISONS: dict[Comparison, str] = {
    "<": "is_less",
    "<=": "is_at_most",
    "=": "is_equal",
    "!=": "is_unequal",
    ">": "is_less",
    ">=": "is_at_most",
}

TABLES = {
    "iv_half_pi": "1.570796326794896619231321691639751442098584699687552910487472296153908203143104499314",
    "iv_log_2": "0.693147180559945309417232121458176568075500134360255254120680009493393621969694715605",
}
"""Constants, cut off after so many digits."""


@dataclass(frozen=True, slots=True)
class Precision:
    """The arithmetic of one type: its name in <float.h>, the suffix of its numbers and functions, binary
    digits of its numbers, of the whole numbers by which tables are multiplied, of short numbers and of
    their fractions, and the largest arguments of exp and of sine.
    """

    kind: str
    suffix: str
    digits: int
    multiples: int
    short: int
    fraction: int
    exp_most: int
    angle_most: int

    def literal(self, value: float) -> str:
        return f"{value!r}{self.suffix}"


DOUBLE = Precision("DBL", "", 53, 20, 26, 6, 700, 1_000_000)
SINGLE = Precision("FLT", "f", 24, 12, 12, 4, 80, 6_000)


def precision_of(single: bool) -> Precision:
    return SINGLE if single else DOUBLE


def prelude(body: str, single: bool, largest: Fraction) -> str:
    """What code of intervals needs before it: of cgen/monitor what it uses, and of its numbers."""
    needed: list[str] = []
    for name, text in reversed(_blocks()):
        if any(_uses(user, name) for user in (body, *needed)):
            needed.append(text)
    code = "\n".join(reversed(needed))
    precision = precision_of(single)
    numbers = [f"#define {n} {v}" for n, v in _numbers(precision, largest).items() if _uses(code, n)]
    tables = [_table(name, value, precision) for name, value in TABLES.items() if _uses(code, name)]
    return "\n".join([*numbers, "", *tables, code])


def _uses(text: str, name: str) -> bool:
    return re.search(rf"\b{name}\b", text) is not None


@cache
def _blocks() -> tuple[tuple[str, str], ...]:
    """The definitions of cgen/monitor in order, each with the name that it defines."""
    folder = cgen_dir() / "monitor"
    text = "\n".join((folder / name).read_text(encoding="utf-8") for name in ("intervals.h", "functions.h"))
    blocks: list[tuple[str, str]] = []
    for block in text.split("\n\n"):
        if found := re.search(r"^(?:static inline \w+|\}|enum \{) (\w+)", block, re.MULTILINE):
            blocks.append((found[1], block.strip("\n") + "\n"))
    return tuple(blocks)


def _numbers(precision: Precision, largest: Fraction) -> dict[str, str]:
    kind, suffix = precision.kind, precision.suffix
    return {
        "IV_EPSILON": f"{kind}_EPSILON",
        "IV_SMALLEST": f"{kind}_MIN",
        "IV_LARGEST": f"{kind}_MAX",
        "IV_TINY": precision.literal(float(1 / largest)),
        "IV_SHORT": precision.literal(2.0**precision.short),
        "IV_SHORT_SCALE": precision.literal(2.0**precision.fraction),
        "IV_EXP_MOST": str(precision.exp_most),
        "IV_ANGLE_MOST": str(precision.angle_most),
        "IV_SQRT": f"sqrt{suffix}",
        "IV_LDEXP": f"ldexp{suffix}",
        "IV_FREXP": f"frexp{suffix}",
    }


def _table(name: str, decimal: str, precision: Precision) -> str:
    """Two parts whose products with whole numbers are exact, and what encloses the rest."""
    rest = Fraction(decimal)
    parts: list[float] = []
    for _ in range(2):
        scale = Fraction(2) ** (precision.digits - precision.multiples - _exponent(rest))
        parts.append(float(Fraction(int(rest * scale), 1) / scale))
        rest -= Fraction(parts[-1])
    after = rest + Fraction(1, 10 ** (len(decimal) - 2))
    ends = [_ends(value, precision is SINGLE) for value in (rest, after)]
    listed = ", ".join(precision.literal(v) for v in (*parts, ends[0][0], ends[1][1]))
    return "\n".join([*wrapped(f"static const real {name}[4] = {{{listed}}};"), ""])


def _exponent(value: Fraction) -> int:
    """The e for which value < 2^e <= 2 value."""
    return math.frexp(float(value))[1]


@dataclass(slots=True)
class Statements:
    """Code that computes terms once each, over parameters named by `name`."""

    name: Callable[[Symbol], str]
    single: bool
    lines: list[str] = field(default_factory=list[str])
    known: dict[Term, str] = field(default_factory=dict[Term, str])

    def condition(self, formula: Formula) -> str:
        """An expression of the formula's truth."""
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
        """The name of an interval that encloses the term's value."""
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
            case Call(function, args):
                return f"{FUNCTIONS[function].enclosure}({', '.join(map(self.term, args))})"
            case _:
                assert_never(term)


def enclosing(value: Fraction, single: bool) -> str:
    """An interval around an exact number, a point where it is a number of the machine."""
    low, high = _ends(value, single)
    literal = precision_of(single).literal
    if math.isinf(low) or math.isinf(high):
        return "iv_unknown()"
    return f"iv_point({literal(low)})" if low == high else f"iv_between({literal(low)}, {literal(high)})"


def is_number_of_machine(value: Fraction, single: bool) -> bool:
    """Whether it needs no rounding."""
    low, high = _ends(value, single)
    return low == high


def _ends(value: Fraction, single: bool) -> tuple[float, float]:
    """The nearest numbers of the machine below and above."""
    around = enclosure(value)
    if not single:
        return around.low, around.high
    with np.errstate(over="ignore"):
        low, high = np.float32(around.low), np.float32(around.high)
    low = np.nextafter(low, np.float32(-np.inf)) if float(low) > around.low else low
    high = np.nextafter(high, np.float32(np.inf)) if float(high) < around.high else high
    return float(low), float(high)
