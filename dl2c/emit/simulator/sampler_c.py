"""Initial states in C: tables of boxes, and the functions that complete and check a draw."""

from collections.abc import Callable, Sequence

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import function, row, table
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import index, slot
from dl2c.emit.plan import BuildPlan
from dl2c.ir.model import Model, Symbol
from dl2c.ir.printer import print_formula, print_term
from dl2c.sampling.equalities.root_of import RootOf
from dl2c.sampling.tables import SampleChart, SamplingPlan

MOST_TEXT = 2000
"""Characters of a test that is shown as a comment too."""


def sampler_functions(build: BuildPlan, leaves: Leaves) -> list[str]:
    """`model_initial`, `model_density` and `model_accept`."""
    plan = build.sampling
    charts = () if plan is None else plan.charts
    return [
        _by_chart(
            "void model_initial(int chart, const real *drawn, real *x, real *p)",
            [_initial(build, c, leaves, _suffix(k, charts)) for k, c in enumerate(charts)],
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
            "What is left of the precondition, with a margin for rounding: true in doubles proves it.",
            "return false;",
        ),
    ]


def _suffix(k: int, charts: Sequence[SampleChart]) -> str:
    return f"_{k}" if len(charts) > 1 else ""


def _by_chart(head: str, bodies: Sequence[Sequence[str]], about: str, otherwise: str = "") -> str:
    """A function that does something else for each chart."""
    if bodies and all(body == bodies[0] for body in bodies):
        return function(f"static inline {head}", ["(void)chart;", *bodies[0]], about)
    lines = ["switch (chart) {"]
    for k, body in enumerate(bodies):
        leaves = body[-1:] != [] and body[-1].startswith("return")
        lines += [f"case {k}:", *(f"  {line}" for line in body), *([] if leaves else ["  break;"])]
    last = f"default: {otherwise}" if otherwise else "default: break;"
    return function(f"static inline {head}", [*lines, last, "}"], about)


def _initial(build: BuildPlan, chart: SampleChart, leaves: Leaves, suffix: str) -> list[str]:
    """What is fixed is set with the first block."""
    model, plan = build.model, build.sampling
    symbols = {s.name: s for s in _symbols(model)}
    drawn = {n: _rounded(f"drawn[{k}]", chart.grid.get(n)) for k, n in enumerate(chart.free)}
    body = [f"{_target(symbols[n])} = {value};" for n, value in drawn.items() if n in symbols]
    if plan is not None and chart in plan.blocks[0].charts:
        body += _fixed(model)
    parts = {n: value for n, value in drawn.items() if n not in symbols}

    def place(symbol: Symbol) -> str:
        return parts.get(symbol.name) or slot(symbol)

    for name, definition in (*chart.between, *chart.definitions):
        if isinstance(definition, RootOf):
            value = _root_of(name, definition, leaves, suffix, place)
        else:
            about = f"{name} = {print_term(definition)}"
            value = leaves.term(f"initial_set_{name}{suffix}", definition, about, place)
        body.append(f"{_target(symbols[name])} = {value};")
    return body


def _root_of(name: str, root: RootOf, leaves: Leaves, suffix: str, place: Callable[[Symbol], str]) -> str:
    """The call that looks for it."""
    row = ", ".join(
        leaves.term(f"initial_{name}_{k}{suffix}", c, f"Of {name}^{k}: {print_term(c)}", place)
        for k, c in enumerate(root.coefficients)
    )
    limits = f"{number(root.low)}, {number(root.high)}"
    degree = len(root.coefficients) - 1
    return f"dl2c_root_of((const real[]){{{row}}}, {degree}, {limits}, {root.number})"


def _rounded(value: str, far: float | None) -> str:
    """To the grid on which what follows is exact."""
    return value if far is None else f"({value} + {number(far)}) - {number(far)}"


def _fixed(model: Model) -> list[str]:
    zeros = [Symbol(v.name, "variable") for v in model.variables if v.initial == "zero"]
    given = [(Symbol(c.name, "constant"), c.value) for c in model.constants if c.value is not None]
    return [
        *(f"{_target(s)} = 0.0;" for s in zeros),
        *(f"{_target(s)} = {number(float(value))};" for s, value in given),
    ]


def _density(chart: SampleChart, leaves: Leaves, suffix: str) -> str:
    about = "Where equalities bend the set of initial states."
    return f"return {leaves.term(f'initial_density{suffix}', chart.squared_density, about)};"


def _accepted(chart: SampleChart, leaves: Leaves, suffix: str) -> str:
    printed = print_formula(chart.acceptance)
    about = printed if len(printed) <= MOST_TEXT else "The precondition, with a margin for rounding."
    return f"return {leaves.condition(f'initial_accepted{suffix}', chart.acceptance, about)};"


def sampler_tables(build: BuildPlan) -> list[str]:
    """Boxes of all blocks, and their alias tables (Walker): box k is kept with its share, else its alias
    is taken."""
    plan = build.sampling
    blocks = plan.blocks if plan is not None else ()
    boxes = [box for block in blocks for box in block.boxes]
    n, width = max(1, len(boxes)), free_names(plan)
    lows = [row(number(v) for v in _padded(box.low, width)) for box in boxes]
    highs = [row(number(v) for v in _padded(box.high, width)) for box in boxes]
    starts = [0]
    charts: list[str] = []
    share: list[str] = []
    alias: list[str] = []
    first_chart = 0
    for block in blocks:
        shares, others = alias_table([box.weight for box in block.boxes])
        share += [number(s) for s in shares]
        alias += [str(starts[-1] + k) for k in others]
        charts += [str(first_chart + box.chart) for box in block.boxes]
        starts.append(starts[-1] + len(block.boxes))
        first_chart += len(block.charts)
    several = first_chart > 1
    largest = (
        [number(box.squared_density) for box in boxes] if plan is not None and plan.weighted else ["1.0"]
    )
    return [
        table("int32_t", "SAMPLE_START", f"[{len(starts)}]", [str(s) for s in starts]),
        table("real", "SAMPLE_LOW", f"[{n}][{max(1, width)}]", lows or ["{0.0}"]),
        table("real", "SAMPLE_HIGH", f"[{n}][{max(1, width)}]", highs or ["{0.0}"]),
        table("real", "SAMPLE_SHARE", f"[{n}]", share or ["1.0"]),
        table("int64_t", "SAMPLE_ALIAS", f"[{n}]", alias or ["0"]),
        table("int32_t", "SAMPLE_CHART", f"[{n if several else 1}]", charts if several else ["0"]),
        table("int32_t", "SAMPLE_FREE", f"[{max(1, first_chart)}]", _counts(plan)),
        table("real", "SAMPLE_DENSITY", f"[{len(largest)}]", largest),
    ]


def _counts(plan: SamplingPlan | None) -> list[str]:
    """How many names each chart draws."""
    return ["0"] if plan is None else [str(len(c.free)) for c in plan.charts]


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
