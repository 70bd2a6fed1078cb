"""Random exact runs: initial states, half of them on or near a boundary, and decisions that tend to pass.

An atom that is linear or quadratic in a name gives the values at which it changes; these, and numbers near
and between them, are tried beside others. Whether a state satisfies P, and a run its tests and domains, is
then decided exactly, so that no guess can be wrong, only in vain.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from random import Random

from oracles.exact_motion import Flow, Stuck, after, motion
from oracles.exact_numbers import Unclear, Undefined, alike
from oracles.exact_runs import Finding, Rest, Runner, names, premises
from oracles.exact_time import ZERO, Poly, isolated, square_root, squarefree
from oracles.exact_values import Cells, State, atoms, evaluate, truth

from dl2c.parse import tree
from dl2c.resolve.symbols import nodes

LONGEST = Fraction(1000)
DENOMINATORS = (1, 1, 1, 2, 3, 5, 10)
REPAIRS = 100
MOST_ITERATIONS = 25


def number(random: Random) -> Fraction:
    """Mostly small, rarely large, often 0."""
    if random.random() < 0.15:
        return ZERO
    size = 1000 if random.random() < 0.1 else 10
    return Fraction(random.randint(-size, size), random.choice(DENOMINATORS))


def changes(atom: tree.Compare, name: str, state: State) -> list[Fraction]:
    """Values of a name at which an atom changes, those that are rational."""
    line = Poly((ZERO, Fraction(1)))
    try:
        polynomials = Cells(atom, {**state, name: line}).polynomials
    except (Unclear, Undefined):
        return []
    return [root for c in polynomials for root in _zeros(c)]


def _zeros(c: Sequence[Fraction]) -> list[Fraction]:
    if len(c) == 2:
        return [-c[0] / c[1]]
    if len(c) == 3 and (root := square_root(c[1] ** 2 - 4 * c[0] * c[2])) is not None:
        return [(-c[1] + sign * root) / (2 * c[2]) for sign in (1, -1)]
    return []


def near(values: Sequence[Fraction], random: Random) -> Fraction:
    """One of the values, or a number near or between them."""
    a, b = random.choice(values), random.choice(values)
    kind = random.random()
    if kind < 0.35:
        return a
    if kind < 0.6:
        return (a + b) / 2
    if kind < 0.8:
        return a + Fraction(random.choice((-1, 1)), random.choice((1, 10, 1000)))
    return a + number(random)


# Initial states -------------------------------------------------------------------


def initial(formula: tree.Formula, random: Random, inside: tree.Formula | None = None) -> State | None:
    """A state that satisfies P of a theorem, or None; every other time on a boundary of `inside`, or of P."""
    given, _ = premises(formula)
    state = repaired(given, {name: number(random) for name in names(formula)}, random)
    if state is not None and random.random() < 0.5:
        bounded = [inside] if inside is not None and random.random() < 0.7 else given
        return _moved(given, bounded, state, random)
    return state


def repaired(given: Sequence[tree.Formula], state: State, random: Random) -> State | None:
    """The state with names changed until all formulas hold; None if that does not come to an end."""
    parts = [part for formula in given for part in conjuncts(formula)]
    for _ in range(REPAIRS):
        wrong = [part for part in parts if not truth(part, state)]
        if not wrong:
            return state
        atom = random.choice(_atoms(random.choice(wrong)) or [None])
        places = sorted({n.name for n in nodes(atom) if isinstance(n, tree.Variable)} & set(state))
        if not places:
            continue
        name = random.choice(places)
        values = changes(atom, name, state) if atom is not None else []
        other = {**state, name: near(values, random) if values else number(random)}
        if random.random() < 0.3 or len([part for part in parts if not truth(part, other)]) <= len(wrong):
            state = other
    return None


def _moved(
    given: Sequence[tree.Formula], bounded: Sequence[tree.Formula], state: State, random: Random
) -> State:
    """The state moved onto a boundary of some formulas, if it still satisfies the given ones there."""
    found = [atom for formula in bounded for atom in _atoms(formula)]
    choices = [(atom, n.name) for atom in found for n in nodes(atom) if isinstance(n, tree.Variable)]
    for _ in range(10 if choices else 0):
        atom, name = random.choice(choices)
        if name in state and (values := changes(atom, name, state)):
            moved = {**state, name: random.choice(values)}
            if all(truth(part, moved) for part in given):
                return moved
    return state


def conjuncts(formula: tree.Formula) -> Iterator[tree.Formula]:
    if isinstance(formula, tree.And):
        yield from conjuncts(formula.left)
        yield from conjuncts(formula.right)
    else:
        yield formula


def _atoms(formula: tree.Formula) -> list[tree.Compare]:
    try:
        return list(atoms(formula))
    except Unclear:
        return []


# Decisions ------------------------------------------------------------------------


@dataclass
class Chance:
    """Random decisions; with a `goal` several for each iteration, of which those count that come closest to
    violating it.
    """

    random: Random
    retries: int = 12
    tries: int = 1
    goal: tree.Formula | None = None

    def margin(self, state: State) -> float:
        return distance(self.goal, state) if self.goal is not None else 0.0

    def left(self, choice: tree.Choice, state: State, rest: Rest) -> bool:
        return self.random.random() < 0.5

    def again(self, loop: tree.Loop, state: State, iterations: int) -> bool:
        return iterations < MOST_ITERATIONS and self.random.random() < 0.9

    def value(self, name: str, state: State, rest: Rest) -> Fraction:
        tests = [node for statement in rest[:2] for node in nodes(statement) if isinstance(node, tree.Test)]
        found = [v for test in tests for atom in _atoms(test.formula) for v in changes(atom, name, state)]
        if not found or self.random.random() < 0.1:
            return number(self.random)
        return near(found, self.random)

    def flow(self, ode: tree.ODESystem, state: State, rest: Rest) -> Flow:
        """As long as the domain allows, or shorter, or as long as it happens to be."""
        time = self._duration(ode, state)
        for _ in range(5):
            try:
                after(ode, state, Flow(time))
                return Flow(time)
            except Stuck:
                time = time * self.random.choice((Fraction(1, 2), Fraction(1, 10)))
            except Unclear:
                break
        return Flow(ZERO)

    def _duration(self, ode: tree.ODESystem, state: State) -> Fraction:
        ends = sorted(self._ends(ode, state))
        kind = self.random.random()
        if ends and kind < 0.5:
            return ends[0] if kind < 0.35 else self.random.choice(ends)
        if ends and kind < 0.8:
            return ends[0] * Fraction(self.random.randint(0, 10), 10)
        return abs(number(self.random))

    def _ends(self, ode: tree.ODESystem, state: State) -> Iterator[Fraction]:
        """Instants at which an atom of the domain changes, or shortly before."""
        try:
            moving = motion(ode, state, Flow(LONGEST))
            polynomials = Cells(ode.domain, {**state, **moving}).polynomials
        except (Unclear, Undefined):
            return
        for c in polynomials:
            if len(c) > 3:
                yield from (low for low, _ in isolated(squarefree(tuple(c)), ZERO, LONGEST) if low > 0)
            yield from (t for t in _zeros(c) if t > 0)


def distance(formula: tree.Formula, state: State) -> float:
    """About how far inside of a formula a state is, from the differences of both sides of atoms."""
    match formula:
        case tree.And(left, right):
            return min(distance(left, state), distance(right, state))
        case tree.Or(left, right):
            return max(distance(left, state), distance(right, state))
        case tree.Imply(left, right):
            return max(-distance(left, state), distance(right, state))
        case tree.Not(child):
            return -distance(child, state)
        case tree.Compare(op, left, right):
            try:
                above, below = alike(evaluate(right, state), evaluate(left, state))
                difference = float(getattr(above - below, "mid", above - below))
            except (Unclear, Undefined, OverflowError, TypeError):
                return 0.0
            return difference if op in ("<", "<=") else -difference if op in (">", ">=") else 0.0
        case _:
            return 0.0


def goal(formula: tree.Formula) -> tree.Formula:
    """Q."""
    while isinstance(formula, tree.Imply | tree.Forall | tree.Box):
        formula = formula.right if isinstance(formula, tree.Imply) else formula.child
    return formula


@dataclass(frozen=True)
class Run:
    """A random run: whether some state satisfies P, whether the run comes to its end, and the first violation
    of an invariant, or else of Q. A violated Q makes the theorem false; a violated invariant only says that
    this is none.
    """

    begun: bool
    ended: bool = False
    finding: Finding | None = None


def run(formula: tree.Formula, random: Random, inside: tree.Formula | None = None) -> Run:
    """One random run."""
    try:
        start = initial(formula, random, inside)
    except (Stuck, Unclear):
        start = None
    if start is None:
        return Run(False)
    chance = Chance(random)
    if random.random() < 0.3:
        aims = [goal(formula), *([inside] if inside is not None else [])]
        chance = Chance(random, tries=3, goal=random.choice(aims))
    runner = Runner(chance, start)
    try:
        wrong = runner.violates(formula, start)
    except (Stuck, Unclear):
        return Run(True, False, runner.finding)
    if wrong is not None:
        return Run(True, True, Finding("postcondition", wrong, start, start, tuple(runner.log)))
    return Run(True, True, runner.finding)


def refutation(formula: tree.Formula, random: Random, runs: int) -> Finding | None:
    """The first of some random runs that violates Q, so that the theorem is false."""
    inside = first_invariant(formula)
    for _ in range(runs):
        found = run(formula, random, inside).finding
        if found is not None and found.kind == "postcondition":
            return found
    return None


def first_invariant(formula: tree.Formula) -> tree.Formula | None:
    """J of the first loop that has one."""
    loops = (node for node in nodes(formula) if isinstance(node, tree.Loop))
    return next((loop.invariants[0] for loop in loops if loop.invariants), None)
