"""The controller side of an exported monitor: KeYmaera X's names, runs of control paths, the fallback.

A run gives its inputs values that pass, executes its assignments, and is accepted by the same case of
the controller's check that judges everybody else. So the fallback satisfies the monitor by
construction, whatever is known of its tests.
"""

from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import TypeAlias

from dl2c.emit import names
from dl2c.emit.cfile import comment, function, place, wrapped
from dl2c.emit.leaf import Leaves, Place
from dl2c.emit.monitor.copied import copied_body
from dl2c.emit.monitor.monitor_h import Unit, declarations_of_controller
from dl2c.emit.monitor.values_c import search_functions
from dl2c.ir.logic import conjuncts, folded, symbols
from dl2c.ir.model import ONE, Div, Formula, Neg, Number, Symbol, Term
from dl2c.ir.printer import print_formula, print_term
from dl2c.monitor.check import Controller, Given, Kind, Run

CHECK: Kind = "controller"


Holds: TypeAlias = Callable[[str, Formula, str, Place], str]
"""Makes a function of a name and a condition, with a comment; an expression for its truth, where
symbols are read as the place says.
"""


def controller_functions(unit: Unit, leaves: Leaves, accepted: str, holds: Holds) -> list[str]:
    """All functions, in order. `accepted` compares what a case of the check returns with success: an
    expression in which `CASE` stands for its call. `holds` judges tests of inputs.
    """
    controller = unit.monitor.controller
    assert controller is not None
    runs: list[str] = []
    bounds = next(c.bounds for c in unit.monitor.checks if c.kind == CHECK)
    for run in controller.runs:
        for one in _chosen(run):
            runs += [_admits(unit, run, one, holds), _roots(unit, run, one, leaves)]
        case = f"{CHECK}_case({bounds[run.case]}, {bounds[run.case + 1]}, before, after, parameters)"
        runs.append(_run(unit, run, leaves, accepted.replace("CASE", case)))
    return [*_search(unit, controller), *runs, *_public(unit, controller)]


def _chosen(run: Run) -> tuple[Given, ...]:
    return tuple(g for g in run.given if g.input.role == "agent")


def _search(unit: Unit, controller: Controller) -> list[str]:
    """What finds values of inputs, where there are any."""
    chosen = [g for run in controller.runs for g in _chosen(run)]
    if not chosen:
        return []
    most = max(sum(len(c) - 1 for c in g.criticals) for g in chosen) + 2
    quadratic = any(len(c) == 3 for g in chosen for c in g.criticals)
    return [search_functions(unit.stem, most, unit.single, quadratic, unit.squash)]


def reading(unit: Unit, given: str, state: str = "before->", parameters: str = "parameters->") -> Place:
    """Where the value of a symbol is read; what is not a constant or variable before, in `given`."""
    fixed = {c.name: c.value for c in unit.monitor.model.constants if c.value is not None}

    def place_of(symbol: Symbol) -> str:
        match symbol.kind:
            case "variable":
                return f"{state}{names.member(symbol.name)}"
            case "constant" if symbol.name in fixed:
                return unit.literal(fixed[symbol.name])
            case "constant":
                return f"{parameters}{names.member(symbol.name)}"
            case _:
                return f"{given}{unit.field(symbol.name.removesuffix('_post'))}"

    return place_of


def _states(unit: Unit) -> str:
    return f"const {unit.stem}_state *before, const {unit.stem}_parameters *parameters"


def _stem(run: Run, one: Given, unit: Unit) -> str:
    return f"run{run.case}_{unit.field(one.input.key)}"


def _admits(unit: Unit, run: Run, one: Given, holds: Holds) -> str:
    """A function of the tests of an input, one after the other."""
    stem, read = _stem(run, one, unit), reading(unit, "given->")
    lines: list[str] = []
    for j, part in enumerate(conjuncts(one.admits)):
        about = f"{place(one.span)}  {print_formula(part)}"
        lines += [*wrapped(f"if (!({holds(f'{stem}_test{j}', part, about, read)}))"), "  return false;"]
    return function(
        f"static bool {stem}_admits({_states(unit)}, const {unit.stem}_input *given)",
        [*lines, "return true;"],
        f"{place(one.span)}  Whether the value of {one.input.variable} passes its tests.",
    )


def _roots(unit: Unit, run: Run, one: Given, leaves: Leaves) -> str:
    """A function that enters where the tests of an input may begin or cease to hold."""
    stem, read = _stem(run, one, unit), reading(unit, "s->given->")

    def through(symbol: Symbol) -> str:
        text = read(symbol)
        return f"s->{text}" if text.startswith(("before->", "parameters->")) else text

    lines: list[str] = []
    for j, coefficients in enumerate(one.criticals):
        if len(coefficients) == 2:
            values = [leaves.term(f"{stem}_root{j}", _zero(*coefficients), "A root.", through)]
        else:
            values = [
                leaves.term(
                    f"{stem}_c{j}_{k}", c, f"... + ({print_term(c)}) * {one.input.variable}^{k}", through
                )
                for k, c in enumerate(coefficients)
            ]
        lines += wrapped(f"{'enter' if len(values) == 1 else 'enter_roots'}(s, {', '.join(values)});")
    return function(
        f"static void {stem}_roots(search *s)",
        lines or ["(void)s;"],
        f"{place(one.span)}  Where that may change.",
    )


def _zero(offset: Term, slope: Term) -> Term:
    """Where `offset + slope * u` is zero."""
    if slope == Number(Fraction(-1)):
        return offset
    negative = folded(Neg(offset))
    return negative if slope == ONE else folded(Div(negative, slope))


def _run(unit: Unit, run: Run, leaves: Leaves, accepted: str) -> str:
    """Executes a control path; `accepted` is whether the check accepts that."""
    used = symbols(*(term for _, term in run.updates)) | symbols(*(g.admits for g in run.given))
    needs = any(s.kind == "input" for s in used) or bool(_chosen(run))
    lines = [f"{unit.stem}_input given = *input;"] if needs else []
    for one in _chosen(run):
        lines += _search_for(unit, run, one)
    lines.append("*after = *before;")
    read = reading(unit, "given.")
    for variable, term in run.updates:
        about = f"{place(run.span)}  {variable} := {print_term(term)}"
        value = leaves.term(f"run{run.case}_set_{variable}", term, about, read)
        lines += wrapped(f"after->{names.member(variable)} = {value};")
    head = f"static bool run{run.case}({_states(unit)}, const {unit.stem}_input *input, "
    return function(
        f"{head}{unit.stem}_state *after)",
        [*lines, *wrapped(f"return is_state(after) && {accepted};")],
        f"{place(run.span)}  {run.about}: what it leads to; false where it is not possible.",
    )


def _search_for(unit: Unit, run: Run, one: Given) -> list[str]:
    stem, field = _stem(run, one, unit), f"given.{unit.field(one.input.key)}"
    low, high = unit.inward(one.input.low, one.input.high)
    find = "spread" if unit.squash else "nearest"
    begin = f"before, parameters, &given, &{field}, {stem}_admits, 2, {{{low}, {high}}}"
    return [
        "{",
        *(f"  {line}" for line in wrapped(f"search s = {{{begin}}};")),
        f"  {stem}_roots(&s);",
        f"  {field} = {find}(&s, input->{unit.field(one.input.key)});",
        "}",
    ]


USABLE = "is_state(&curr) && are_parameters(params)"
PASSED = "&curr, params, input"


def _public(unit: Unit, controller: Controller) -> Iterable[str]:
    """The functions that the header declares, in its order."""
    stem = unit.stem
    heads = declarations_of_controller(unit)
    check = f"{stem}_check_{CHECK}(&pre, &curr, params)"
    yield function(heads["boundary_dist"], [f"return {check};"])
    yield function(heads["monitor_satisfied"], [f"return {check}.id == 0;"])
    yield function(heads["run"], [*_requested(unit, controller), "return false;"])
    yield function(
        heads["fallback"], [f"{stem}_state post = curr;", *_fallback(unit, controller), "return post;"]
    )
    yield function(heads["decide"], copied_body("decide.h", "MODEL_decide", {"MODEL": stem}))
    called = f"{stem}_decide(curr, params, input, ctrl, fallback)"
    yield function(heads["monitored_ctrl"], [f"return {called}.post;"])


def measured(unit: Unit, run: Run) -> list[str]:
    """That the environment took the alternatives of a run."""
    assert unit.monitor.controller is not None
    pairs = zip(unit.monitor.controller.measured, run.seen, strict=True)
    return [f"input->{unit.measured(d)} == {a}" for d, a in pairs if a >= 0]


def _requested(unit: Unit, controller: Controller) -> list[str]:
    lines = [f"if (!({USABLE}))", "  return false;"]
    for run in controller.runs:
        taken = [f"choices[{k}] == {a}" for k, a in enumerate(run.taken) if a >= 0]
        tried = " && ".join([*measured(unit, run), *taken, f"run{run.case}({PASSED}, post)"])
        lines += [*wrapped(f"if ({tried})"), "  return true;"]
    return lines


def _fallback(unit: Unit, controller: Controller) -> list[str]:
    tried: list[str] = []
    for k in controller.preferred:
        possible = " && ".join([*measured(unit, controller.runs[k]), f"run{k}({PASSED}, &post)"])
        tried += [*(f"  {line}" for line in wrapped(f"if ({possible})")), "    return post;"]
    return [
        f"if ({USABLE}) {{",
        *tried,
        "}",
        comment("Nothing is possible: what the first alternative would do."),
        f"(void)run{controller.preferred[0]}({PASSED}, &post);",
    ]
