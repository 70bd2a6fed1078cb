"""Formulas as Python functions of doubles that are exact, and fast enough for millions of states.

A term becomes a numerator and a positive denominator, both whole numbers, never reduced: the greatest
common divisors are what makes `Fraction` slow.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, assert_never

from dl2c.ir.logic import conjunction, disjunction
from dl2c.ir.model import (
    Add,
    And,
    Call,
    Compare,
    Div,
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
from dl2c.monitor.check import Check, after

Row = Sequence[float]
Pairs = Sequence[tuple[int, int]]
NOTHING: Mapping[Symbol, Term] = {}

OPERATORS = {"=": "==", "<": "<", "<=": "<=", ">": ">", ">=": ">=", "!=": "!="}


class Irrational(Exception):
    """A function whose values no whole numbers give."""


@dataclass(slots=True)
class _Lines:
    """The function of one atom, statement by statement."""

    numbers: Mapping[Symbol, int]
    fixed: Mapping[Symbol, Term]
    lines: list[str] = field(default_factory=list[str])
    known: dict[Term, str] = field(default_factory=dict[Term, str])

    def term(self, term: Term) -> str:
        """The name k of a term: its numerator is nk, its denominator dk."""
        if term in self.fixed:
            return self.term(self.fixed[term])  # type: ignore[index]
        if term not in self.known:
            text = self._pair(term)
            name = str(len(self.known))
            self.known[term] = name
            self.lines.append(f"n{name}, d{name} = {text}")
            if isinstance(term, Div):
                self.lines.append(f"if d{name} == 0: return False")
                self.lines.append(f"if d{name} < 0: n{name}, d{name} = -n{name}, -d{name}")
        return self.known[term]

    def _pair(self, term: Term) -> str:
        match term:
            case Number(value):
                return f"{value.numerator}, {value.denominator}"
            case Symbol():
                return f"row[{self.numbers[term]}]"
            case Neg(child):
                a = self.term(child)
                return f"-n{a}, d{a}"
            case Add(left, right) | Sub(left, right):
                a, b = self.term(left), self.term(right)
                sign = "+" if isinstance(term, Add) else "-"
                return f"n{a} * d{b} {sign} n{b} * d{a}, d{a} * d{b}"
            case Mul(left, right):
                a, b = self.term(left), self.term(right)
                return f"n{a} * n{b}, d{a} * d{b}"
            case Div(left, right):
                a, b = self.term(left), self.term(right)
                return f"n{a} * d{b}, d{a} * n{b}"
            case Pow(base, exponent):
                a = self.term(base)
                return f"n{a}**{exponent}, d{a}**{exponent}"
            case Call("abs", (arg,)):
                a = self.term(arg)
                return f"abs(n{a}), d{a}"
            case Call("min" | "max", (left, right)):
                a, b = self.term(left), self.term(right)
                order = "<" if term.function == "min" else ">"
                return f"(n{a}, d{a}) if n{a} * d{b} {order} n{b} * d{a} else (n{b}, d{b})"
            case Call(function):
                raise Irrational(function)
            case _:
                assert_never(term)


def exact_check(model: Model, check: Check) -> Callable[[Row], bool]:
    """Whether a row satisfies a check over the reals: the states and the parameters one after another, each
    in the order of the model. Raises `Irrational`.
    """
    given = [Symbol(v.name, "variable") for v in model.variables]
    given += [after(v.name) for v in model.variables] if check.transition else []
    given += [Symbol(c.name, "constant") for c in model.constants if c.value is None]
    fixed = {Symbol(c.name, "constant"): Number(c.value) for c in model.constants if c.value is not None}
    cases = (conjunction(c.formula for c in case.conditions) for case in check.cases)
    whole = exact_formula(disjunction(cases), given, fixed)

    def holds(row: Row) -> bool:
        return whole([value.as_integer_ratio() for value in row])

    return holds


def exact_formula(
    formula: Formula, given: Sequence[Symbol], fixed: Mapping[Symbol, Term] = NOTHING
) -> Callable[[Pairs], bool]:
    """Whether a formula holds of values of the symbols `given`, numerator and denominator each."""
    numbers = {symbol: k for k, symbol in enumerate(given)}
    atoms: dict[Formula, str] = {}
    texts: list[str] = []

    def called(formula: Formula) -> str:
        match formula:
            case Truth(value):
                return str(value)
            case And(children):
                return "(" + " and ".join(map(called, children)) + ")"
            case Or(children):
                return "(" + " or ".join(map(called, children)) + ")"
            case Compare(op, left, right):
                if formula not in atoms:
                    lines = _Lines(numbers, fixed)
                    a, b = lines.term(left), lines.term(right)
                    atoms[formula] = f"atom{len(atoms)}(row)"
                    result = f"return n{a} * d{b} {OPERATORS[op]} n{b} * d{a}"
                    body = "\n    ".join([*lines.lines, result])
                    texts.append(f"def {atoms[formula]}:\n    {body}\n")
                return atoms[formula]
            case _:
                assert_never(formula)

    whole = called(formula)
    made: dict[str, Any] = {}
    exec("\n".join([*texts, f"def whole(row): return {whole}"]), made)
    return made["whole"]


def exact_term(term: Term, given: Sequence[Symbol]) -> Callable[[Pairs], tuple[int, int] | bool]:
    """Numerator and denominator of a term; False where it has no value."""
    lines = _Lines({symbol: k for k, symbol in enumerate(given)}, NOTHING)
    name = lines.term(term)
    body = "\n    ".join([*lines.lines, f"return n{name}, d{name}"])
    made: dict[str, Any] = {}
    exec(f"def value(row):\n    {body}\n", made)
    return made["value"]
