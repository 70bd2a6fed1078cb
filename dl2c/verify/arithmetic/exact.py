"""Runs of programs over exact rational numbers, to confirm counterexamples.

Shares no code with rules and solvers: terms and formulas are evaluated as dL means them, an undefined atom
being false, and the domain of a differential equation is checked at every instant by isolating roots. What is
not rational, or has no polynomial solution, raises `Inexact`.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TypeAlias, assert_never

from flint import fmpq, fmpq_poly

from dl2c.diagnostics import CompileError
from dl2c.ir.model import Number, Term, Truth
from dl2c.lower.terms import lower_formula
from dl2c.parse import tree
from dl2c.resolve.symbols import nodes
from dl2c.verify.arithmetic.roots import sign_vectors
from dl2c.verify.states import Event, EventKind, has_program, partial

Values: TypeAlias = Mapping[str, Fraction]

Curves: TypeAlias = Mapping[str, fmpq_poly]
"""Polynomials of time."""

MAX_BITS = 20_000
"""Of a power."""

COMPARED: Mapping[str, Callable[[int], bool]] = {
    "=": lambda s: s == 0,
    "!=": lambda s: s != 0,
    "<": lambda s: s < 0,
    "<=": lambda s: s <= 0,
    ">": lambda s: s > 0,
    ">=": lambda s: s >= 0,
}
"""What a comparison says of the sign of left minus right."""


class Inexact(Exception):
    """Something that rational numbers cannot decide."""


class Undefined(Exception):
    """A term without a value."""


class Blocked(Exception):
    """A test or a domain that is false: no such run."""


def term_value(term: tree.Term, values: Values) -> Fraction:
    """The value of a term. Raises `Undefined`, `Inexact`."""
    match term:
        case tree.Number(value):
            return value
        case tree.Variable(name):
            if name not in values:
                raise Inexact(name)
            return values[name]
        case tree.Neg(child):
            return -term_value(child, values)
        case tree.Power(left, right):
            return _power(term_value(left, values), term_value(right, values))
        case tree.BinaryTerm(left, right):
            a, b = term_value(left, values), term_value(right, values)
            if isinstance(term, tree.Divide):
                if not b:
                    raise Undefined
                return a / b
            return a + b if isinstance(term, tree.Plus) else a - b if isinstance(term, tree.Minus) else a * b
        case tree.FuncOf(name, args):
            return _function(name, [term_value(a, values) for a in args])
        case _:
            raise Inexact("a symbol of proofs")


def _power(base: Fraction, exponent: Fraction) -> Fraction:
    if exponent.denominator != 1 or abs(exponent) * max(1, base.numerator.bit_length()) > MAX_BITS:
        raise Inexact("a power")
    if not base and exponent <= 0:
        raise Undefined if exponent else Inexact("0^0")
    return base ** int(exponent)


def _function(name: str, args: Sequence[Fraction]) -> Fraction:
    match name, args:
        case "abs", [a]:
            return abs(a)
        case "min", [a, b]:
            return min(a, b)
        case "max", [a, b]:
            return max(a, b)
        case "sqrt", [a] if a < 0:
            raise Undefined
        case _:
            raise Inexact(name)


def truth(formula: tree.Formula, values: Values, negated: bool = False) -> bool:
    """Whether a formula, or its negation, holds; an undefined atom holds in neither. Raises `Inexact`."""
    match formula:
        case tree.Truth(value):
            return value != negated
        case tree.Compare(op, left, right):
            try:
                difference = term_value(left, values) - term_value(right, values)
            except Undefined:
                return False
            return COMPARED[op]((difference > 0) - (difference < 0)) != negated
        case tree.Not(child):
            return truth(child, values, not negated)
        case tree.And(left, right):
            parts = (truth(f, values, negated) for f in (left, right))
            return any(parts) if negated else all(parts)
        case tree.Or(left, right):
            parts = (truth(f, values, negated) for f in (left, right))
            return all(parts) if negated else any(parts)
        case tree.Imply(left, right):
            return truth(tree.Or(tree.Not(left), right), values, negated)
        case tree.Equiv(left, right):
            both = tree.And(tree.Imply(left, right), tree.Imply(right, left))
            return truth(both, values, negated)
        case _:
            return _without_quantifiers(formula, values) != negated


def _without_quantifiers(formula: tree.Formula, values: Values) -> bool:
    """The truth of a formula with quantifiers or programs, by eliminating them."""
    if partial(formula):
        raise Inexact("a quantifier or a program over terms that may be undefined")
    scope: dict[str, Term] = {name: Number(value) for name, value in values.items()}
    try:
        found = lower_formula(formula, scope)
    except (CompileError, KeyError, AssertionError):
        found = None
    if not isinstance(found, Truth):
        raise Inexact("a quantifier or a program in a condition")
    return found.value


@dataclass(slots=True)
class Run:
    """One run: `decisions` are taken in order as the program asks for them. `in_time` is called now and
    then; what it raises ends the run.
    """

    values: dict[str, Fraction]
    decisions: Sequence[tuple[Event, Fraction]]
    taken: list[tuple[str, Fraction]] = field(default_factory=list[tuple[str, Fraction]])
    in_time: Callable[[], object] = lambda: None

    def violates(self, formula: tree.Formula) -> bool:
        """Whether this run shows that a formula is false. Raises `Inexact`, `Blocked`."""
        match formula:
            case _ if not has_program(formula):
                return truth(tree.Not(formula), self.values)
            case tree.Imply(left, right):
                return truth(left, self.values) and self.violates(right)
            case tree.Or(left, right):
                first, other = (right, left) if has_program(left) else (left, right)
                return truth(tree.Not(first), self.values) and self.violates(other)
            case tree.And(left, right):
                kept = dict(self.values), list(self.taken)
                for part in (left, right):
                    with suppress(Blocked, Inexact):
                        if self.violates(part):
                            return True
                    self.values, self.taken = dict(kept[0]), list(kept[1])
                return False
            case tree.Equiv(left, right):
                return self.violates(tree.And(tree.Imply(left, right), tree.Imply(right, left)))
            case tree.Not(tree.Not(child)):
                return self.violates(child)
            case tree.Not(tree.Diamond(program, child)):
                return self.violates(tree.Box(program, tree.Not(child)))
            case tree.Forall(name, child):
                self.values[name] = self._next("value", name)
                return self.violates(child)
            case tree.Box(program, child):
                self.follow(program)
                return self.violates(child)
            case _:
                raise Inexact("a program in another place")

    def follow(self, program: tree.Program) -> None:
        """Execute a program. Raises `Blocked` where there is no such run, `Inexact`."""
        match program:
            case tree.Assign(name, term, False):
                try:
                    self.values[name] = term_value(term, self.values)
                except Undefined:
                    raise Inexact("an undefined value") from None
            case tree.AssignAny(name, False):
                self.values[name] = self._next("value", f"{name} := *")
            case tree.Test(formula):
                if not truth(formula, self.values):
                    raise Blocked
            case tree.Compose(left, right):
                self.follow(left)
                self.follow(right)
            case tree.Choice(left, right):
                self.follow(right if self._next("choice", "alternative") else left)
            case tree.Loop(child):
                while self._next("again", "once more"):
                    self.iterate(child)
            case tree.ODESystem():
                self._flow(program, self._next("duration", "duration"))
            case tree.Assign() | tree.AssignAny() | tree.ProgramConst() | tree.Dual():
                raise Inexact("no ordinary program")
            case _:
                assert_never(program)

    def iterate(self, body: tree.Program) -> None:
        """Execute the body of a loop once more."""
        self.follow(body)

    def _next(self, kind: EventKind, name: str) -> Fraction:
        if len(self.taken) >= len(self.decisions):
            raise Inexact("decisions do not fit")
        event, value = self.decisions[len(self.taken)]
        if event[0] != kind or (value < 0 and kind != "value"):
            raise Inexact("decisions do not fit")
        self.taken.append((name, value))
        return value

    def _flow(self, ode: tree.ODESystem, duration: Fraction) -> None:
        if not duration:
            if ode.dual or not truth(ode.domain, self.values):
                raise Blocked
            return
        try:
            curves = solved(ode, self.values)
            everywhere({**constant(self.values), **curves}, ode.domain, duration, self.in_time)
        except Undefined:
            raise Inexact("an undefined rate") from None
        at = fmpq(duration.numerator, duration.denominator)
        self.values.update({x: _fraction(c(at)) for x, c in curves.items()})


def constant(values: Values) -> dict[str, fmpq_poly]:
    """Values that do not move."""
    return {x: fmpq_poly([fmpq(v.numerator, v.denominator)]) for x, v in values.items()}


def solved(ode: tree.ODESystem, values: Values) -> dict[str, fmpq_poly]:
    """The solution as polynomials of time. Raises `Inexact` where there is none."""
    waiting = {e.name: e.term for e in ode.equations if isinstance(e, tree.AtomicODE)}
    if len(waiting) < len(ode.equations):
        raise Inexact("a differential symbol")
    known = {x: c for x, c in constant(values).items() if x not in waiting}
    found: dict[str, fmpq_poly] = {}
    while waiting:
        ready = {x: t for x, t in waiting.items() if not _free(t) & waiting.keys()}
        if not ready:
            raise Inexact("no polynomial solution")
        for x, rate in ready.items():
            start = values.get(x, Fraction(0))
            curve = along(rate, {**known, **found}).integral()
            found[x] = curve + fmpq(start.numerator, start.denominator)
            del waiting[x]
    return found


def _free(term: tree.Term) -> set[str]:
    return {n.name for n in nodes(term) if isinstance(n, tree.Variable)}


def along(term: tree.Term, curves: Curves) -> fmpq_poly:
    """A term as a polynomial of time. Raises `Inexact`, `Undefined`."""
    match term:
        case tree.Number(value):
            return fmpq_poly([fmpq(value.numerator, value.denominator)])
        case tree.Variable(name):
            if name not in curves:
                raise Inexact(name)
            return curves[name]
        case tree.Neg(child):
            return -along(child, curves)
        case tree.Power(left, tree.Number(value)) if value.denominator == 1 and 1 <= value <= 60:
            return along(left, curves) ** int(value)
        case tree.Plus(left, right):
            return along(left, curves) + along(right, curves)
        case tree.Minus(left, right):
            return along(left, curves) - along(right, curves)
        case tree.Times(left, right):
            return along(left, curves) * along(right, curves)
        case _:
            parts = {name: c for name in _free(term) if (c := curves.get(name)) is not None}
            if any(c.degree() > 0 for c in parts.values()):
                if isinstance(term, tree.Divide) and not any(
                    curves[n].degree() > 0 for n in _free(term.right) if n in curves
                ):
                    below = along(term.right, curves)
                    if below.degree() < 0:
                        raise Undefined
                    return along(term.left, curves) / below[0]
                raise Inexact("no polynomial of time")
            value = term_value(term, {name: _fraction(c[0]) for name, c in parts.items()})
            return fmpq_poly([fmpq(value.numerator, value.denominator)])


def everywhere(curves: Curves, formula: tree.Formula, until: Fraction, in_time: Callable[[], object]) -> None:
    """Check that a formula holds on all of [0, until]. Raises `Blocked`, `Inexact`, what `in_time` raises."""
    margins: list[fmpq_poly] = []
    shape = _shape(formula, curves, margins, False)
    for signs in sign_vectors(margins, until, in_time):
        if not shape(signs):
            raise Blocked


def _shape(
    formula: tree.Formula, curves: Curves, margins: list[fmpq_poly], negated: bool
) -> Callable[[Sequence[int]], bool]:
    """The formula as a function of the signs of its margins."""
    match formula:
        case tree.Truth(value):
            return lambda _: value != negated
        case tree.Compare(op, left, right):
            try:
                margins.append(along(left, curves) - along(right, curves))
            except Undefined:
                return lambda _: False
            k, holds = len(margins) - 1, COMPARED[op]
            return lambda signs: holds(signs[k]) != negated
        case tree.Not(child):
            return _shape(child, curves, margins, not negated)
        case tree.And(left, right) | tree.Or(left, right):
            one, other = (_shape(f, curves, margins, negated) for f in (left, right))
            if isinstance(formula, tree.And) != negated:
                return lambda signs: one(signs) and other(signs)
            return lambda signs: one(signs) or other(signs)
        case tree.Imply(left, right):
            return _shape(tree.Or(tree.Not(left), right), curves, margins, negated)
        case tree.Equiv(left, right):
            both = tree.And(tree.Imply(left, right), tree.Imply(right, left))
            return _shape(both, curves, margins, negated)
        case _:
            raise Inexact("a quantifier or a program in a domain")


def _fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))
