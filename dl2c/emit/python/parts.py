"""The functions of a model in plain Python: start, precondition, motion, control paths.

Each has the dL text that it stands for in its docstring. They take the state `s`, an object with one
attribute for each variable and constant.
"""

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction

from dl2c.emit.cfile import place
from dl2c.emit.names import python_attribute
from dl2c.emit.plan import BuildPlan
from dl2c.emit.python.expr import SUM, WIDTH, Bracketed, Expression, Named, Writer, flat, statement
from dl2c.emit.python.text import clean
from dl2c.flows.kernel import FlowPlan, constant_along
from dl2c.flows.watch import watches_of
from dl2c.ir.logic import conjuncts
from dl2c.ir.margins import margins_of, smooth
from dl2c.ir.model import ONE, TRUE, Add, Compare, Formula, Model, Mul, Number, Symbol, Term
from dl2c.ir.printer import print_flow
from dl2c.ir.slack import equalities_relaxed
from dl2c.paths.admission import Admission
from dl2c.paths.path import Input, Path
from dl2c.sampling.equalities.root_of import RootOf


def function(head: str, about: str, body: Iterable[str]) -> str:
    """A function; body lines are indented already."""
    return "\n".join([head, *docstring(about), *body]) + "\n"


def docstring(about: str, indent: int = 4) -> list[str]:
    """A docstring, wrapped."""
    margin = " " * indent
    text = clean(about)
    lines = textwrap.wrap(
        text + "." * text.endswith('"'), WIDTH - indent - 3, break_long_words=False, break_on_hyphens=False
    )
    if len(lines) == 1:
        return [f'{margin}"""{lines[0]}"""']
    return [f'{margin}"""{lines[0]}', *(f"{margin}{line}" for line in lines[1:]), f'{margin}"""']


def replaced(changes: Iterable[tuple[str, Expression]]) -> Expression:
    """The state with changes; itself where there is none."""
    named = tuple(Named(f"{python_attribute(name)}=", value) for name, value in changes)
    return Bracketed("replace", ("s", *named)) if named else "s"


def number(value: Fraction | float) -> str:
    """A float, also where it is whole."""
    return repr(float(value))


def value(writer: Writer, term: Term) -> Expression:
    """What is assigned: whole numbers as floats."""
    return number(term.value) if isinstance(term, Number) else writer.term(term)


def returned(expression: Expression) -> list[str]:
    return statement("return ", expression, "", 4)


def condition(name: str, about: str, formula: Formula, writer: Writer) -> str:
    """A function that says whether a formula holds."""
    return function(f"def {name}(s: State) -> bool:", about, returned(writer.formula(formula)))


# The start --------------------------------------------------------------------


def start_function(build: BuildPlan, writer: Writer) -> str:
    """Draws names in their boxes; the caller looks whether the precondition holds."""
    plan = build.sampling
    assert plan is not None
    drawn: list[Expression] = []
    defined: list[tuple[str, Expression]] = []
    for block in plan.blocks:
        (chart,) = block.charts
        for k, name in enumerate(chart.free):
            low, high = min(b.low[k] for b in block.boxes), max(b.high[k] for b in block.boxes)
            limits = (number(_plain(low)), number(_plain(high)))
            drawn.append(Named(f"{python_attribute(name)}=", Bracketed("rng.uniform", limits)))
        defined += [(n, value(writer, t)) for n, t in chart.definitions if not isinstance(t, RootOf)]
    body = statement("s = ", Bracketed("State", tuple(drawn)), "", 4) + returned(replaced(defined))
    if not defined:
        body = returned(Bracketed("State", tuple(drawn)))
    about = "A state to begin in, if the precondition holds there; else another one is drawn."
    return function("def initial_state(rng: np.random.Generator) -> State:", about, body)


def _plain(limit: float) -> float:
    """A bound that was rounded inward by one bit, as it was written."""
    near = float(f"{limit:.12g}")
    return near if abs(near - limit) <= 1e-15 * abs(limit) else limit


def precondition_function(build: BuildPlan, writer: Writer) -> str:
    """P; equalities within the tolerance where drawn states are rounded."""
    formula = build.model.precondition
    plan = build.sampling
    if plan is None or plan.certificate == "witness" or any(c.grid for c in plan.charts):
        formula = equalities_relaxed(formula, build.options.tolerance)
    return condition("precondition", "What the proof assumes of initial states.", formula, writer)


# Motion -----------------------------------------------------------------------


def plain_margins(model: Model, plan: FlowPlan) -> tuple[Term, ...]:
    """Terms that are zero where the domain, or a condition watched along the flow, changes."""

    def moves(term: Term) -> bool:
        return not constant_along(term, plan.flow)

    conditions = [plan.flow.watched]
    for watch in watches_of(model):
        predicate = model.predicates[watch.predicate]
        conditions += [predicate.formula, predicate.due or TRUE]
    return tuple(m for m in margins_of([smooth(c, moves) for c in conditions]) if moves(m))


def flow_functions(build: BuildPlan, k: int, writer: Writer) -> Iterator[str]:
    """Domain, margins and motion of flow k, and its entry for the paths."""
    plan = build.flows[k]
    margins = plain_margins(build.model, plan)
    about = "Where the motion may go on, but for its clocks."
    yield condition(f"domain_{k}", about, plan.flow.watched, writer)
    terms = Bracketed("", tuple(writer.term(m) for m in margins), "[]")
    about = "Zero where the domain, or what is watched on the way, may change."
    yield function(f"def margins_{k}(s: State) -> list[Any]:", about, returned(terms))
    if plan.solution is None:
        rates = Bracketed("", tuple(value(writer, rate) for _, rate in plan.flow.equations), "[]")
        about = "How fast the variables of the differential equation change."
        yield function(f"def rates_{k}(s: State) -> list[float]:", about, returned(rates))
    yield _motion(plan, k, margins, writer)
    yield _flow_entry(plan, k, writer)


def _motion(plan: FlowPlan, k: int, margins: Sequence[Term], writer: Writer) -> str:
    flow = plan.flow
    limits: list[Expression] = []
    clocks: list[Expression] = []
    for horizon in flow.horizons:
        left = writer.binary(SUM, "-", horizon.bound, Symbol(horizon.clock, "variable"))
        limits.append(left)
        entry = Bracketed("", (left, value(writer, horizon.bound)))
        clocks.append(Named(f'"{python_attribute(horizon.clock)}": ', entry))
    if flow.cap is not None:
        limits.append(number(flow.cap))
    until = limits[0] if len(limits) == 1 else Bracketed("min", tuple(limits))
    lines = statement("until = ", until, "", 4)
    lines += statement("clocks = ", Bracketed("", tuple(clocks), "{}"), "", 4)
    lines += _numeric(plan, k) if plan.solution is None else _exact(plan, k, margins, writer)
    about = f"{place(flow.span)}  {print_flow(flow)}"
    return function(f"def motion_{k}(s: State) -> Motion:", about, lines)


def _exact(plan: FlowPlan, k: int, margins: Sequence[Term], writer: Writer) -> list[str]:
    """Polynomials of time."""
    assert plan.solution is not None
    curves = [(x, c) for x, c in plan.solution.variables.items() if len(c) > 1]
    times = f"event_times(margins_{k}(moving), until)"
    if any(plan.solution.compose(m) is None for m in margins):
        times = f"sampled_times(at, margins_{k}, np.linspace(0.0, until, 65))"
    lines = [
        "",
        "    def at(tau: Any) -> State:",
        *statement("return ", replaced((x, writer.term(_horner(c))) for x, c in curves), "", 8),
        "",
        f"    return Motion(until, at, {times}, clocks)",
    ]
    if "moving" in times:
        lines[-1:-1] = ["    moving = at(Polynomial(0.0, 1.0))  # polynomials of time"]
    return lines


def _horner(coefficients: Sequence[Term]) -> Term:
    """The value of a polynomial at the time tau."""
    found = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        found = Add(Mul(found, Symbol("tau", "time")) if found != ONE else Symbol("tau", "time"), c)
    return found


def _numeric(plan: FlowPlan, k: int) -> list[str]:
    names = Bracketed("", tuple(f'"{python_attribute(x)}"' for x, _ in plan.flow.equations), "[]")
    return [
        *statement("names = ", names, "", 4),
        f"    return integrated(s, names, rates_{k}, margins_{k}, until, clocks)",
    ]


def _flow_entry(plan: FlowPlan, k: int, writer: Writer) -> str:
    """The flow with its non-strict bounds, at which variables are set to exactly these."""
    bounds: list[Expression] = []
    for atom, name, target in _bounds(plan):
        kept = f"lambda s: {flat(writer.formula(atom))}"
        ends = f"lambda s: {flat(value(writer, target))}"
        bounds.append(Bracketed("", (f'"{python_attribute(name)}"', kept, ends)))
    listed = Bracketed("", tuple(bounds), "[]")
    return (
        "\n".join(statement(f"FLOW_{k} = ", Bracketed("Flow", (f"motion_{k}", f"domain_{k}", listed)))) + "\n"
    )


def _bounds(plan: FlowPlan) -> Iterator[tuple[Compare, str, Term]]:
    """Conjuncts `x >= c` and `x <= c` of the domain, with c constant along the flow (semantics 4)."""
    rates = dict(plan.flow.equations)
    for atom in conjuncts(plan.flow.watched):
        if isinstance(atom, Compare) and atom.op in ("<=", ">="):
            for side, other in ((atom.left, atom.right), (atom.right, atom.left)):
                if isinstance(side, Symbol) and side.name in rates and constant_along(other, plan.flow):
                    yield atom, side.name, other


# Control paths ----------------------------------------------------------------


def path_function(build: BuildPlan, k: int, writer: Writer) -> str:
    """Tests, inputs and assignments of a path."""
    path = build.paths.paths[k]
    guard = writer.formula(path.guard)
    lines: list[str] = []
    if path.guard != TRUE:
        lines += statement("if not ", _parenthesised(guard), ":", 4) + ["        return None"]
    for admission in path.admissions:
        lines += _input(build.paths.inputs[admission.input], admission, writer)
    lines += returned(replaced((name, value(writer, term)) for name, term in path.updates))
    head = f"def path_{k}(s: State, inputs: dict[str, float]) -> State | None:"
    return function(head, _about(build, path), lines)


def _parenthesised(guard: Expression) -> Expression:
    simple = isinstance(guard, Bracketed) or len(flat(guard).split(" and ")) == 1 == len(
        flat(guard).split(" or ")
    )
    return guard if simple else Bracketed("", (guard,))


def _about(build: BuildPlan, path: Path) -> str:
    decisions = build.paths.decisions
    taken = [
        f"{d.key} = {k}: {d.alternatives[k]}"
        for d, k in zip(decisions, path.decisions, strict=True)
        if k >= 0
    ]
    return "; ".join(taken) or f"One run of the loop's body. ({place(path.span)})"


def _input(given: Input, admission: Admission, writer: Writer) -> list[str]:
    """The value of an input: the nearest to the one wanted that passes its tests."""
    key = given.key
    polynomials = [(m.offset, m.slope) for m in admission.limits] + list(admission.criticals)
    criticals = Bracketed("", tuple(Bracketed("", tuple(map(writer.term, c))) for c in polynomials), "[]")
    arguments = (f'inputs["{key}"]', number(given.low), number(given.high), f"passes_{key}", "criticals")
    return [
        "",
        f"    def passes_{key}({key}: float) -> bool:",
        *statement("return ", writer.formula(admission.condition), "", 8),
        "",
        *statement("criticals = ", criticals, "", 4),
        *statement(f"{key} = ", Bracketed("nearest", arguments), "", 4),
        f"    if {key} is None:",
        "        return None",
        f'    inputs["{key}"] = {key}',
    ]


def path_table(build: BuildPlan) -> str:
    """All paths, as the environment tries them."""
    keys = [d.key for d in build.paths.decisions]
    rows: list[Expression] = []
    for k, path in enumerate(build.paths.paths):
        taken = tuple(f'"{keys[d]}": {path.decisions[d]}' for d in path.met)
        marked = tuple(f'"{keys[d]}"' for d, m in zip(path.met, path.marks, strict=True) if m)
        flow = "None" if path.flow is None else f"FLOW_{path.flow}"
        rows.append(
            Bracketed("Path", (f"path_{k}", Bracketed("", taken, "{}"), Bracketed("", marked, "[]"), flow))
        )
    return "\n".join(statement("PATHS = ", Bracketed("", tuple(rows), "[]"))) + "\n"
