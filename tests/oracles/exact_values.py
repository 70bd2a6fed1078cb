"""What terms and formulas of dL mean, exactly: syntax trees without definitions, over the reals.

Values are `Fraction`, intervals around what is irrational, and polynomials of time. Whatever these do not
decide raises `Unclear`. An atom with an undefined part is neither true nor false. Of the package only the
constructors of syntax trees are used.
"""

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

from oracles import exact_numbers
from oracles.exact_numbers import Interval, Unclear, Undefined, alike, iv
from oracles.exact_time import ZERO, Point, Poly, points, square_root, trimmed

from dl2c.parse import tree

State = Mapping[str, Any]
DIGITS = 80
CASES = {"abs", "min", "max"}
NEGATED: dict[str, tree.Comparison] = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
OPERATORS: Mapping[str, Callable[[int, int], bool]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


# Terms ------------------------------------------------------------------------


def evaluate(term: tree.Term, state: State) -> Any:
    """The value of a term. Raises `Undefined`, `Unclear`."""
    match term:
        case tree.Number(value):
            return value
        case tree.Variable(name):
            return state[name]
        case tree.Neg(child):
            return -evaluate(child, state)
        case tree.Power(left, right):
            return power(evaluate(left, state), evaluate(right, state))
        case tree.BinaryTerm():
            return _operation(term, evaluate(term.left, state), evaluate(term.right, state))
        case tree.FuncOf("pi" | "e" as name, ()):
            iv.dps = DIGITS
            return iv.mpf(0) + (iv.pi if name == "pi" else iv.e)
        case tree.FuncOf(name, args) if name != "old":
            return _called(name, [evaluate(a, state) for a in args])
        case _:
            raise Unclear(str(term))


def _operation(term: tree.BinaryTerm, a: Any, b: Any) -> Any:
    kinds = {type(x) for x in (a, b)}
    if Poly in kinds and any(isinstance(x, Interval) for x in (a, b)):
        raise Unclear("a polynomial over an interval")
    a, b = (a, b) if Poly in kinds else alike(a, b)
    match term:
        case tree.Plus():
            return a + b
        case tree.Minus():
            return a - b
        case tree.Times():
            return a * b
        case _:
            return a / b if isinstance(b, Poly) else exact_numbers.quotient(a, b)


def power(base: Any, exponent: Any) -> Any:
    """`base^exponent`; 0^0 is 1, and exponents that are not whole need a positive base."""
    if not isinstance(exponent, Fraction) or isinstance(base, int):
        raise Unclear("an exponent that is no number")
    if exponent.denominator == 1:
        found: Any = Fraction(1)
        for _ in range(abs(int(exponent))):
            found = _operation(TIMES, found, base)
        return found if exponent >= 0 else _operation(DIVIDE, Fraction(1), found)
    if exponent == Fraction(1, 2):
        return _called("sqrt", [base])
    if isinstance(base, Fraction) and base <= 0:
        raise Undefined("a power of what is not positive")
    raise Unclear("a power")


TIMES = tree.Times(tree.Number(ZERO), tree.Number(ZERO))
DIVIDE = tree.Divide(tree.Number(ZERO), tree.Number(ZERO))


def _called(name: str, args: list[Any]) -> Any:
    a, b = args[0], args[-1]
    if not any(isinstance(x, Poly) for x in args):
        if name == "sqrt" and isinstance(a, Fraction) and (root := square_root(a)) is not None:
            return root
        iv.dps = DIGITS
        return exact_numbers.called(name, args)
    match name:
        case "abs":
            return abs(a)
        case "min":
            return b if b < a else a
        case "max":
            return b if b > a else a
        case "sqrt":
            return a.root()
        case _:
            raise Unclear(name)


# Formulas ---------------------------------------------------------------------


def truth(formula: tree.Formula, state: State, wanted: bool = True) -> bool:
    """Whether a formula, or else its negation, holds. Raises `Unclear`."""
    match formula:
        case tree.Truth(value):
            return value == wanted
        case tree.Compare():
            return _compared(formula if wanted else negation(formula), state)
        case tree.Not(child):
            return truth(child, state, not wanted)
        case tree.And(left, right) | tree.Or(left, right):
            both = isinstance(formula, tree.And) == wanted
            return _joined(both, (lambda: truth(left, state, wanted), lambda: truth(right, state, wanted)))
        case tree.Imply(left, right):
            return truth(tree.Or(tree.Not(left), right), state, wanted)
        case tree.Equiv():
            return truth(both_ways(formula), state, wanted)
        case tree.Quantified():
            return _quantified(formula, state, wanted)
        case tree.Modal(program, child):
            box = isinstance(formula, tree.Box) == wanted
            return wins(program, state, lambda after: truth(child, after, wanted), box)
        case _:
            raise Unclear(str(formula))


def _joined(both: bool, parts: Sequence[Callable[[], bool]]) -> bool:
    """`all` or `any`; one part that decides suffices where another one is unclear."""
    unclear: Unclear | None = None
    for part in parts:
        try:
            if part() != both:
                return not both
        except Unclear as doubt:
            unclear = doubt
    if unclear:
        raise unclear
    return both


def negation(atom: tree.Compare) -> tree.Compare:
    return replace(atom, op=NEGATED[atom.op])


def both_ways(formula: tree.Equiv) -> tree.Formula:
    left, right = formula.left, formula.right
    return tree.And(tree.Imply(left, right), tree.Imply(right, left))


def _compared(atom: tree.Compare, state: State) -> bool:
    try:
        a, b = evaluate(atom.left, state), evaluate(atom.right, state)
    except Undefined:
        return False
    if isinstance(a, Poly) or isinstance(b, Poly):
        difference = a - b
        if not difference.order:
            raise Unclear("a polynomial instead of a number")
        return OPERATORS[atom.op](difference.sign(), 0)
    found = exact_numbers.holds(atom.op, *alike(a, b))
    if found is None:
        raise Unclear("intervals that overlap")
    return found


def _quantified(formula: tree.Quantified, state: State, wanted: bool) -> bool:
    """By a number of each part of the line on which no atom changes."""
    every = isinstance(formula, tree.Forall) == wanted
    inside = {**state, formula.variable: Poly((ZERO, Fraction(1)))}
    cells = Cells(formula.child, inside)
    bound = sum((1 + sum(abs(x / c[-1]) for x in c) for c in cells.polynomials if c), Fraction(1))
    return (all if every else any)(cells.holds(point, wanted) for point in cells.between(-bound, bound))


class Cells:
    """A formula over polynomials of one unknown."""

    def __init__(self, formula: tree.Formula, state: State) -> None:
        self.formula = formula
        self.differences: dict[tree.Compare, tuple[Fraction, ...] | None] = {}
        for atom in atoms(without_cases(formula)):
            self.differences[atom] = self._difference(atom, state)
        self.polynomials = [c for c in self.differences.values() if c is not None]

    def _difference(self, atom: tree.Compare, state: State) -> tuple[Fraction, ...] | None:
        try:
            found = _operation(MINUS, evaluate(atom.left, state), evaluate(atom.right, state))
        except Undefined:
            return None
        if isinstance(found, Interval):
            raise Unclear("an interval")
        return found.c if isinstance(found, Poly) else trimmed([Fraction(found)])

    def between(self, low: Fraction, high: Fraction) -> Iterator[Point]:
        return points(self.polynomials, low, high)

    def holds(self, point: Point, wanted: bool = True) -> bool:
        return self._holds(without_cases(self.formula), point, wanted)

    def _holds(self, formula: tree.Formula, point: Point, wanted: bool) -> bool:
        match formula:
            case tree.Truth(value):
                return value == wanted
            case tree.Compare(op):
                difference = self.differences[formula]
                return difference is not None and OPERATORS[op](point(difference), 0) == wanted
            case tree.Not(child):
                return self._holds(child, point, not wanted)
            case tree.And(left, right) | tree.Or(left, right):
                sides = (self._holds(side, point, wanted) for side in (left, right))
                return all(sides) if isinstance(formula, tree.And) == wanted else any(sides)
            case _:
                raise Unclear(str(formula))


MINUS = tree.Minus(tree.Number(ZERO), tree.Number(ZERO))


def throughout(formula: tree.Formula, state: State, until: Fraction) -> bool:
    """Whether a formula over polynomials of time holds at all instants of [0, until]."""
    cells = Cells(formula, state)
    return all(cells.holds(point) for point in cells.between(ZERO, until))


def atoms(formula: tree.Formula) -> Iterator[tree.Compare]:
    """All comparisons, wherever they stand; none inside of modalities and quantifiers."""
    match formula:
        case tree.Compare():
            yield formula
        case tree.Not(child):
            yield from atoms(child)
        case tree.Connective(left, right):
            yield from atoms(left)
            yield from atoms(right)
        case tree.Truth():
            return
        case _:
            raise Unclear(str(formula))


# Minima, maxima, absolute values ------------------------------------------------


def without_cases(formula: tree.Formula) -> tree.Formula:
    """Only `&`, `|`, `!` and atoms without abs, min and max."""
    match formula:
        case tree.Compare():
            return _split(formula)
        case tree.Not(child):
            return tree.Not(without_cases(child))
        case tree.And(left, right) | tree.Or(left, right):
            return replace(formula, left=without_cases(left), right=without_cases(right))
        case tree.Imply(left, right):
            return tree.Or(tree.Not(without_cases(left)), without_cases(right))
        case tree.Equiv():
            return without_cases(both_ways(formula))
        case _:
            return formula


def _split(atom: tree.Compare) -> tree.Formula:
    call = next((c for side in (atom.left, atom.right) for c in _calls(side)), None)
    if call is None:
        return atom
    a, b = call.args[0], call.args[-1]
    first, second = (a, tree.Neg(a)) if call.name == "abs" else (a, b)
    if call.name == "min":
        first, second = second, first
    case = tree.Compare(">=", a, tree.Number(ZERO) if call.name == "abs" else b)
    yes, no = (
        tree.And(condition, _split(replace(atom, left=new(atom.left), right=new(atom.right))))
        for condition, new in ((case, _putting(call, first)), (negation(case), _putting(call, second)))
    )
    return tree.Or(yes, no)


def _calls(term: tree.Term) -> Iterator[tree.FuncOf]:
    """Calls of functions with cases, the inner before the outer."""
    match term:
        case tree.FuncOf(name, args):
            for arg in args:
                yield from _calls(arg)
            if name in CASES:
                yield term
        case tree.Neg(child):
            yield from _calls(child)
        case tree.BinaryTerm():
            yield from _calls(term.left)
            yield from _calls(term.right)
        case _:
            return


def _putting(old: tree.Term, new: tree.Term) -> Callable[[tree.Term], tree.Term]:
    def put(term: tree.Term) -> tree.Term:
        if term == old:
            return new
        match term:
            case tree.FuncOf(args=args):
                return replace(term, args=tuple(map(put, args)))
            case tree.Neg(child):
                return replace(term, child=put(child))
            case tree.BinaryTerm():
                return replace(term, left=put(term.left), right=put(term.right))
            case _:
                return term

    return put


# Modalities -------------------------------------------------------------------


def wins(program: tree.Program, state: State, post: Callable[[State], bool], box: bool) -> bool:
    """Whether all runs of a program without loops end well, or one does; a game counts as dL reads it."""
    match program:
        case tree.Assign(name, term, False):
            try:
                return post({**state, name: evaluate(term, state)})
            except Undefined:
                return box
        case tree.Test(formula):
            return (
                (not truth(formula, state) or post(state)) if box else truth(formula, state) and post(state)
            )
        case tree.Compose(left, right):
            return wins(left, state, lambda after: wins(right, after, post, box), box)
        case tree.Choice(left, right, dual=dual):
            mine = box != dual
            return _joined(mine, [lambda s=s: wins(s, state, post, box) for s in (left, right)])  # type: ignore[misc]
        case tree.Dual(child):
            return wins(child, state, post, not box)
        case tree.ODESystem(domain=domain, dual=dual) if not truth(domain, state):
            return box != dual
        case _:
            raise Unclear(str(program))
