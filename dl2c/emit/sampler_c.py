"""Initial states in C: tables of boxes, and the functions that complete and check a draw."""

from collections.abc import Sequence

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import function, row, table
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import index
from dl2c.emit.plan import Environment
from dl2c.ir.model import Model, Symbol
from dl2c.ir.printer import print_formula, print_term
from dl2c.sampling.plan import SampleChart, SamplingPlan

MOST_TEXT = 2000
"""Characters of a test that is shown as a comment too."""


def sampler_functions(environment: Environment, leaves: Leaves) -> list[str]:
    """`model_initial`, `model_density` and `model_accept`."""
    plan = environment.sampling
    charts = () if plan is None else plan.charts
    return [
        _by_chart(
            "void model_initial(int chart, const real *drawn, real *x, real *p)",
            [_initial(environment.model, c, leaves, _suffix(k, charts)) for k, c in enumerate(charts)],
            "The state that a draw stands for: free names as drawn, the others from them.",
        ),
        _by_chart(
            "real model_density(int chart, const real *x, const real *p)",
            [[_density(c, leaves, _suffix(k, charts))] for k, c in enumerate(charts)],
            "The square of how much of the initial states a unit of drawn volume stands for.",
            "return 1.0;",
        ),
        _by_chart(
            "bool model_accept(int chart, const real *x, const real *p)",
            [[_accepted(c, leaves, _suffix(k, charts))] for k, c in enumerate(charts)],
            "What is left of the precondition, with room for rounding: true in doubles proves it.",
            "return false;",
        ),
    ]


def _suffix(k: int, charts: Sequence[SampleChart]) -> str:
    return f"_{k}" if len(charts) > 1 else ""


def _by_chart(head: str, bodies: Sequence[Sequence[str]], about: str, otherwise: str = "") -> str:
    """A function that does something else for each chart."""
    if len(bodies) == 1:
        return function(f"static inline {head}", ["(void)chart;", *bodies[0]], about)
    lines = ["switch (chart) {"]
    for k, body in enumerate(bodies):
        leaves = body[-1:] != [] and body[-1].startswith("return")
        lines += [f"case {k}:", *(f"  {line}" for line in body), *([] if leaves else ["  break;"])]
    last = f"default: {otherwise}" if otherwise else "default: break;"
    return function(f"static inline {head}", [*lines, last, "}"], about)


def _initial(model: Model, chart: SampleChart, leaves: Leaves, suffix: str) -> list[str]:
    symbols = {s.name: s for s in _symbols(model)}
    body = [f"{_target(symbols[n])} = drawn[{k}];" for k, n in enumerate(chart.free)]
    body += [f"{_target(Symbol(v.name, 'variable'))} = 0.0;" for v in model.variables if v.initial == "zero"]
    body += [
        f"{_target(Symbol(c.name, 'constant'))} = {number(float(c.value))};"
        for c in model.constants
        if c.value is not None
    ]
    for name, term in chart.definitions:
        value = leaves.term(f"initial_set_{name}{suffix}", term, f"{name} = {print_term(term)}")
        body.append(f"{_target(symbols[name])} = {value};")
    return body


def _density(chart: SampleChart, leaves: Leaves, suffix: str) -> str:
    about = "Where equalities bend the set of initial states."
    return f"return {leaves.term(f'initial_density{suffix}', chart.squared_density, about)};"


def _accepted(chart: SampleChart, leaves: Leaves, suffix: str) -> str:
    printed = print_formula(chart.acceptance)
    about = printed if len(printed) <= MOST_TEXT else "The precondition, with room for rounding."
    return f"return {leaves.condition(f'initial_accepted{suffix}', chart.acceptance, about)};"


def sampler_tables(environment: Environment) -> list[str]:
    """Boxes and their alias table (Walker): box k is kept with its share, else its alias is taken."""
    plan = environment.sampling
    boxes = plan.boxes if plan is not None else ()
    n, width = max(1, len(boxes)), free_names(plan)
    lows = [row(number(v) for v in _padded(box.low, width)) for box in boxes]
    highs = [row(number(v) for v in _padded(box.high, width)) for box in boxes]
    share, alias = alias_table([box.weight for box in boxes])
    charts = [str(box.chart) for box in boxes] if plan is not None and len(plan.charts) > 1 else ["0"]
    largest = (
        [number(box.squared_density) for box in boxes] if plan is not None and plan.weighted else ["1.0"]
    )
    return [
        table("real", "SAMPLE_LOW", f"[{n}][{max(1, width)}]", lows or ["{0.0}"]),
        table("real", "SAMPLE_HIGH", f"[{n}][{max(1, width)}]", highs or ["{0.0}"]),
        table("real", "SAMPLE_SHARE", f"[{n}]", [number(s) for s in share] or ["1.0"]),
        table("int32_t", "SAMPLE_ALIAS", f"[{n}]", [str(a) for a in alias] or ["0"]),
        table("int32_t", "SAMPLE_CHART", f"[{len(charts)}]", charts),
        table("real", "SAMPLE_DENSITY", f"[{len(largest)}]", largest),
    ]


def free_names(plan: SamplingPlan | None) -> int:
    """How many names a draw has at most."""
    return max((len(c.free) for c in plan.charts), default=0) if plan is not None else 0


def _padded(values: Sequence[float], width: int) -> list[float]:
    return [*values, *[0.0] * (width - len(values))]


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
