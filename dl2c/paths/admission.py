"""What the tests on a straight line ask of its inputs, and where their truth may change.

Comes in: the tests, over the state where the line begins and the inputs met on it, in program
order. Goes out: the tests that no input decides, and one `Admission` for each input. A value of an
input passes where its tests hold and every later input that shares tests with it still has a value
that passes. Over the reals that changes only at roots of the polynomials in `criticals`: leading
coefficients, discriminants and resultants of those of the later input (Collins, "Quantifier
elimination by cylindrical algebraic decomposition", 1975). One value between each two neighbouring
roots therefore speaks for all.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from typing import Literal, TypeAlias

from dl2c.ir.logic import atoms, conjunction, conjuncts, minus, number, plus, rewritten, symbols, times
from dl2c.ir.margins import TooManyCases, smooth
from dl2c.ir.model import ZERO, Add, Compare, Div, Formula, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.ir.normal import normal_form
from dl2c.ir.polynomial import Coefficients, polynomial
from dl2c.paths.zeros import MAX_DEGREE, zero_count

MAX_CRITICALS = 64
"""Critical polynomials of one input; with more a step would take too long."""


MAX_TRIALS = 100_000
"""Values of inputs that are tried together for one mask."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """An input, and the limits of its Box."""

    symbol: Symbol
    low: Fraction
    high: Fraction


@dataclass(frozen=True, slots=True)
class Limit:
    """An atom `offset + slope*u >= 0` (or > 0) of an input u: where slope > 0 a lower limit, else upper."""

    offset: Term
    slope: Term


@dataclass(frozen=True, slots=True)
class Solved:
    """An equality that counts as true where its input is a root of the polynomial as computed, and
    nowhere else: there `symbol` is 1, elsewhere 0.
    """

    symbol: Symbol
    input: Symbol
    polynomial: Coefficients


@dataclass(frozen=True, slots=True)
class Admission:
    """The tests of one input: those that mention it and no later one.

    `condition` is what is evaluated for `tests`: equalities are `solved`. Where the values that pass
    are an interval between `limits`, there are no criticals. Nothing passes but the roots of `pin`,
    unless all its coefficients are zero. `following` is the place, among the
    admissions of the path, of the next input that shares tests with this one, None for none.
    """

    input: int
    tests: Formula
    condition: Formula
    solved: tuple[Solved, ...] = ()
    limits: tuple[Limit, ...] = ()
    criticals: tuple[Coefficients, ...] = ()
    following: int | None = None
    pin: Coefficients | None = None

    @property
    def is_interval(self) -> bool:
        return self.following is None and not self.criticals


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Why `part` cannot be resolved: its degree in the last of `inputs` (by place), that of the condition
    that it leaves for an earlier one, how many values would be tried, or that the last of them may have
    its value before the others.
    """

    kind: Literal["degree", "joint", "many", "reused"]
    part: Formula
    inputs: tuple[int, ...]


class Unresolved(Exception):
    """Tests of inputs outside the class."""

    def __init__(self, obstacles: Iterable[Obstacle]) -> None:
        super().__init__()
        self.obstacles = tuple(dict.fromkeys(obstacles))


Margins: TypeAlias = list[tuple[Term, Formula]]
"""Terms whose roots matter, each with the test that it comes from."""


def admissions(tests: Formula, inputs: Sequence[Unknown]) -> tuple[Formula, tuple[Admission, ...]]:
    """The tests that no input decides, and the admission of every input. Raises `Unresolved`."""
    places = {u.symbol: k for k, u in enumerate(inputs)}
    guard: list[Formula] = []
    own: list[list[Formula]] = [[] for _ in inputs]
    for part in conjuncts(tests):
        used = _used(part, places)
        (own[used[-1]] if used else guard).append(part)
    following = _following(own, places)
    limits = [_limits(parts, u.symbol) for parts, u in zip(own, inputs, strict=True)]
    joined = {j for j in following if j is not None}
    simple = {k for k in places.values() if limits[k] is not None and following[k] is None}
    criticals, obstacles = _criticals(
        [[] if k in simple - joined else p for k, p in enumerate(own)], inputs, places
    )
    if obstacles:
        raise Unresolved(obstacles)
    made: list[Admission] = []
    solved: list[Solved] = []
    for k, parts in enumerate(own):
        if k in simple:
            made.append(Admission(k, conjunction(parts), conjunction(parts), limits=limits[k] or ()))
            continue
        first = len(solved)
        condition = conjunction(_condition(p, places, solved) for p in parts)
        own_solved = tuple(solved[first:])
        pin = _pin(condition, own_solved, inputs[k].symbol)
        made.append(
            Admission(k, conjunction(parts), condition, own_solved, (), criticals[k], following[k], pin)
        )
    if (costly := _costly(made, own)) is not None:
        raise Unresolved([Obstacle("many", costly, tuple(_used(costly, places)))])
    return conjunction(guard), tuple(made)


def _costly(made: list[Admission], own: list[list[Formula]]) -> Formula | None:
    """A test of inputs for which too many values would have to be tried together."""
    trials: list[int] = [0] * len(made)
    for k, a in reversed(list(enumerate(made))):
        roots = sum(zero_count(len(c) - 1) for c in a.criticals)
        here = 2 if a.pin is not None or a.is_interval else 2 * roots + 3
        trials[k] = here * (1 if a.following is None else trials[a.following])
        if trials[k] > MAX_TRIALS and a.following is not None:
            return own[a.following][0] if own[a.following] else conjunction(p for ps in own for p in ps)
    return None


def _used(part: Formula | Term, places: dict[Symbol, int]) -> list[int]:
    """The places of the inputs that occur, in order."""
    return sorted(places[s] for s in symbols(part) if s in places)


def _following(own: list[list[Formula]], places: dict[Symbol, int]) -> list[int | None]:
    """For each input the next one that shares tests with it, directly or through others."""
    group = list(range(len(own)))
    for part in (p for parts in own for p in parts):
        used = _used(part, places)
        for k in used:
            group = [group[used[0]] if g == group[k] else g for g in group]
    return [next((j for j in range(k + 1, len(own)) if group[j] == group[k]), None) for k in range(len(own))]


# Intervals --------------------------------------------------------------------


def _limits(parts: list[Formula], symbol: Symbol) -> tuple[Limit, ...] | None:
    """The limits of an input whose tests are linear inequalities; None for other tests."""
    found: list[Limit] = []
    for part in parts:
        if not isinstance(part, Compare) or part.op in ("=", "!="):
            return None
        upper = part.op in ("<", "<=")
        margin = Sub(part.right, part.left) if upper else Sub(part.left, part.right)
        coefficients = polynomial(margin, {symbol: (ZERO, number(1))})
        if coefficients is None or len(coefficients) > 2:
            return None
        offset, slope = (*coefficients, ZERO)[:2]
        found.append(Limit(offset, slope))
    return tuple(found)


# Equalities -------------------------------------------------------------------


def _condition(part: Formula, places: dict[Symbol, int], solved: list[Solved]) -> Formula:
    """The formula with equalities of inputs replaced by those that are `solved`."""

    def change(atom: Compare) -> Formula:
        if atom.op != "=" or not _used(atom, places):
            return atom
        return rewritten(_smooth(atom, places), lambda case: _solved(case, places, solved))

    return rewritten(part, change)


def _solved(atom: Compare, places: dict[Symbol, int], solved: list[Solved]) -> Compare:
    """One comparison of a case of an equality; an equality of inputs is replaced by the symbol that says
    whether it holds.
    """
    used = _used(atom.left, places)
    if atom.op != "=" or not used:
        return atom
    symbol = next(s for s, k in places.items() if k == used[-1])
    coefficients = _polynomial(atom.left, symbol)
    assert coefficients is not None, "`_criticals` refuses others"
    made = Solved(Symbol(f"solved_{len(solved)}", "input"), symbol, coefficients)
    solved.append(made)
    return Compare("!=", made.symbol, ZERO, span=atom.span)


def _smooth(part: Formula, places: dict[Symbol, int]) -> Formula:
    return smooth(part, lambda term: not symbols(term).isdisjoint(places))


def _pin(condition: Formula, solved: tuple[Solved, ...], symbol: Symbol) -> Coefficients | None:
    """The polynomial of the first equality of the input that must hold."""
    must = {part.left for part in conjuncts(condition) if isinstance(part, Compare)}
    return next((s.polynomial for s in solved if s.input == symbol and s.symbol in must), None)


# Criticals --------------------------------------------------------------------


def _criticals(
    own: list[list[Formula]], inputs: Sequence[Unknown], places: dict[Symbol, int]
) -> tuple[list[tuple[Coefficients, ...]], list[Obstacle]]:
    """For every input the polynomials at whose roots it may begin or cease to pass."""
    margins: list[Margins] = [[] for _ in inputs]
    obstacles: list[Obstacle] = []
    for part in (p for parts in own for p in parts):
        try:
            found = [t for a in atoms(_smooth(part, places)) for t in _factors(a.left, a.op == "=")]
        except TooManyCases:
            obstacles.append(Obstacle("degree", part, tuple(_used(part, places))))
            continue
        for term in found:
            _file(term, part, margins, places)
    made: list[tuple[Coefficients, ...]] = [()] * len(inputs)
    for k in reversed(range(len(inputs))):
        polynomials, failed = _of_input(k, inputs[k], margins, places)
        if failed:
            return made, obstacles + failed
        made[k] = tuple(polynomials)
        if obstacles:
            break
        if not any(_used(c, places) for p in polynomials for c in p):
            continue
        if high := [part for p, part in polynomials.items() if len(p) > 3]:
            return made, [Obstacle("joint", part, tuple(_used(part, places))) for part in high]
        for product, part in _projection(polynomials, inputs[k]):
            for term in _factors(product):
                _file(term, part, margins, places)
    return made, obstacles


def _factors(term: Term, whole: bool = False) -> Iterator[Term]:
    """Terms that have all roots of a term; the term itself where it is wanted as a `whole`."""
    match term:
        case Mul(left, right) | Div(left, right) if not whole:
            yield from _factors(left)
            yield from _factors(right)
        case Neg(child) | Pow(child) if not whole:
            yield from _factors(child)
        case _:
            yield term


def _file(term: Term, part: Formula, margins: list[Margins], places: dict[Symbol, int]) -> None:
    """Enter a term with the last input that it mentions."""
    used = _used(term, places)
    if used and all(term != other for other, _ in margins[used[-1]]):
        margins[used[-1]].append((term, part))


def _of_input(
    k: int, given: Unknown, margins: list[Margins], places: dict[Symbol, int]
) -> tuple[dict[Coefficients, Formula], list[Obstacle]]:
    """The margins of an input as polynomials, each with the test it comes from: of degree 1 or 2, or
    higher where no other input occurs.
    """
    found: dict[Coefficients, Formula] = {}
    obstacles: list[Obstacle] = []
    for term, part in margins[k]:
        used = tuple(_used(part, places))
        coefficients = _polynomial(term, given.symbol)
        if coefficients is None or not _is_resolved(coefficients, places):
            obstacles.append(Obstacle("degree" if used[-1] == k else "joint", part, used))
        elif len(coefficients) == 1:
            _file(coefficients[0], part, margins, places)
        else:
            found.setdefault(coefficients, part)
    if len(found) > MAX_CRITICALS:
        last = max(found.values(), key=lambda part: len(_used(part, places)))
        obstacles.append(Obstacle("many", last, tuple(_used(last, places))))
    return found, obstacles


def _is_resolved(polynomial: Coefficients, places: dict[Symbol, int]) -> bool:
    """Whether its zeros are found."""
    if len(polynomial) <= 3:
        return True
    return len(polynomial) <= MAX_DEGREE + 1 and not any(_used(c, places) for c in polynomial)


def _polynomial(term: Term, symbol: Symbol) -> Coefficients | None:
    """The term as a polynomial in the input, without leading coefficients that are always zero."""
    found = polynomial(term, {symbol: (ZERO, number(1))})
    while found is not None and len(found) > 1 and normal_form(found[-1]) == {}:
        found = found[:-1]
    return found


def _projection(found: dict[Coefficients, Formula], given: Unknown) -> Iterator[tuple[Term, Formula]]:
    """Terms in whose roots the order of the polynomials' roots may change, or their number in the Box."""
    for p, part in found.items():
        yield from ((c, part) for c in p[1:])
        if not any(isinstance(c, Number) and c != ZERO for c in p[1:]):
            yield p[0], part
        if len(p) == 3:
            yield minus(times(p[1], p[1]), times(number(4), times(p[2], p[0]))), part
        for end in (given.low, given.high):
            yield _value(p, end), part
    for (a, first), (b, second) in combinations(found.items(), 2):
        yield _resultant(a, b), second if symbols(second) >= symbols(first) else first


def _value(p: Coefficients, at: Fraction) -> Term:
    value = p[-1]
    for c in reversed(p[:-1]):
        value = plus(times(value, Number(at)), c)
    return value


def _resultant(a: Coefficients, b: Coefficients) -> Term:
    """Zero where the two, of degree 1 or 2, have a root in common and a leading coefficient is not zero."""
    if len(a) < len(b):
        a, b = b, a
    if len(a) == 2 and normal_form(Sub(a[1], b[1])) == {}:
        return minus(b[0], a[0])
    if len(a) == 2 and normal_form(Add(a[1], b[1])) == {}:
        return plus(b[0], a[0])
    cross = minus(times(a[1], b[0]), times(a[0], b[1]))
    if len(a) == 2:
        return cross
    if len(b) == 2:
        outer = minus(times(a[2], b[0]), times(a[1], b[1]))
        return plus(times(outer, b[0]), times(a[0], times(b[1], b[1])))
    outer = minus(times(a[2], b[0]), times(a[0], b[2]))
    upper = minus(times(a[2], b[1]), times(a[1], b[2]))
    return minus(times(outer, outer), times(upper, cross))
