"""Terms and formulas as Python expressions, and long ones over several lines.

Symbols are named by a function of the caller. Operations keep the order of the tree, so results
are those of the IR in doubles, but for powers. What is undefined becomes NaN, for which every comparison
written here is false: `divide`, `least`, `greatest`, `sqrt` and the like are total functions that
the caller defines.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias, assert_never

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

WIDTH = 88
"""The line length of Python's formatters where nothing else is said."""

OPERATORS: dict[Comparison, str] = {"=": "==", "!=": "!=", "<": "<", "<=": "<=", ">": ">", ">=": ">="}

OR, AND, COMPARISON, SUM, PRODUCT, SIGN, POWER, ATOM = range(1, 9)
"""How strongly Python's operators bind."""


@dataclass(frozen=True, slots=True)
class Infix:
    """Parts joined by operators of one strength."""

    strength: int
    parts: "tuple[Expression, ...]"
    operators: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Bracketed:
    """`head(a, b)`; parentheses around one expression where the head is empty or a sign."""

    head: str
    parts: "tuple[Expression, ...]"
    brackets: str = "()"


@dataclass(frozen=True, slots=True)
class Named:
    """`name=value`, an argument, or `"name": value`, an entry: `name` is all up to the value."""

    name: str
    value: "Expression"


Expression: TypeAlias = str | Infix | Bracketed | Named


@dataclass(frozen=True, slots=True)
class Writer:
    """How symbols are named, and which divisors are surely not zero."""

    name: Callable[[Symbol], str]
    nonzero: Callable[[Term], bool] = lambda term: isinstance(term, Number) and term.value != 0

    def term(self, term: Term) -> Expression:
        """The value of a term."""
        match term:
            case Number(value):
                whole = value.denominator == 1 and abs(value) < 2**53
                return str(value.numerator) if whole else repr(float(value))
            case Symbol():
                return self.name(term)
            case Neg(Neg(child)):
                return self.term(child)
            case Neg(child):
                return self._signed(self.term(child))
            case Add(left, right):
                return self.binary(SUM, "+", left, right)
            case Sub(left, right):
                return self.binary(SUM, "-", left, right)
            case Mul(left, right):
                return self.binary(PRODUCT, "*", left, right)
            case Div(left, right) if self.nonzero(right):
                return self.binary(PRODUCT, "/", left, right)
            case Div(left, right):
                return Bracketed("divide", (self.term(left), self.term(right)))
            case Pow(base, exponent):
                return self._power(self.term(base), exponent)
            case Call(function, args):
                row, parts = FUNCTIONS[function], tuple(map(self.term, args))
                return (
                    Bracketed("value_of", (row.python, *parts))
                    if row.raises
                    else Bracketed(row.python, parts)
                )
            case _:
                assert_never(term)

    def formula(self, formula: Formula) -> Expression:
        """The truth of a formula."""
        match formula:
            case Truth(value):
                return str(value)
            case Compare("!=", left, right):
                less, more = (self.comparison(op, left, right) for op in ("<", ">"))
                return Infix(OR, (less, more), ("or",))
            case Compare(op, left, right):
                return self.comparison(OPERATORS[op], left, right)
            case And(children):
                return joined(AND, "and", [self._chain(run) for run in _runs(children)])
            case Or(children):
                return joined(OR, "or", [self.formula(c) for c in children])
            case _:
                assert_never(formula)

    def _chain(self, run: list[Formula]) -> Expression:
        """`a <= b < c` for a <= b and b < c."""
        atoms = [f for f in run if isinstance(f, Compare)]
        if len(run) == 1 or len(atoms) < len(run):
            return self.formula(run[0])
        terms = (atoms[0].left, *(a.right for a in atoms))
        return Infix(COMPARISON, tuple(map(self.term, terms)), tuple(a.op for a in atoms))

    def comparison(self, operator: str, left: Term, right: Term) -> Expression:
        """One comparison, as Python writes its operator."""
        return Infix(COMPARISON, (self.term(left), self.term(right)), (operator,))

    def binary(self, strength: int, operator: str, left: Term, right: Term) -> Expression:
        """Left-associative, as the tree is: a right operand of the same strength stays in parentheses."""
        first, second = self.term(left), within(strength + 1, self.term(right))
        if isinstance(first, Infix) and first.strength == strength:
            return Infix(strength, (*first.parts, second), (*first.operators, operator))
        return Infix(strength, (within(strength, first), second), (operator,))

    def _signed(self, child: Expression) -> Expression:
        inner = within(POWER, child)
        if isinstance(inner, Bracketed):
            return Bracketed(f"-{inner.head}", inner.parts, inner.brackets)
        return f"-{flat(inner)}"

    def _power(self, base: Expression, exponent: int) -> Expression:
        inner = within(ATOM, base)
        simple = isinstance(inner, str) and inner.replace(".", "").replace("_", "").isalnum()
        return f"{flat(inner)}**{exponent}" if simple else Infix(POWER, (inner, str(exponent)), ("**",))


def _runs(children: tuple[Formula, ...]) -> list[list[Formula]]:
    """Neighbours that Python writes as one chain of comparisons."""
    runs: list[list[Formula]] = []
    for child in children:
        last = runs[-1][-1] if runs else None
        if isinstance(last, Compare) and isinstance(child, Compare) and _chained(last, child):
            runs[-1].append(child)
        else:
            runs.append([child])
    return runs


def _chained(first: Compare, second: Compare) -> bool:
    directions = {first.op, second.op}
    return first.right == second.left and (directions <= {"<", "<="} or directions <= {">", ">="})


def joined(strength: int, operator: str, parts: list[Expression]) -> Expression:
    """Several parts with one operator; `and` inside of `or` stands in parentheses."""
    if len(parts) == 1:
        return parts[0]
    return Infix(strength, tuple(within(COMPARISON, p) for p in parts), (operator,) * (len(parts) - 1))


def within(strength: int, expression: Expression) -> Expression:
    """The expression as an operand of an operator that binds so strongly."""
    return Bracketed("", (expression,)) if _strength(expression) < strength else expression


def _strength(expression: Expression) -> int:
    match expression:
        case Infix(strength):
            return strength
        case str() if "**" in expression:
            return SIGN if expression.startswith("-") else POWER
        case str():
            return SIGN if expression.startswith("-") else ATOM
        case Bracketed(head):
            return SIGN if head.startswith("-") else ATOM
        case Named():
            raise AssertionError("no operand")


# Text -------------------------------------------------------------------------


def flat(expression: Expression) -> str:
    """On one line."""
    match expression:
        case str():
            return expression
        case Infix(parts=parts, operators=operators):
            rest = (f" {o} {flat(p)}" for o, p in zip(operators, parts[1:], strict=True))
            return flat(parts[0]) + "".join(rest)
        case Bracketed(head, parts, brackets):
            return f"{head}{brackets[0]}{', '.join(map(flat, parts))}{brackets[1]}"
        case Named(name, value):
            return f"{name}{flat(value)}"


def statement(before: str, expression: Expression, after: str = "", indent: int = 0) -> list[str]:
    """`before expression after` as formatters of Python lay it out, from `indent` spaces on."""
    margin = " " * indent
    one = f"{margin}{before}{flat(expression)}{after}"
    if len(one) <= WIDTH:
        return [one]
    if isinstance(expression, Bracketed):
        return _broken(expression, before, after, indent)
    if isinstance(expression, Infix) and len(expression.parts) == 2:
        head = f"{before}{flat(expression.parts[0])} {expression.operators[0]} "
        last = expression.parts[1]
        if isinstance(last, Bracketed) and len(margin + head) + len(last.head) < WIDTH:
            return _broken(last, head, after, indent)
        first, rest = expression.parts[0], f" {expression.operators[0]} {flat(last)}{after}"
        if isinstance(first, Bracketed) and first.head and len(margin + rest) < WIDTH:
            return _broken(first, before, rest, indent)
    return [f"{margin}{before}(", *_body(expression, indent + 4), f"{margin}){after}"]


def _broken(expression: Bracketed, before: str, after: str, indent: int) -> list[str]:
    margin = " " * indent
    opening, closing = expression.brackets
    alone = len(expression.parts) == 1 and expression.head in ("", "-") and opening == "("
    comma = "" if alone else ","
    inner = [line for p in expression.parts for line in _item(p, comma, indent + 4)]
    return [f"{margin}{before}{expression.head}{opening}", *inner, f"{margin}{closing}{after}"]


def _item(expression: Expression, comma: str, indent: int) -> list[str]:
    lines = _body(expression, indent, "", len(comma))
    return [*lines[:-1], lines[-1] + comma]


def _body(expression: Expression, indent: int, before: str = "", reserved: int = 0) -> list[str]:
    """Lines inside parentheses: broken at the weakest operator, with `reserved` left on the last."""
    margin = " " * indent
    one = f"{margin}{before}{flat(expression)}"
    match expression:
        case _ if len(one) + reserved <= WIDTH:
            return [one]
        case Named(name, value):
            return _body(value, indent, before + name, reserved)
        case Infix(parts=parts, operators=operators):
            lines = _body(parts[0], indent, before)
            for operator, part in zip(operators, parts[1:], strict=True):
                lines += _body(part, indent, f"{operator} ")
            return lines
        case Bracketed():
            return _broken(expression, before, "", indent)
        case str():
            return [one]
