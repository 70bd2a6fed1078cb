"""What a theorem about stability claims.

For every e > 0 there is d > 0 such that from N < d^2 every run of a loop keeps N < e^2 (stability), or there
is a time T after which N < e^2 holds (attractivity). N is the norm of the state; radii stand squared or not.
"""

from dataclasses import dataclass
from fractions import Fraction

from dl2c.parse import tree
from dl2c.resolve.shape import conjuncts
from dl2c.resolve.symbols import free_variables, nodes
from dl2c.verify.stability.switching import Mode, Switching, switching
from dl2c.verify.states import has_program


@dataclass(frozen=True, slots=True)
class Radius:
    """A bound of the norm: the power, 1 or 2, of a term that is not negative."""

    base: tree.Term
    power: int

    @property
    def bound(self) -> tree.Term:
        return self.base if self.power == 1 else tree.Power(self.base, tree.Number(Fraction(2)))


@dataclass(frozen=True, slots=True)
class Claim:
    """That a program started with norm < `inner` keeps norm < `outer`; with a `clock`, once that has reached
    the witness. `place` is the loop, or the equation of a program without one. `assumed` is what else is true
    at the start.
    """

    witness: tree.Exists
    norm: tree.Term
    inner: Radius
    outer: Radius
    place: tree.Loop | tree.ODESystem
    system: Switching
    clock: str | None
    assumed: tuple[tree.Formula, ...]

    @property
    def kept(self) -> tuple[tree.Formula, ...]:
        """What is assumed of the state, which may be an invariant that helps."""
        names = free_variables(self.norm)
        return tuple(p for p in self.assumed if names & free_variables(p))


def claim_of(formula: tree.Formula) -> Claim | None:
    """The claim of a theorem, if it is about stability."""
    witness: tree.Exists | None = None
    assumed: list[tree.Formula] = []
    while not isinstance(formula, tree.Box):
        match formula:
            case tree.Forall(_, child):
                formula = child
            case tree.Exists(_, child) if witness is None:
                witness, formula = formula, child
            case tree.Imply(left, right):
                assumed += conjuncts(left)
                formula = right
            case tree.And(left, right) if not has_program(left):
                formula = right
            case _:
                return None
    if not assumed or witness is None:
        return None
    match formula.child:
        case tree.Compare("<", norm, outer):
            clock = None
        case tree.Imply(
            tree.Compare(">=", tree.Variable(clock), tree.Variable(limit)), tree.Compare("<", norm, outer)
        ) if limit == witness.variable:
            pass
        case _:
            return None
    for part in assumed:
        match part:
            case tree.Compare("<", left, inner) if left == norm and free_variables(norm):
                others = tuple(p for p in assumed if p is not part)
                return _claim(formula, witness, norm, (inner, outer), clock, others)
            case _:
                pass
    return None


def _claim(
    box: tree.Box,
    witness: tree.Exists,
    norm: tree.Term,
    bounds: tuple[tree.Term, tree.Term],
    clock: str | None,
    assumed: tuple[tree.Formula, ...],
) -> Claim | None:
    inner, outer = map(_radius, bounds)
    if inner.power != outer.power or (clock is None and inner.base != tree.Variable(witness.variable)):
        return None
    loops = [n for n in nodes(box.program) if isinstance(n, tree.Loop)]
    flows = [n for n in nodes(box.program) if isinstance(n, tree.ODESystem)]
    places = loops or flows
    if len(places) != 1:
        return None
    place = places[0]
    if isinstance(place, tree.Loop):
        system = switching(place.child)
        if system is None or len(system.modes) != len(flows):
            return None
    else:
        system = Switching((Mode(place, (), None),), None, ())
    return Claim(witness, norm, inner, outer, place, system, clock, assumed)


def _radius(term: tree.Term) -> Radius:
    match term:
        case tree.Power(base, tree.Number(value)) if value == 2:
            return Radius(base, 2)
        case tree.Times(base, other) if base == other:
            return Radius(base, 2)
        case _:
            return Radius(term, 1)
