"""What is certain about the events of a flow, condition by condition: what `dl2c info` says of it."""

from collections.abc import Iterator

from dl2c.flows.exact import MAX_ROOT_DEGREE
from dl2c.flows.kernel import KERNELS, FlowPlan, constant_along
from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import atoms, subterms
from dl2c.ir.margins import margin_of
from dl2c.ir.model import Call, Compare, Formula, Model
from dl2c.ir.printer import print_formula


def certainties(plan: FlowPlan, model: Model) -> Iterator[tuple[str, str]]:
    """Each condition of a flow's domain and each predicate watched along it, with what is certain of it."""
    flow = plan.flow
    for horizon in flow.horizons:
        yield f"{horizon.clock} runs out", "exact"
    for invariant in flow.invariants:
        yield print_formula(invariant), "conserved, as its derivative is zero: no event"
    for atom in dict.fromkeys(atoms(flow.watched)):
        yield print_formula(atom), _of_atom(atom, plan)
    for watch in plan.watches:
        predicate = model.predicates[watch.predicate]
        yield f"{predicate.name} ({watch.kind})", _searched(watch.stays, plan)


def _of_atom(atom: Compare, plan: FlowPlan) -> str:
    margin = margin_of(atom)
    if constant_along(margin, plan.flow):
        return "does not change along the flow"
    curve = None if plan.quick is None or plan.solution is None else plan.solution.compose(margin)
    if curve is not None and len(curve) <= MAX_ROOT_DEGREE + 1:
        degree = len(curve) - 1
        closer = "; searched where rounding may decide" if degree == MAX_ROOT_DEGREE else ""
        return f"certified by its root of degree {degree}{closer}"
    return _searched(atom, plan)


def _searched(formula: Formula, plan: FlowPlan) -> str:
    """Conditions that are enclosed along a motion; a crossing is found up to rounding of the condition."""
    calls = {t.function for t in subterms(formula) if isinstance(t, Call)}
    named = sorted(name for name in calls if not FUNCTIONS[name].exact)
    library = f"; {', '.join(named)} of the C library taken as 2^-50 off at most" if named else ""
    return f"certified along {KERNELS[plan.kernel].motion}{library}"
