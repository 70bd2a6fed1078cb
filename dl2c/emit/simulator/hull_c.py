"""That no event happens in a box of states, proved by intervals (hull.h), in C.

`model_event_free` evaluates the margins of a flow's conditions, as they are written, on intervals that
enclose the state. It holds only if its domain and every watch that is still open hold in every state
inside.
"""

from dl2c.emit.cfile import function, wrapped
from dl2c.emit.leaf import Leaves, Locals
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.enclosed_c import Enclosed
from dl2c.emit.simulator.labels import Label, atom_name, margin_labels, owners, quoted
from dl2c.flows.kernel import FlowPlan, constant_along
from dl2c.ir.logic import atoms
from dl2c.ir.margins import margin_of
from dl2c.ir.model import And, Compare, Formula, Or, Truth

HOLDS = dict.fromkeys((">=", "<=", ">", "<"), "positive") | {"!=": "nonzero", "=": "zero"}
"""A margin that may be zero proves nothing: where it goes, its derivatives tell."""


def event_free_function(build: BuildPlan, leaves: Leaves) -> str:
    """`model_event_free` for all flows."""
    body: list[str] = []
    for k, plan in enumerate(build.flows):
        lines = _proof(margin_labels(build, k), k, owners(build, plan), plan, leaves)
        body += [f"if (flow == {k}) {{", *(f"  {line}" for line in lines), "}"]
    return function(
        "static inline bool model_event_free(int flow, const dl2c_hull *z, const real *x, const real *p, "
        "bool bounded, const uint8_t *watch)",
        [*body, "return false;"],
        "Whether the domain of a flow, if it is `bounded`, and the watches still open hold in all "
        "states within z; what does not move is taken from x.",
    )


def _proof(
    labels: tuple[Label, ...], k: int, watched: tuple[str, ...], plan: FlowPlan, leaves: Leaves
) -> list[str]:
    local = Locals(leaves)
    terms = Enclosed("hull", lambda t: not constant_along(t, plan.flow), local)
    terms.count(margin_of(a) for f in plan.written for a in atoms(f))
    lines: list[str] = []
    truths: list[dict[Compare, str]] = []
    taken: list[str] = []
    for owner, formula in zip((f"flow{k}", *watched), plan.written, strict=True):
        known: dict[Compare, str] = {}
        for atom in dict.fromkeys(atoms(formula)):
            known[atom] = atom_name(labels, owner, atom, taken)
            value = terms.value(margin_of(atom))
            lines += [*quoted(atom), *terms.lines]
            lines += wrapped(f"const bool {known[atom]} = dl2c_hull_{HOLDS[atom.op]}({value});")
            terms.lines.clear()
        truths.append(known)
    domain, *stays = (over_atoms(f, known) for f, known in zip(plan.written, truths, strict=True))
    waiting = [f"((watch[{w}] != DL2C_WATCHING) | {holds})" for w, holds in enumerate(stays)]
    result = wrapped(f"return {' & '.join([f'((!bounded) | {domain})', *waiting])};")
    return [*local.begun(), *lines, *result]


def over_atoms(formula: Formula, truths: dict[Compare, str]) -> str:
    """A formula of atoms whose truths have names."""
    match formula:
        case Truth(value):
            return "true" if value else "false"
        case Compare():
            return truths[formula]
        case And(children):
            return f"({' & '.join(over_atoms(c, truths) for c in children)})"
        case Or(children):
            return f"({' | '.join(over_atoms(c, truths) for c in children)})"
