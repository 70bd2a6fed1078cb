"""How each flow is followed, and why.

Comes in: a flow and what is watched along it. Goes out: `FlowPlan`: the margins of all
conditions, the kernel that moves the state, and, where motion and margins are polynomials of
time, their coefficients. Interpreter and code generator read the same plan.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal, TypeAlias

from dl2c.flows.exact import ExactPlan, Snap, plan
from dl2c.flows.solution import NotPolynomial, Solution, moving, solve
from dl2c.flows.starts import Projection, Start, merged, projections, slacks_of, steady, used
from dl2c.flows.watch import Watch
from dl2c.ir.logic import conjunction, conjuncts, negation, operands, with_sides
from dl2c.ir.margins import Moves, TooManyCases, cleared, margin_of, margins_of, smooth
from dl2c.ir.model import ZERO, Add, Compare, Div, Flow, Formula, Mul, Neg, Pow, Sub, Symbol, Term
from dl2c.ir.polynomial import Coefficients, polynomial
from dl2c.options import Integrator
from dl2c.source import Span

Kernel: TypeAlias = Literal["exact", "linear", "cvodes", "dopri5"]


@dataclass(frozen=True, slots=True)
class KernelFacts:
    """`code` names the kernel in C, `part` the part of the runtime that it needs, "" for none. `motion` says
    what its tracks are; with `tolerances` they approximate the solution as `rtol` and `atol` ask.
    """

    code: str
    motion: str
    part: str = ""
    tolerances: bool = False


APPROXIMATE = "that this is within the tolerances of the solution is not"

KERNELS: Mapping[Kernel, KernelFacts] = {
    "exact": KernelFacts("SOLUTION", "the solution"),
    "linear": KernelFacts("LINEAR", "the solution, a power series to the last digit", "LINEAR"),
    "cvodes": KernelFacts("NUMERIC", f"the solver's interpolant; {APPROXIMATE}", "SOLVED", tolerances=True),
    "dopri5": KernelFacts("DOPRI", f"the method's interpolant; {APPROXIMATE}", "DOPRI", tolerances=True),
}

QUICK = "QUICK"
"""The code of straight-line motion, which is what `exact` flows of low degree have."""

QUICK_DEGREE = 2
"""Straight-line code proves of margins of this degree that they keep their sign."""

NO_DEGREE = 1000
"""Stands for the degree of a term that is not a polynomial."""

MAX_MARGIN_DEGREE = 24
"""The roots of margins of higher degree in time are not isolated in exact arithmetic."""


FEWER = "write the conditions with fewer of these"


@dataclass(frozen=True, slots=True)
class FlowPlan:
    """How one flow is followed.

    `still` is a condition that no watch fails along the flow, over the margins of `still_curves`,
    which have degree two at most; None where there is no such simple one.

    `domain` and, for each watch, `stays`, `due`, `goal` are formulas over `margins` alone.
    `curves` are, for exact arithmetic, coefficients along the flow of polynomials with the signs of the
    margins; None where there are none. `quick` is the straight-line motion of simple flows. `snaps` says
    for a margin which variable is set to its bound when the flow ends there. `written` are the domain
    and, for each watch, what stays, before they were split into margins. `starts` are what margins are
    over besides state and constants; `projections` what the end of a numerical flow is moved onto. A
    linear flow that may be `stiff` begins anew with CVODES where it needs too many power series.
    """

    flow: Flow
    kernel: Kernel
    reason: str
    solution: Solution | None
    quick: ExactPlan | None
    domain: Formula
    watches: tuple[Watch, ...]
    margins: tuple[Term, ...]
    curves: tuple[Coefficients, ...] | None
    snaps: tuple[tuple[int, Snap], ...]
    still: Formula | None
    still_margins: tuple[Term, ...]
    still_curves: tuple[Coefficients, ...]
    written: tuple[Formula, ...]
    starts: tuple[Start, ...] = ()
    projections: tuple[Projection, ...] = ()
    stiff: bool = False

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """The domain, then three for each watch, in the numbering of the compiled code."""
        return (self.domain, *(f for w in self.watches for f in (w.stays, w.due, w.goal)))


@dataclass(frozen=True, slots=True)
class Refused:
    """Why a flow cannot be followed as asked, where, and what to do about it."""

    reason: str
    span: Span
    help: str


def plan_flow(
    flow: Flow,
    watches: Sequence[Watch],
    integrator: Integrator = "auto",
    equalities: Sequence[Compare] = (),
    tolerance: Fraction = Fraction(0),
) -> FlowPlan | Refused:
    """The plan of a flow, or why there is none. `equalities` are what its end is projected onto where it
    conserves them and they hold within the tolerance where it begins.
    """
    watches = merged(watches)
    found = _planned(flow, watches, integrator, slacks_of(watches))
    if isinstance(found, Refused) or found.kernel == "exact":
        return found
    calm = steady(flow, watches)
    found = _planned(flow, calm.watches, integrator, (*slacks_of(watches), *calm.starts))
    assert isinstance(found, FlowPlan)
    return replace(found, projections=projections(flow, equalities, tolerance))


def _planned(
    flow: Flow, watches: Sequence[Watch], integrator: Integrator, starts: Sequence[Start]
) -> FlowPlan | Refused:
    """The plan of a flow whose margins may be over `starts`."""

    def moves(term: Term) -> bool:
        return not constant_along(term, flow)

    try:
        domain = _smooth(flow.watched, moves)
        watched = tuple(_smoothed(w, moves) for w in watches)
        still = conjunction(_smooth(w.plainly, moves) for w in watches)
    except TooManyCases:
        return Refused("its conditions have too many cases of abs, min and max", flow.span, FEWER)
    margins = margins_of([domain, *(f for w in watched for f in (w.stays, w.due, w.goal))])
    solved, why = _solved(flow, integrator)
    kernel, why = ("exact", why) if solved is not None else _numeric(flow, integrator, why)
    if solved is None and kernel == "exact":
        advice = "leave out `integrator=exact`, or make the flow polynomial in time"
        return Refused(why, flow.span, advice)
    still_margins = margins_of([still])
    still_curves = None if solved is None else _curves(solved, still_margins, moves, starts)
    simple = still_curves is not None and all(len(c) <= QUICK_DEGREE + 1 for c in still_curves)
    written = (flow.watched, *(w.stays for w in watches))
    return FlowPlan(
        flow=flow,
        kernel=kernel,
        reason=why,
        solution=solved,
        quick=_quick(flow) if solved is not None else None,
        domain=domain,
        watches=watched,
        margins=margins,
        curves=None if solved is None else _curves(solved, margins, moves),
        snaps=tuple(_snaps(flow, margins)),
        still=still if simple else None,
        still_margins=still_margins,
        still_curves=still_curves if still_curves is not None and simple else (),
        written=written,
        starts=used(starts, [*margins, *written]),
    )


def _quick(flow: Flow) -> ExactPlan | None:
    made = plan(flow)
    return made if isinstance(made, ExactPlan) else None


def _numeric(flow: Flow, integrator: Integrator, why: str) -> tuple[Kernel, str]:
    """The kernel of a flow that is not solved, and why: the one asked for, or what suits it."""
    if integrator in ("auto", "exact"):
        if is_linear(flow):
            return "linear", "its equations are linear: power series to the last digit"
        return ("cvodes" if integrator == "auto" else "exact"), why
    return integrator, why


def _smooth(formula: Formula, moves: Moves) -> Formula:
    """The formula over margins as they are written, but `x + c` for `c - (-x)` with c that does not move:
    the same bits, and often one margin instead of two.
    """

    def direct(term: Term) -> Term:
        match term:
            case Sub(left, Neg(right)) if not moves(left) and moves(right):
                return Add(right, left)
            case _:
                return term

    return with_sides(smooth(formula, moves, as_written=True), direct)


def _smoothed(watch: Watch, moves: Moves) -> Watch:
    """Over margins. Signs are always known: an obligation waits also where D or P has no value."""
    due, goal = _smooth(watch.due, moves), _smooth(watch.goal, moves)
    waits = watch.kind == "obligation"
    stays = conjunction([negation(due), negation(goal)])
    if not waits:
        stays = _smooth(watch.stays, moves)
    return replace(watch, stays=stays, due=due, goal=goal)


def _solved(flow: Flow, integrator: Integrator) -> tuple[Solution | None, str]:
    """The polynomial solution if it can be used, and the reason for the kernel that follows from it."""
    if integrator not in ("auto", "exact"):
        return None, f"integrator={integrator} was asked for"
    solution = solve(flow)
    if isinstance(solution, NotPolynomial):
        return None, solution.reason
    return solution, "its solution is a polynomial of time"


def _curves(
    solution: Solution, margins: Sequence[Term], moves: Moves, starts: Sequence[Start] = ()
) -> tuple[Coefficients, ...] | None:
    """The coefficients of polynomials with the signs of the margins, over what `starts` stand for; None where
    one is not a polynomial of a reasonable degree.
    """
    curves = {**solution.curves, **{s.symbol: (s.value,) for s in starts}}
    found: list[Coefficients] = []
    for margin in margins:
        curve = polynomial(cleared(margin, moves), curves)
        if curve is None or len(curve) > MAX_MARGIN_DEGREE + 1:
            return None
        found.append(curve)
    return tuple(found)


def _snaps(flow: Flow, margins: Sequence[Term]) -> list[tuple[int, Snap]]:
    """Bounds `x >= c`, `x <= c` of the domain's conjuncts, with c constant along the flow (semantics 4)."""
    rates = dict(flow.equations)
    found: list[tuple[int, Snap]] = []
    for atom in conjuncts(flow.watched):
        if not isinstance(atom, Compare) or atom.op not in ("<=", ">="):
            continue
        for variable, target in ((atom.left, atom.right), (atom.right, atom.left)):
            if isinstance(variable, Symbol) and variable.name in rates and constant_along(target, flow):
                margin = margin_of(atom)
                if margin in margins:
                    found.append((margins.index(margin), Snap(variable.name, target)))
    return found


def is_linear(flow: Flow) -> bool:
    """Whether the rates are linear in what evolves, with coefficients constant along the flow."""
    rates = dict(flow.equations)
    return all(_degree(rate, rates) <= 1 for rate in rates.values())


def _degree(term: Term, rates: Mapping[str, Term]) -> int:
    """The degree in the variables that evolve, as written; `NO_DEGREE` for what is no such polynomial."""
    match term:
        case Symbol(name, kind):
            return int(kind == "variable" and rates.get(name, ZERO) != ZERO)
        case Add(left, right) | Sub(left, right):
            return max(_degree(left, rates), _degree(right, rates))
        case Mul(left, right):
            return _degree(left, rates) + _degree(right, rates)
        case Pow(base, exponent):
            return _degree(base, rates) * exponent
        case Div(left, right) if _degree(right, rates) == 0:
            return _degree(left, rates)
        case Neg(child):
            return _degree(child, rates)
        case _:
            return max((_degree(t, rates) for t in operands(term)), default=0) * NO_DEGREE


def constant_along(term: Term, flow: Flow) -> bool:
    """Whether no variable of the term evolves along the flow."""
    return not moving(term, dict(flow.equations))
