"""Formulas of real arithmetic as SMT-LIB text.

In: formulas whose terms are sums, products and powers of symbols and rational numbers. Out: the lines of
a script that asks whether all of them can hold at once.
"""

from collections.abc import Sequence
from fractions import Fraction
from typing import assert_never

from dl2c.ir.logic import fold, symbols
from dl2c.ir.model import Add, Call, Compare, Div, Formula, Mul, Neg, Number, Pow, Sub, Symbol, Term


def script(hypotheses: Sequence[Formula], goal: Formula) -> tuple[str, list[str]]:
    """The script that asks for a state of all hypotheses in which the goal does not hold; its names."""
    names = sorted({s.name for s in symbols(*hypotheses, goal)})
    lines = ["(set-logic QF_NRA)"]
    lines += [f"(declare-fun {_name(n)} () Real)" for n in names]
    lines += [f"(assert {_formula(h)})" for h in hypotheses]
    lines.append(f"(assert (not {_formula(goal)}))")
    return "\n".join(lines) + "\n", names


def _name(name: str) -> str:
    return f"|{name}|"


def _formula(formula: Formula) -> str:
    def joined(word: str, parts: list[str]) -> str:
        return f"({word} {' '.join(parts)})"

    return fold(
        formula,
        lambda value: "true" if value else "false",
        _atom,
        lambda parts: joined("and", list(parts)),
        lambda parts: joined("or", list(parts)),
    )


def _atom(atom: Compare) -> str:
    left, right = _term(atom.left), _term(atom.right)
    return f"(not (= {left} {right}))" if atom.op == "!=" else f"({atom.op} {left} {right})"


def _term(term: Term) -> str:
    match term:
        case Number(value):
            return _number(value)
        case Symbol(name):
            return _name(name)
        case Neg(child):
            return f"(- {_term(child)})"
        case Add(left, right):
            return f"(+ {_term(left)} {_term(right)})"
        case Sub(left, right):
            return f"(- {_term(left)} {_term(right)})"
        case Mul(left, right):
            return f"(* {_term(left)} {_term(right)})"
        case Pow(base, exponent):
            return f"(* {' '.join([_term(base)] * exponent)})" if exponent > 1 else _term(base)
        case Div() | Call():
            raise AssertionError("`verify.total` leaves none of these")
        case _:
            assert_never(term)


def _number(value: Fraction) -> str:
    size = f"{abs(value.numerator)}.0"
    if value.denominator != 1:
        size = f"(/ {size} {value.denominator}.0)"
    return f"(- {size})" if value < 0 else size
