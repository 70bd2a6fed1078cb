"""An exported monitor as one C file that needs nothing of the runtime.

Leaf functions are those of the simulator: the same printer, the same order of operations. Each case
is a function that returns the first of its conditions that does not hold; a check reports the
condition of the case that came closest, or the room that the satisfied case with most of it leaves.
"""

import re
from collections.abc import Callable, Iterator
from fractions import Fraction

from dl2c.emit import names
from dl2c.emit.cfile import function, place, wrapped
from dl2c.emit.control_c import controller_functions
from dl2c.emit.leaf import Leaves, Place
from dl2c.emit.monitor_h import Unit, head, title_of
from dl2c.interval.arithmetic import Interval, enclosure
from dl2c.ir.logic import delta
from dl2c.ir.model import Bound, Symbol
from dl2c.monitor.check import OUT_OF_RANGE, Case, Check, Condition, after
from dl2c.symbolic.terms import Builder

LARGEST_SINGLE = 3.4e38

RUNTIME = {
    "dl2c_min": "static inline real dl2c_min(real a, real b) { return a < b ? a : b; }\n",
    "dl2c_max": "static inline real dl2c_max(real a, real b) { return a > b ? a : b; }\n",
}
"""What leaf functions use of the runtime, as it is there."""


def monitor_c(unit: Unit) -> str:
    """The whole file."""
    leaves = Leaves(builder_of(unit), order_of(unit), unit.single)
    functions: list[str] = []
    for check in unit.monitor.checks:
        functions += [_case(unit, check, k, case, leaves) for k, case in enumerate(check.cases)]
        functions += [_margin(unit, check, leaves), *_nearest(unit, check), _check(unit, check)]
    if unit.monitor.controller is not None:
        functions += controller_functions(unit, leaves, "CASE == 0", leaves.condition)
    body = "\n".join([*leaves.texts, in_range(unit), *functions])
    used = [text for name, text in RUNTIME.items() if re.search(rf"\b{name}\b", body)]
    smallest = "FLT_MIN" if unit.single else "DBL_MIN"
    return "\n".join(
        [
            f'{title_of(unit)}\n#include "{unit.stem}_monitor.h"\n',
            "#include <float.h>\n#include <math.h>\n",
            f"#define DL2C_SMALLEST {smallest}\n",
            f"typedef {unit.real} real;\n",
            *used,
            body,
        ]
    )


def builder_of(unit: Unit) -> Builder:
    """Conditions of definedness are left out where the range of all numbers proves them."""
    if unit.single:
        limit = float(unit.largest)
        return Builder({}, Interval(-limit, limit), LARGEST_SINGLE)
    constants = unit.monitor.model.constants
    return Builder({Symbol(c.name, "constant"): _enclosed(unit, c.bound, c.value) for c in constants})


def _enclosed(unit: Unit, bound: Bound, value: Fraction | None) -> Interval:
    if value is not None:
        return enclosure(value)
    low = -unit.largest if bound.low is None else bound.low
    high = unit.largest if bound.high is None else bound.high
    return Interval(enclosure(low).low, enclosure(high).high)


def order_of(unit: Unit) -> Callable[[Symbol], int]:
    """Parameters of leaf functions come in this order."""
    model = unit.monitor.model
    ranks = [Symbol(v.name, "variable") for v in model.variables]
    ranks += [after(v.name) for v in model.variables]
    if unit.monitor.controller is not None:
        ranks += [i.symbol for i in unit.monitor.controller.inputs]
    ranks += [Symbol(c.name, "constant") for c in model.constants]
    return ranks.index


def places(unit: Unit, check: Check) -> Place:
    """Where a check reads the value of a symbol."""
    before = "before" if check.transition else "state"
    fixed = {c.name: c.value for c in unit.monitor.model.constants if c.value is not None}

    def place_of(symbol: Symbol) -> str:
        match symbol.kind:
            case "variable":
                return f"{before}->{names.member(symbol.name)}"
            case "constant" if symbol.name in fixed:
                return unit.literal(fixed[symbol.name])
            case "constant":
                return f"parameters->{names.member(symbol.name)}"
            case _:
                return f"after->{names.member(symbol.name.removesuffix('_post'))}"

    return place_of


def arguments(unit: Unit, check: Check) -> str:
    """The parameters of a check, as in its head."""
    return head(unit, check).split("(", 1)[1]


def passed(check: Check) -> str:
    return "before, after, parameters" if check.transition else "state, parameters"


def _case(unit: Unit, check: Check, k: int, case: Case, leaves: Leaves) -> str:
    body: list[str] = []
    for condition in case.conditions:
        holds = _condition(unit, check, condition, leaves)
        body += [*wrapped(f"if (!{grouped(holds)})"), f"  return {condition.number};"]
    return function(
        f"static int {check.kind}_case{k}({arguments(unit, check)}",
        [*body, "return 0;"],
        f"{check.kind}, {case.about}: the first condition that does not hold.",
    )


def _condition(unit: Unit, check: Check, condition: Condition, leaves: Leaves) -> str:
    """Conditions that are the same formula are one function, named by the first of them."""
    about = f"{place(condition.span)}  {condition.about}".strip()
    name = f"condition_n{condition.first}"
    return leaves.condition(name, condition.formula, about, places(unit, check))


def grouped(text: str) -> str:
    """An expression that a prefix can stand before."""
    return text if re.fullmatch(r"[\w.]+(->\w+)?(\([^()]*\))?", text) else f"({text})"


def _margin(unit: Unit, check: Check, leaves: Leaves) -> str:
    """How far a state is from satisfying a condition."""
    body: list[str] = []
    for case in check.cases:
        for condition in case.conditions:
            term = delta(condition.formula)
            if term is None:
                continue
            first = condition.first
            name, about = f"margin_n{first}", f"The margin of condition {first}."
            value = leaves.term(name, term, about, places(unit, check))
            body += [f"case {condition.number}:", *wrapped(f"  return {value};")]
    return function(
        f"static real {check.kind}_margin(int id, {arguments(unit, check)}",
        [*(["switch (id) {", *(f"  {b}" for b in body), "  default:", "    break;", "}"] if body else []),
         "return -DL2C_SMALLEST;"],
        "The margin of a condition, negative where it is violated.",
    )  # fmt: skip


def _nearest(unit: Unit, check: Check) -> Iterator[str]:
    """For each case, how far a state that satisfies it is from violating an inequality of it."""
    for k, case in enumerate(check.cases):
        near = [c.number for c in case.conditions if c.gradual and delta(c.formula) is not None]
        lines = [f"real least = {unit.literal(unit.largest)};"]
        for condition in near:
            value = f"{check.kind}_margin({condition}, {passed(check)})"
            lines += [f"least = dl2c_min({value}, least);"]
        yield function(
            f"static real {check.kind}_room{k}({arguments(unit, check)}",
            [*lines, "return least > 0 ? least : 0;"],
            "How much room the case leaves.",
        )


def _check(unit: Unit, check: Check) -> str:
    """A check, as the header declares it."""
    states = ("before", "after") if check.transition else ("state",)
    usable = " && ".join([*(f"is_state({s})" for s in states), "are_parameters(parameters)"])
    lines = [
        f"{unit.stem}_verdict verdict = {{{OUT_OF_RANGE}, -DL2C_SMALLEST}};",
        f"if (!({usable}))",
        "  return verdict;",
        *(["int closest = -1;"] if any(case.conditions for case in check.cases) else []),
    ]
    for k, case in enumerate(check.cases):
        first = case.conditions[0].number if case.conditions else 0
        lines += [
            f"const int case{k} = {check.kind}_case{k}({passed(check)});",
            f"if (case{k} == 0) {{",
            f"  const real room = {check.kind}_room{k}({passed(check)});",
            "  verdict.val = verdict.id == 0 ? dl2c_max(room, verdict.val) : room;",
            "  verdict.id = 0;",
            "}",
        ]
        if case.conditions:
            lines += [
                f"if (verdict.id != 0 && case{k} - {first} > closest) {{",
                f"  closest = case{k} - {first};",
                f"  verdict.id = case{k};",
                "}",
            ]
    lines += [
        "if (verdict.id == 0)",
        "  return verdict;",
        f"const real margin = {check.kind}_margin(verdict.id, {passed(check)});",
        "if (margin < verdict.val)",
        "  verdict.val = margin;",
        "return verdict;",
    ]
    return function(head(unit, check), lines)


def in_range(unit: Unit) -> str:
    """The conditions under which numbers may be used at all; every comparison is false for a NaN."""
    model = unit.monitor.model
    limit = unit.literal(unit.largest)
    inside = [_bounded(f"state->{names.member(v.name)}", f"-{limit}", limit) for v in model.variables]
    allowed = [
        _bounded(
            f"parameters->{names.member(c.name)}",
            f"-{limit}" if c.bound.low is None else unit.literal(c.bound.low),
            limit if c.bound.high is None else unit.literal(c.bound.high),
        )
        for c in unit.parameters
    ]
    checks = (("is_state", "state", inside), ("are_parameters", "parameters", allowed))
    texts: list[str] = []
    for name, kind, parts in checks:
        condition = " & ".join(parts or ["true"])
        signature = f"static bool {name}(const {unit.stem}_{kind} *{kind})"
        texts.append(function(signature, wrapped(f"return {condition};")))
    return "\n".join(texts)


def _bounded(value: str, low: str, high: str) -> str:
    return f"({low} <= {value}) & ({value} <= {high})"
