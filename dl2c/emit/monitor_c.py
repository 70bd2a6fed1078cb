"""An exported monitor as one C file that needs nothing of the runtime.

Leaf functions are those of the simulator: the same printer, the same order of operations. Each case
is a function that returns the first of its conditions that does not hold; a check reports the
condition of the case that came closest, or the room that the satisfied case with most of it leaves.
"""

import re
import struct
from collections.abc import Callable
from fractions import Fraction

from dl2c.emit import names
from dl2c.emit.cfile import function, place, wrapped
from dl2c.emit.control_c import controller_functions, reading
from dl2c.emit.leaf import Leaves, Place
from dl2c.emit.monitor_h import Unit, head, title_of
from dl2c.interval.arithmetic import Interval, enclosure
from dl2c.ir.logic import delta
from dl2c.ir.model import UNBOUNDED, Bound, Symbol
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
        functions += [_margin(unit, check, leaves), *_room(unit, check), *_choice(unit, check)]
        functions.append(_check(unit, check))
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
    """Conditions of definedness are left out where the ranges of all numbers prove them."""
    constants = unit.monitor.model.constants
    ranges = {Symbol(c.name, "constant"): _enclosed(unit, c.bound, c.value) for c in constants}
    if unit.single:
        limit = float(unit.largest)
        return Builder(ranges, Interval(-limit, limit), LARGEST_SINGLE)
    return Builder(ranges)


def _enclosed(unit: Unit, bound: Bound, value: Fraction | None) -> Interval:
    """What a constant is limited to, as the code has these limits."""
    ends = _limits(unit, bound) if value is None else (value, value)
    around = [_single(end) if unit.single else enclosure(end) for end in ends]
    return Interval(around[0].low, around[1].high)


def _limits(unit: Unit, bound: Bound) -> tuple[Fraction, Fraction]:
    """A range, no wider than that of all numbers."""
    low = -unit.largest if bound.low is None else max(bound.low, -unit.largest)
    return low, unit.largest if bound.high is None else min(bound.high, unit.largest)


def _single(value: Fraction) -> Interval:
    """The nearest float."""
    (nearest,) = struct.unpack("f", struct.pack("f", float(value)))
    return Interval(nearest, nearest)


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
    return reading(unit, "after->", "before->" if check.transition else "state->")


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
    values: dict[int, str] = {}
    numbers: dict[int, list[int]] = {}
    for condition in (c for case in check.cases for c in case.conditions):
        term = delta(condition.formula)
        if term is None:
            continue
        first = condition.first
        about = f"The margin of condition {first}."
        values[first] = leaves.term(f"margin_n{first}", term, about, places(unit, check))
        numbers.setdefault(first, []).append(condition.number)
    body: list[str] = []
    for first, value in values.items():
        body += [*(f"case {n}:" for n in numbers[first]), *wrapped(f"  return {value};")]
    return function(
        f"static real {check.kind}_margin(int id, {arguments(unit, check)}",
        [*(["switch (id) {", *(f"  {b}" for b in body), "  default:", "    break;", "}"] if body else []),
         "return -DL2C_SMALLEST;"],
        "The margin of a condition, negative where it is violated.",
    )  # fmt: skip


def _choice(unit: Unit, check: Check) -> list[str]:
    """Any of several cases by its index."""
    if len(check.cases) < 2:
        return []
    called = [f"  return {check.kind}_case{k}({passed(check)});" for k in range(len(check.cases))]
    labels = [*(f"case {k}:" for k in range(len(called) - 1)), "default:"]
    body = [line for pair in zip(labels, called, strict=True) for line in pair]
    signature = f"static int {check.kind}_case(int k, {arguments(unit, check)}"
    return [function(signature, ["switch (k) {", *(f"  {b}" for b in body), "}"])]


def _is_inequality(condition: Condition) -> bool:
    return condition.gradual and delta(condition.formula) is not None


def _span_of(case: Case) -> tuple[int, int, int]:
    """The numbers of a case's first condition, of its first inequality, and the one after its last."""
    first, end = (case.conditions[0].number, case.conditions[-1].number + 1) if case.conditions else (0, 0)
    return first, next((c.number for c in case.conditions if _is_inequality(c)), end), end


def _room(unit: Unit, check: Check) -> list[str]:
    """How far a state that satisfies a case is from violating an inequality of it."""
    if not check.cases:
        return []
    conditions = [c for case in check.cases for c in case.conditions]
    lines = [f"real least = {unit.literal(unit.largest)};"]
    counts = "margin < least"
    starts = {c.number: _span_of(case)[1] for case in check.cases for c in case.conditions}
    if any(c.number >= starts[c.number] and not _is_inequality(c) for c in conditions):
        flags = [_is_inequality(c) for c in conditions]
        octets = [sum(flag << i for i, flag in enumerate(flags[k : k + 8])) for k in range(0, len(flags), 8)]
        listed = ", ".join(f"{octet:#04x}" for octet in octets)
        lines = [*wrapped(f"static const unsigned char inequalities[{len(octets)}] = {{{listed}}};"), *lines]
        bit = f"(id - {conditions[0].number})"
        counts = f"(inequalities[{bit} / 8] >> {bit} % 8 & 1) != 0 && {counts}"
    lines += [
        "for (int id = from; id < end; id++) {",
        f"  const real margin = {check.kind}_margin(id, {passed(check)});",
        *(f"  {line}" for line in wrapped(f"if ({counts})")),
        "    least = margin;",
        "}",
        "return least;",
    ]
    signature = f"static real {check.kind}_room(int from, int end, {arguments(unit, check)}"
    return [function(signature, lines, "How much room a satisfied case leaves in its inequalities.")]


def _check(unit: Unit, check: Check) -> str:
    """A check, as the header declares it. A loop over the cases takes less code than one after another."""
    states = ("before", "after") if check.transition else ("state",)
    usable = " && ".join([*(f"is_state({s})" for s in states), "are_parameters(parameters)"])
    lines = [f"{unit.stem}_verdict verdict = {{{OUT_OF_RANGE}, -DL2C_SMALLEST}};"]
    if (count := len(check.cases)) > 1:
        spans = zip(*map(_span_of, check.cases), strict=True)
        kind = "unsigned char" if _span_of(check.cases[-1])[2] < 256 else "short"
        for name, numbers in zip(("firsts", "froms", "ends"), spans, strict=True):
            lines += wrapped(f"static const {kind} {name}[{count}] = {{{', '.join(map(str, numbers))}}};")
    lines += [f"if (!({usable}))", "  return verdict;"]
    if count == 1:
        lines += _one_case(check)
    elif count > 1:
        lines += _any_case(check)
    return function(
        head(unit, check),
        [
            *lines,
            f"const real margin = {check.kind}_margin(verdict.id, {passed(check)});",
            "if (margin < verdict.val)",
            "  verdict.val = margin;",
            "return verdict;",
        ],
    )


def _one_case(check: Check) -> list[str]:
    _, start, end = _span_of(check.cases[0])
    return [
        f"verdict.id = {check.kind}_case0({passed(check)});",
        "if (verdict.id == 0) {",
        f"  verdict.val = {check.kind}_room({start}, {end}, {passed(check)});",
        "  return verdict;",
        "}",
    ]


def _any_case(check: Check) -> list[str]:
    return [
        "int closest = -1;",
        f"for (int k = 0; k < {len(check.cases)}; k++) {{",
        f"  const int id = {check.kind}_case(k, {passed(check)});",
        "  if (id == 0) {",
        f"    const real room = {check.kind}_room(froms[k], ends[k], {passed(check)});",
        "    verdict.id = 0;",
        "    if (room > verdict.val)",
        "      verdict.val = room;",
        "  } else if (verdict.id != 0 && id - firsts[k] > closest) {",
        "    closest = id - firsts[k];",
        "    verdict.id = id;",
        "  }",
        "}",
        "if (verdict.id == 0)",
        "  return verdict;",
    ]


def in_range(unit: Unit) -> str:
    """The conditions under which numbers may be used at all; every comparison is false for a NaN."""
    model = unit.monitor.model
    limit = unit.literal(unit.largest)
    magnitude = "fabsf" if unit.single else "fabs"

    def bounded(value: str, bound: Bound) -> str:
        if bound == UNBOUNDED and not unit.sound:
            return f"{magnitude}({value}) <= {limit}"
        low, high = map(unit.literal, _limits(unit, bound))
        return f"{low} <= {value} && {value} <= {high}"

    inside = [bounded(f"state->{names.member(v.name)}", UNBOUNDED) for v in model.variables]
    allowed = [bounded(f"parameters->{names.member(c.name)}", c.bound) for c in unit.parameters]
    checks = (("is_state", "state", inside), ("are_parameters", "parameters", allowed))
    texts: list[str] = []
    for name, kind, parts in checks:
        condition = " && ".join(parts or ["true"])
        signature = f"static bool {name}(const {unit.stem}_{kind} *{kind})"
        texts.append(function(signature, wrapped(f"return {condition};")))
    return "\n".join(texts)
