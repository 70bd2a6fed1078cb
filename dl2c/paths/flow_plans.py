"""How all flows of a model are followed, with the solver that a stiff one may need."""

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.flows.kernel import FlowPlan, Refused, plan_flow
from dl2c.flows.starts import equalities_of
from dl2c.flows.watch import watches_along
from dl2c.ir.model import Model
from dl2c.options import Options
from dl2c.paths.path import Paths
from dl2c.paths.stiffness import with_solver


def flow_plans(model: Model, paths: Paths, options: Options) -> tuple[FlowPlan, ...]:
    """How every flow is followed. Raises `CompileError` for those that cannot be, as asked."""
    others = (options.integrator, equalities_of(model), model.tolerance)
    plans = [plan_flow(f, watches_along(model, k), *others) for k, f in enumerate(model.flows)]
    refused = [_refused(p) for p in plans if isinstance(p, Refused)]
    if refused:
        raise CompileError(refused)
    flows = [p for p in plans if not isinstance(p, Refused)]
    return tuple(with_solver(k, p, model, paths) for k, p in enumerate(flows))


def _refused(refused: Refused) -> Diagnostic:
    return error(
        "flow-not-exact",
        "this differential equation cannot be integrated as asked",
        refused.span,
        refused.reason,
        refused.help,
    )
