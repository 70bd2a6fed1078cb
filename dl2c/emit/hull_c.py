"""A quick look at a whole track, in C: that nothing happens on it, proved by intervals (hull.h).

`model_calm` evaluates the margins of a flow's conditions, as they are written, on hulls of the
state. It holds only if its domain and every watch that is still open hold in every state inside.
"""

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import function, wrapped
from dl2c.emit.names import slot
from dl2c.emit.plan import Environment
from dl2c.ir.kernel import FlowPlan
from dl2c.ir.logic import atoms
from dl2c.ir.margins import margin_of
from dl2c.ir.model import And, Compare, Formula, Or, Symbol, Term, Truth
from dl2c.symbolic.tape import Instruction, Tape, term_tape
from dl2c.symbolic.terms import Builder

HOLDS = dict.fromkeys((">=", "<=", ">", "<"), "positive") | {"!=": "apart", "=": "equal"}
"""A margin that gets to zero is not plain: where it goes, its derivatives tell."""
OPERATIONS = frozenset(
    {"add", "sub", "mul", "div", "neg", "abs", "min", "max", "sqrt", "exp", "sin", "cos"}
    | {"tan", "arcsin", "arctan", "tanh", "pow"}
)
"""What hull.h has as `dl2c_hull_<operation>`."""


def calm_function(environment: Environment, builder: Builder) -> str:
    """`model_calm` for all flows that are followed track by track."""
    body: list[str] = []
    for k, plan in enumerate(environment.flows):
        if plan.kernel != "exact":
            body += [f"if (flow == {k}) {{", *(f"  {line}" for line in _calm(plan, builder)), "}"]
    return function(
        "static inline bool model_calm(int flow, const dl2c_hull *x, const real *p, const uint8_t *watch)",
        [*body, "return false;"],
        "Whether the domain of a flow and the watches still open plainly hold in all states within x.",
    )


def _calm(plan: FlowPlan, builder: Builder) -> list[str]:
    margins = tuple(dict.fromkeys(margin_of(a) for f in plan.written for a in atoms(f)))
    lines: list[str] = []
    for j, margin in enumerate(margins):
        lines += _margin(j, term_tape(builder, margin))
    domain, *stays = (_holds(f, margins) for f in plan.written)
    waiting = [f"((watch[{w}] != DL2C_WATCHING) | {holds})" for w, holds in enumerate(stays)]
    return [*lines, *wrapped(f"return {' & '.join([domain, *waiting])};")]


def _holds(formula: Formula, margins: tuple[Term, ...]) -> str:
    match formula:
        case Truth(value):
            return "true" if value else "false"
        case Compare(op):
            return f"dl2c_hull_{HOLDS[op]}(margin{margins.index(margin_of(formula))})"
        case And(children):
            return f"({' & '.join(_holds(c, margins) for c in children)})"
        case Or(children):
            return f"({' | '.join(_holds(c, margins) for c in children)})"


def _margin(j: int, tape: Tape) -> list[str]:
    """Statements that compute the hull `margin<j>`."""
    uses = [sum(i.args.count(k) for i in tape.instructions) for k in range(len(tape.instructions))]
    places = {s.name: s for s in tape.inputs}
    lines: list[str] = []
    texts: list[str] = []
    for k, instruction in enumerate(tape.instructions):
        text = _text(instruction, texts, places)
        if instruction.args and uses[k] > 1:
            lines += wrapped(f"const dl2c_hull part{j}_{k} = {text};")
            text = f"part{j}_{k}"
        texts.append(text)
    return [*lines, *wrapped(f"const dl2c_hull margin{j} = {texts[tape.result]};")]


def _text(instruction: Instruction, texts: list[str], places: dict[str, Symbol]) -> str:
    args = [texts[a] for a in instruction.args]
    match instruction.operation:
        case "input":
            symbol = places[instruction.name]
            return slot(symbol) if symbol.kind == "variable" else f"dl2c_hull_at({slot(symbol)})"
        case "constant":
            return f"dl2c_hull_at({number(instruction.value)})"
        case "mul" if args[0] == args[1]:
            return f"dl2c_hull_square({args[0]})"
        case operation if operation in OPERATIONS:
            return f"dl2c_hull_{operation}({', '.join(args)})"
        case _:
            return "dl2c_hull_unknown()"
