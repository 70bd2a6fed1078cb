"""Initial states in C: tables of boxes, and the functions that complete and check a draw."""

from collections.abc import Sequence

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import function, row, table
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import index
from dl2c.emit.plan import Environment
from dl2c.ir.model import Model, Symbol
from dl2c.ir.printer import print_formula, print_term


def sampler_functions(environment: Environment, leaves: Leaves) -> list[str]:
    """`model_initial` and `model_accept`."""
    return [_initial(environment, leaves), _accept(environment, leaves)]


def _initial(environment: Environment, leaves: Leaves) -> str:
    model, plan = environment.model, environment.sampling
    body: list[str] = []
    if plan is not None:
        symbols = {s.name: s for s in _symbols(model)}
        body += [f"{_target(symbols[n])} = drawn[{k}];" for k, n in enumerate(plan.free)]
        body += [
            f"{_target(Symbol(v.name, 'variable'))} = 0.0;" for v in model.variables if v.initial == "zero"
        ]
        body += [
            f"{_target(Symbol(c.name, 'constant'))} = {number(float(c.value))};"
            for c in model.constants
            if c.value is not None
        ]
        for name, term in plan.definitions:
            value = leaves.term(f"initial_set_{name}", term, f"{name} = {print_term(term)}")
            body.append(f"{_target(symbols[name])} = {value};")
    return function(
        "static inline void model_initial(const real *drawn, real *x, real *p)",
        body,
        "The state that a draw stands for: free names as drawn, the others from them.",
    )


def _accept(environment: Environment, leaves: Leaves) -> str:
    plan = environment.sampling
    accepted = "false"
    if plan is not None:
        accepted = leaves.condition("initial_accepted", plan.acceptance, print_formula(plan.acceptance))
    return function(
        "static inline bool model_accept(const real *x, const real *p)",
        [f"return {accepted};"],
        "What is left of the precondition, with room for rounding: true in doubles proves it.",
    )


def sampler_tables(environment: Environment) -> list[str]:
    """Boxes and their alias table (Walker): box k is kept with its share, else its alias is taken."""
    plan = environment.sampling
    boxes = plan.boxes if plan is not None else ()
    lows = [row(number(v) for v in box.low) for box in boxes]
    highs = [row(number(v) for v in box.high) for box in boxes]
    share, alias = alias_table([box.weight for box in boxes])
    n, width = max(1, len(boxes)), max(1, len(plan.free) if plan is not None else 0)
    return [
        table("real", "SAMPLE_LOW", f"[{n}][{width}]", lows or ["{0.0}"]),
        table("real", "SAMPLE_HIGH", f"[{n}][{width}]", highs or ["{0.0}"]),
        table("real", "SAMPLE_SHARE", f"[{n}]", [number(s) for s in share] or ["1.0"]),
        table("int32_t", "SAMPLE_ALIAS", f"[{n}]", [str(a) for a in alias] or ["0"]),
    ]


def alias_table(weights: Sequence[float]) -> tuple[list[float], list[int]]:
    """Shares and aliases such that a uniform cell and one comparison draw by weight."""
    n = len(weights)
    total = sum(weights)
    scaled = [w * n / total for w in weights]
    share, alias = [1.0] * n, list(range(n))
    small = [k for k in range(n) if scaled[k] < 1.0]
    large = [k for k in range(n) if scaled[k] >= 1.0]
    while small and large:
        less, more = small.pop(), large[-1]
        share[less], alias[less] = scaled[less], more
        scaled[more] -= 1.0 - scaled[less]
        if scaled[more] < 1.0:
            small.append(large.pop())
    return share, alias


def _symbols(model: Model) -> list[Symbol]:
    return [Symbol(v.name, "variable") for v in model.variables] + [
        Symbol(c.name, "constant") for c in model.constants
    ]


def _target(symbol: Symbol) -> str:
    return f"{'x' if symbol.kind == 'variable' else 'p'}[{index(symbol)}]"
