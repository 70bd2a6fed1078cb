"""The model monitor: whether one run of a whole step explains two states.

Comes in: a model whose flows are solved by polynomials of time and show how long they took by a clock. Goes
out: one case per control path: the tests hold in the state before, and the state after lies on the
solution, within the tolerance, at a time up to which the domain holds. A run's control may not choose
a value for a variable that then moves: the state after does not show it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import reduce

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.flows.solution import NotPolynomial, Solution, solve
from dl2c.ir.logic import atoms, conjuncts, disjunction, folded, mapped, number, substituted
from dl2c.ir.margins import margin_of
from dl2c.ir.model import (
    ONE,
    TRUE,
    ZERO,
    Add,
    Call,
    Compare,
    Flow,
    Formula,
    Model,
    Mul,
    Number,
    Pow,
    Sub,
    Symbol,
    Term,
)
from dl2c.ir.polynomial import Coefficients
from dl2c.ir.printer import print_formula
from dl2c.ir.slack import relaxed, sides_of
from dl2c.monitor.check import Case, Check, Condition, Tolerance, after
from dl2c.monitor.control import Control, control_paths, place_of, tested, title_of
from dl2c.paths.path import END
from dl2c.source import Span


@dataclass(frozen=True, slots=True)
class _Motion:
    """A flow that began with the `values` of a control path; `time` is how long it took."""

    flow: Flow
    solution: Solution
    values: Mapping[str, Term]
    time: Term
    tolerance: Tolerance

    def started(self, term: Term) -> Term:
        """A term over the state where the flow began, over the states before and after."""
        return substituted(term, {Symbol(x, "variable"): v for x, v in self.values.items()})

    def powers(self, coefficients: Coefficients) -> list[Term]:
        """The summands of a polynomial in time."""
        return [_times(self.started(c), self.time, k) for k, c in enumerate(coefficients) if c != ZERO]


def model_check(model: Model, tolerance: Tolerance) -> Check:
    """Numbers of its conditions are all 0. Raises `CompileError` with every flow that has no closed form."""
    moving = frozenset(x for flow in model.flows for x, rate in flow.equations if rate != ZERO)
    steady = frozenset(v.name for v in model.variables) - moving
    controls = control_paths(model, steady)
    solutions = {
        c.draft.flow: _solution(model.flows[c.draft.flow]) for c in controls if c.draft.flow is not None
    }
    found = [s for s in solutions.values() if isinstance(s, Diagnostic)]
    found += [d for c in controls if (d := _refused(model, c)) is not None]
    if found:
        raise CompileError(found)
    solved = {k: s for k, s in solutions.items() if isinstance(s, Solution)}
    return Check("model", tuple(_case(model, c, solved, tolerance) for c in controls))


def _solution(flow: Flow) -> Solution | Diagnostic:
    solution = solve(flow)
    if isinstance(solution, NotPolynomial):
        label = f"{solution.reason}, so that there is no solution polynomial in time"
        return _none(flow.span, label, "the controller monitor needs no solution of the flow")
    if _clock(flow) is None:
        return _none(flow.span, "none of its variables shows how much time passed", "add a clock `t' = 1`")
    if problem := next((p for p in conjuncts(flow.watched) if not _is_watched(p, solution)), None):
        label = "along the flow this condition is not decided by where it begins and ends"
        return _none(place_of(problem), label, "use conjunctions of inequalities, at most quadratic in time")
    return solution


def _is_watched(part: Formula, solution: Solution) -> bool:
    if not isinstance(part, Compare):
        return all(_degree(a, solution) == 0 for a in atoms(part))
    degree = _degree(part, solution)
    return degree == 0 or (part.op in ("<", "<=", ">", ">=") and degree in (1, 2))


def _degree(atom: Compare, solution: Solution) -> int | None:
    margin = solution.compose(margin_of(atom))
    return None if margin is None else len(margin) - 1


def _refused(model: Model, control: Control) -> Diagnostic | None:
    draft = control.draft
    if draft.flow is not None and draft.target != END:
        return _none(
            model.flows[draft.flow].span, "the step goes on after this flow", "end the step by its flow"
        )
    if control.hidden:
        key = control.hidden[0]
        label = "the state after a step does not show the value chosen here"
        return _none(draft.place_of(key), label, "choose values for variables that do not move")
    return None


def _none(span: Span, label: str, advice: str) -> Diagnostic:
    return error("no-model-monitor", "this step has no model monitor", span, label, advice)


def _clock(flow: Flow) -> str | None:
    """The variable that shows how long the flow took."""
    clocks = [h.clock for h in flow.horizons] + [x for x, rate in flow.equations if rate == ONE]
    return clocks[0] if clocks else None


def _case(model: Model, control: Control, solutions: Mapping[int, Solution], tolerance: Tolerance) -> Case:
    draft = control.draft
    flow = None if draft.flow is None else model.flows[draft.flow]
    solution = None if draft.flow is None else solutions[draft.flow]
    moving = {} if solution is None else {x: c for x, c in solution.variables.items() if len(c) > 1}
    steady = {x: v for x, v in control.values.items() if x not in moving and v != after(x)}
    conditions = [
        Condition(0, tolerance.equal(x, v, draft.span), f"{x} has its value", draft.span, gradual=False)
        for x, v in steady.items()
    ]
    tests = [tested(t, tolerance) for t in conjuncts(control.tests)]
    if flow is not None and solution is not None:
        clock = _clock(flow)
        assert clock is not None
        time = _less(after(clock), control.values[clock])
        motion = _Motion(flow, solution, control.values, time, tolerance)
        conditions += [*tests, *_moved(motion, clock, moving)]
    else:
        conditions += tests
    kept = tuple(c for c in conditions if c.formula != TRUE)
    return Case(kept, title_of(model, draft), draft.span)


def _moved(motion: _Motion, clock: str, moving: Mapping[str, Coefficients]) -> Iterator[Condition]:
    """That the state after is on the solution, and that the domain held until then."""
    flow, slack = motion.flow, motion.tolerance.relative
    yield Condition(0, Compare(">=", motion.time, ZERO), "time does not run backwards", flow.span)
    if (longest := flow.reach or flow.cap) is not None:
        capped = relaxed(Compare("<=", motion.time, Number(longest)), slack, sides_of)
        yield Condition(0, capped, f"the flow lasts {float(longest):g} s at most", flow.span)
    for x, coefficients in moving.items():
        if x != clock:
            yield Condition(
                0, _on_curve(motion, x, coefficients), f"{x} follows its solution", flow.span, gradual=False
            )
    ends = {Symbol(x, "variable"): after(x) for x in motion.values}
    for part in conjuncts(flow.domain):
        formula = mapped(relaxed(part, slack, sides_of), lambda term: substituted(term, ends))
        yield Condition(0, formula, f"at the end {print_formula(part)}", place_of(part))
    for part in conjuncts(flow.watched):
        if isinstance(part, Compare) and (between := _between(motion, part)) != TRUE:
            yield Condition(0, between, f"on the way {print_formula(part)}", place_of(part))


def _on_curve(motion: _Motion, x: str, coefficients: Coefficients) -> Formula:
    parts = motion.powers(coefficients) or [ZERO]
    value = reduce(Add, parts)
    given = motion.tolerance.absolute.get(x)
    size = reduce(Add, [ONE, *(Call("abs", (p,)) for p in parts)])
    slack = Number(given) if given is not None else Mul(Number(motion.tolerance.relative), size)
    return Compare("<=", Call("abs", (Sub(after(x), value),)), slack, span=motion.flow.span)


def _between(motion: _Motion, atom: Compare) -> Formula:
    """That a margin quadratic in time is not negative at its vertex, if that lies on the way."""
    margin = motion.solution.compose(margin_of(atom))
    if margin is None or len(margin) != 3:
        return TRUE
    c0, c1, c2 = (motion.started(c) for c in margin)
    end = Add(c1, Mul(Mul(number(2), c2), motion.time))
    slack = Mul(Number(motion.tolerance.relative), Add(ONE, Call("abs", (c0,))))
    low = Mul(Mul(number(4), c2), Add(c0, slack))
    cases = (
        Compare("<=", c2, ZERO, span=atom.span),
        Compare(">=", c1, ZERO, span=atom.span),
        Compare("<=", end, ZERO, span=atom.span),
        Compare("<=", Pow(c1, 2), low, span=atom.span),
    )
    return disjunction(mapped(c, folded) for c in cases)


def _times(factor: Term, time: Term, power: int) -> Term:
    if power == 0:
        return factor
    scaled = time if power == 1 else Pow(time, power)
    return scaled if factor == ONE else Mul(factor, scaled)


def _less(left: Term, right: Term) -> Term:
    return left if right == ZERO else Sub(left, right)
