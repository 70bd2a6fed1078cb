"""What an exported monitor prints of its conditions, read back and evaluated over the reals.

The texts are those that `conditions.json` calls `evaluated`, tolerances and all; the header of the monitor
says which of them are a case together. A state satisfies a check where all conditions of some case hold.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, get_args

import numpy as np
from oracles import exact_numbers, rigorous_arrays
from oracles.controller_relation import FALSE_, TRUE, UNDECIDED
from oracles.exact_numbers import conjoined, decided
from oracles.rigorous_arrays import Bools, Doubles, Near

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

TOKENS = re.compile(r"\s*(\d+(?:\.\d+)?(?:[eE][-+]?\d+)?|[A-Za-z_]\w*|<=|>=|!=|[-+*/^(),=<>&|!])")
NEGATIONS: dict[Comparison, Comparison] = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
ROOM = 64
"""How many units in the last place a monitor without intervals may be off, of the magnitudes of all terms."""

SMALLEST = {False: Fraction(1, 2**1022), True: Fraction(1, 2**126)}
"""Normal numbers, of doubles and of floats."""

Numbers = Mapping[Symbol, Fraction]


@dataclass(slots=True)
class _Reader:
    """A text and how far it is read."""

    words: list[str]
    place: int = 0

    def next(self) -> str:
        return self.words[self.place] if self.place < len(self.words) else ""

    def take(self, *words: str) -> str:
        """The next word if it is one of these, else ""."""
        found = self.next() if self.next() in words else ""
        self.place += bool(found)
        return found

    def need(self, word: str) -> None:
        assert self.take(word), (word, self.words[self.place :][:5])

    def formula(self) -> Formula:
        parts = [self._conjunction()]
        while self.take("|"):
            parts.append(self._conjunction())
        return Or(tuple(parts)) if len(parts) > 1 else parts[0]

    def _conjunction(self) -> Formula:
        parts = [self._literal()]
        while self.take("&"):
            parts.append(self._literal())
        return And(tuple(parts)) if len(parts) > 1 else parts[0]

    def _literal(self) -> Formula:
        if self.take("!"):
            return negation(self._literal())
        if word := self.take("true", "false"):
            return Truth(word == "true")
        start = self.place
        try:
            return self._comparison()
        except AssertionError:
            self.place = start
        self.need("(")
        found = self.formula()
        self.need(")")
        return found

    def _comparison(self) -> Formula:
        left = self.term()
        operator: Any = self.take(*get_args(Comparison))
        assert operator, self.words[self.place :][:5]
        return Compare(operator, left, self.term())

    def term(self) -> Term:
        found = self._product()
        while operator := self.take("+", "-"):
            right = self._product()
            found = Add(found, right) if operator == "+" else Sub(found, right)
        return found

    def _product(self) -> Term:
        found = self._signed()
        while operator := self.take("*", "/"):
            right = self._signed()
            found = Mul(found, right) if operator == "*" else Div(found, right)
        return found

    def _signed(self) -> Term:
        if self.take("-"):
            return Neg(self._signed())
        found = self._factor()
        if self.take("^"):
            exponent = self._signed()
            assert isinstance(exponent, Number) and exponent.value.denominator == 1 and exponent.value > 0
            return Pow(found, int(exponent.value))
        return found

    def _factor(self) -> Term:
        if self.take("("):
            found = self.term()
            self.need(")")
            return found
        word: Any = self.next()
        assert word and (word[0].isalnum() or word[0] == "_"), self.words[self.place :][:5]
        self.place += 1
        if word[0].isdigit():
            return Number(Fraction(word))
        if word not in FUNCTIONS or not self.take("("):
            return Symbol(word, "variable")
        args = [self.term()]
        while self.take(","):
            args.append(self.term())
        self.need(")")
        return Call(word, tuple(args))


def read(text: str) -> Formula:
    """A printed formula; all names are variables."""
    words, end = list[str](), 0
    text = text.strip()
    while end < len(text):
        found = TOKENS.match(text, end)
        assert found, text[end:]
        words.append(found[1])
        end = found.end()
    reader = _Reader(words)
    formula = reader.formula()
    assert reader.place == len(words), words[reader.place :]
    return formula


def negation(formula: Formula) -> Formula:
    match formula:
        case Truth(value):
            return Truth(not value)
        case Compare(op, left, right):
            return Compare(NEGATIONS[op], left, right)
        case And(children):
            return Or(tuple(negation(c) for c in children))
        case Or(children):
            return And(tuple(negation(c) for c in children))


def grouped(header: str, kind: str) -> list[list[int]]:
    """The numbers of the conditions of each case of a check, as a monitor's header lists them."""
    cases: list[list[int]] = []
    inside = False
    for line in header.split("Conditions by number:")[1].splitlines():
        if found := re.match(r" \*\s+(\d+)  ", line):
            if inside:
                cases[-1].append(int(found[1]))
        elif found := re.match(r" \* (\w+), ", line):
            inside = found[1] == kind
            cases += [[]] if inside else []
    return cases


class Printed:
    """The conditions of one check of an exported monitor, on rows of doubles whose columns have `names`."""

    def __init__(self, files: Mapping[str, str], kind: str, names: Sequence[str]) -> None:
        (header,) = (text for name, text in files.items() if name.endswith("_monitor.h"))
        told = json.loads(files["conditions.json"])["conditions"]
        self.texts = {c["id"]: c["evaluated"] for c in told if c["check"] == kind}
        self.groups = grouped(header, kind)
        assert sorted(n for group in self.groups for n in group) == sorted(self.texts)
        formulas = {number: read(text) for number, text in self.texts.items()}
        self.cases = [[formulas[n] for n in group] for group in self.groups]
        self.conditions = tuple(dict.fromkeys(formulas.values()))
        self.symbols = [Symbol(name, "variable") for name in names]

    def shape(self) -> list[list[str]]:
        """The texts of each case."""
        return [[self.texts[n] for n in group] for group in self.groups]

    def _columns(self, rows: Doubles) -> dict[Symbol, Near]:
        return {s: Near(rows[:, k]) for k, s in enumerate(self.symbols)}

    def in_doubles(self, rows: Doubles) -> Bools:
        """Whether rows satisfy the check, as a program in doubles finds it."""
        env, size = self._columns(rows), len(rows)
        with np.errstate(all="ignore"):
            known = {c: rigorous_arrays.in_doubles(c, env, size) for c in self.conditions}
        return np.logical_or.reduce([np.logical_and.reduce([known[c] for c in case]) for case in self.cases])

    def by_case(self, rows: Doubles) -> "np.ndarray[tuple[int, int], np.dtype[np.int8]]":
        """For each case, and each row: 1 where all its conditions hold, 0 where one does not, -1 where too
        close to tell.
        """
        env, size = self._columns(rows), len(rows)
        found = np.zeros((len(self.cases), size), np.int8)
        with np.errstate(all="ignore"):
            known = {c: rigorous_arrays.truths(c, env, size) for c in self.conditions}
        for k, case in enumerate(self.cases):
            found[k] = np.logical_and.reduce([known[c][0] for c in case])
            possibly = np.logical_and.reduce([known[c][1] for c in case])
            for row in np.flatnonzero(possibly & (found[k] == 0)).tolist():
                rest = [c for c in case if not known[c][0][row]]
                found[k, row] = self._exactly(rest, rows[row].tolist())
        return found

    def surely(self, rows: Doubles, ids: "np.ndarray[Any, Any]") -> Bools:
        """Where the condition of a row's number surely holds."""
        found, formulas = np.zeros(len(rows), np.bool_), dict[int, Formula]()
        for group, case in zip(self.groups, self.cases, strict=True):
            formulas |= dict(zip(group, case, strict=True))
        for number in set(ids.tolist()) & formulas.keys():
            lines = np.flatnonzero(ids == number)
            with np.errstate(all="ignore"):
                env = self._columns(rows[lines])
                found[lines] = rigorous_arrays.truths(formulas[number], env, len(lines))[0]
        return found

    def _exactly(self, conditions: Sequence[Formula], row: Sequence[float]) -> int:
        env = self.numbers(row)
        told = conjoined(decided(lambda c=c: exact_numbers.truth(c, env)) for c in conditions)
        return UNDECIDED if told is None else TRUE if told else FALSE_

    def numbers(self, row: Sequence[float]) -> Numbers:
        return {s: Fraction(value) for s, value in zip(self.symbols, row, strict=True)}

    def may_be(self, verdict: bool, row: Sequence[float], unit: Fraction) -> bool:
        """Whether rounding explains the verdict: with each comparison moved towards it by ROOM units in the
        last place of the magnitudes of its terms, a case holds, or none does.
        """
        env = self.numbers(row)
        cases = [
            conjoined(decided(lambda c=c: _moved(c, env, verdict, unit)) for c in case) for case in self.cases
        ]
        return any(c is not False for c in cases) if verdict else all(c is not True for c in cases)


def judged(by_case: "np.ndarray[Any, Any]") -> "np.ndarray[Any, Any]":
    """1 where a case holds, 0 where none does, -1 where too close to tell."""
    return np.where(
        (by_case == TRUE).any(0), TRUE, np.where((by_case == UNDECIDED).any(0), UNDECIDED, FALSE_)
    )


def _moved(formula: Formula, env: Numbers, verdict: bool, unit: Fraction) -> bool | None:
    """Truth where a comparison that is close counts as the verdict."""
    match formula:
        case Compare(_, left, right):
            found = exact_numbers.truth(formula, env)
            if found is verdict or (_copied(left, unit) and _copied(right, unit)):
                return found
            return verdict if _close(left, right, env, unit) else found
        case And(children):
            return conjoined(_moved(c, env, verdict, unit) for c in children)
        case Or(children):
            parts = [_moved(c, env, verdict, unit) for c in children]
            return True if True in parts else None if None in parts else False
        case _:
            return exact_numbers.truth(formula, env)


def _copied(term: Term, unit: Fraction) -> bool:
    """Whether a monitor has the term without rounding it."""
    if isinstance(term, Number):
        single = unit > Fraction(1, 2**50)
        return Fraction(float(np.float32(float(term.value)) if single else float(term.value))) == term.value
    return isinstance(term, Symbol) or (isinstance(term, Neg) and _copied(term.child, unit))


def _close(left: Term, right: Term, env: Numbers, unit: Fraction) -> bool:
    try:
        apart = exact_numbers.evaluate(Sub(left, right), env)
        total = magnitude(Add(left, right), env, SMALLEST[unit > Fraction(1, 2**50)])
        room = total * exact_numbers.alike(total, ROOM * unit)[1]
        return exact_numbers.holds("<=", *exact_numbers.alike(abs(apart), room)) is not False
    except ArithmeticError:
        return True


def magnitude(term: Term, env: Numbers, smallest: Fraction) -> Any:
    """The sum of the magnitudes of what a term adds up; of quotients and roots, what an error of that size
    in their operands makes of them. Products and quotients count as at least the `smallest` normal number,
    below which errors do not become smaller.
    """

    def of(part: Term) -> Any:
        return magnitude(part, env, smallest)

    match term:
        case Add(a, b) | Sub(a, b):
            found = (of(a), of(b))
        case Mul(a, b):
            first, second = exact_numbers.alike(of(a), of(b))
            found = (first * second, smallest)
        case Div(a, b):
            divisor = exact_numbers.evaluate(b, env)
            product = of(Mul(a, b))
            found = (exact_numbers.quotient(*exact_numbers.alike(product, divisor * divisor)), smallest)
        case Neg(a) | Call("abs", (a,)):
            return of(a)
        case Pow(a, n):
            found = (of(a) ** n, smallest)
        case Call("min" | "max", (a, b)):
            found = (of(a), of(b))
        case Call("sqrt", (a,)):
            root = exact_numbers.evaluate(term, env)
            return exact_numbers.quotient(*exact_numbers.alike(of(a), root))
        case Call(_, (a,)):
            value = abs(exact_numbers.evaluate(term, env))
            found = (1 + value, of(a))
        case _:
            return abs(exact_numbers.evaluate(term, env))
    a, b = exact_numbers.alike(*found)
    return a + b
