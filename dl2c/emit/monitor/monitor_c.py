"""An exported monitor as one C file that needs nothing of the runtime.

Leaf functions are those of the simulator: the same printer, the same order of operations. A case is a
range of numbers of conditions, and conditions that are the same formula are code only once. A violated
check reports a condition of the case that came closest; a satisfied one the largest, over its satisfied
cases, of the least margin of a case.
"""

import re
import struct
from collections.abc import Callable, Mapping
from fractions import Fraction

from dl2c.emit import names
from dl2c.emit.cfile import comment, function, place, wrapped
from dl2c.emit.leaf import Leaves, Place
from dl2c.emit.monitor.control_c import controller_functions, reading
from dl2c.emit.monitor.copied import copied_body, one_line, preprocessed
from dl2c.emit.monitor.monitor_h import Unit, head, title_of
from dl2c.emit.monitor.own_names import with_own_names
from dl2c.interval.arithmetic import Interval, enclosure
from dl2c.ir.logic import delta
from dl2c.ir.model import UNBOUNDED, Bound, Symbol
from dl2c.monitor.check import OUT_OF_RANGE, Check, Condition, after
from dl2c.symbolic.terms import Builder

LARGEST_SINGLE = 3.4e38

RUNTIME = ("dl2c_min", "dl2c_max")
"""What leaf functions use of the runtime, as it is there."""


def monitor_c(unit: Unit) -> str:
    """The whole file."""
    leaves = Leaves(builder_of(unit), order_of(unit), unit.single)
    functions: list[str] = []
    for check in unit.monitor.checks:
        if check.cases:
            functions += [_holds(unit, check, leaves), _case(unit, check)]
            functions += [_margin(unit, check, leaves), _least_margin(unit, check)]
        functions.append(_check(unit, check))
    if unit.monitor.controller is not None:
        functions += controller_functions(unit, leaves, "CASE == 0", leaves.condition)
    body = "\n".join([*leaves.texts, in_range(unit), *functions])
    used = [one_line(name) for name in RUNTIME if re.search(rf"\b{name}\b", body)]
    smallest = "FLT_MIN" if unit.single else "DBL_MIN"
    text = "\n".join(
        [
            f'{title_of(unit)}\n#include "{unit.stem}_monitor.h"\n',
            f"#include <float.h>\n#include <math.h>\n\n{arithmetic(unit)}",
            f"#define DL2C_SMALLEST {smallest}\n",
            f"typedef {unit.real} real;\n",
            *used,
            body,
        ]
    )
    return with_own_names(text, unit.stem)


def arithmetic(unit: Unit) -> str:
    """Refuses to be compiled for arithmetic that a monitor cannot rely on."""
    text = preprocessed("arithmetic.h")
    return (
        text if not unit.single else text.replace(" && FLT_EVAL_METHOD != 1", "").replace("double", "float")
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


def selected(check: Check, values: Mapping[int, str]) -> list[str]:
    """A switch that returns what belongs to the condition `id`; `values` by numbers of first conditions."""
    numbers: dict[int, list[int]] = {}
    for condition in check.conditions:
        numbers.setdefault(condition.first, []).append(condition.number)
    body: list[str] = []
    for first, value in values.items():
        body += [*(f"case {n}:" for n in numbers[first]), *wrapped(f"  return {value};")]
    return ["switch (id) {", *(f"  {b}" for b in body), "  default:", "    break;", "}"] if body else []


def _holds(unit: Unit, check: Check, leaves: Leaves) -> str:
    values = {c.first: _condition(unit, check, c, leaves) for c in check.conditions}
    return function(
        f"static bool {check.kind}_holds(int id, {arguments(unit, check)}",
        [*selected(check, values), "return false;"],
        "Whether a condition holds.",
    )


def _case(unit: Unit, check: Check) -> str:
    return function(
        f"static int {check.kind}_case(int first, int end, {arguments(unit, check)}",
        copied_body("check.h", "KIND_case", words(unit, check)),
        "The first of a case's conditions that does not hold, 0 for none.",
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
    for condition in check.conditions:
        if (term := delta(condition.formula)) is not None:
            first = condition.first
            about = f"The margin of condition {first}."
            values[first] = leaves.term(f"margin_n{first}", term, about, places(unit, check))
    return function(
        f"static real {check.kind}_margin(int id, {arguments(unit, check)}",
        [*selected(check, values), "return -DL2C_SMALLEST;"],
        "The margin of a condition, negative where it is violated.",
    )


def _is_inequality(condition: Condition) -> bool:
    return condition.gradual and delta(condition.formula) is not None


def _least_margin(unit: Unit, check: Check) -> str:
    """How far a state that satisfies a case is from violating an inequality of it."""
    conditions = check.conditions
    lines: list[str] = []
    counts = "margin < least"
    if not all(map(_is_inequality, conditions)):
        flags = [_is_inequality(c) for c in conditions]
        octets = [sum(flag << i for i, flag in enumerate(flags[k : k + 8])) for k in range(0, len(flags), 8)]
        listed = ", ".join(f"{octet:#04x}" for octet in octets)
        lines += wrapped(f"static const unsigned char inequalities[{len(octets)}] = {{{listed}}};")
        bit = f"(id - {conditions[0].number})"
        counts = f"(inequalities[{bit} / 8] >> {bit} % 8 & 1) != 0 && {counts}"
    meant = words(unit, check) | {"COUNTS": counts, "LARGEST": unit.literal(unit.largest)}
    lines += [part for line in copied_body("check.h", "KIND_least_margin", meant) for part in indented(line)]
    signature = f"static real {check.kind}_least_margin(int first, int end, {arguments(unit, check)}"
    return function(signature, lines, "The least margin of a satisfied case in its inequalities.")


def _check(unit: Unit, check: Check) -> str:
    """A check, as the header declares it. A loop over the cases takes less code than one after another."""
    return function(head(unit, check), checking(unit, check, "check.h"))


def checking(unit: Unit, check: Check, file: str) -> list[str]:
    """The statements of a check, as a file of cgen/monitor has them."""
    one = "KIND_check_one" if len(check.cases) < 2 else "KIND_check_any"
    first, *rest = copied_body(file, one, words(unit, check))
    if not check.cases:
        return [first, "return verdict;"]
    return [first, *begun(check), *(part for line in rest for part in indented(line))]


def indented(line: str) -> list[str]:
    """A statement, wrapped where it is too long."""
    text = line.lstrip(" ")
    return [f"{line[: len(line) - len(text)]}{part}" for part in wrapped(text)]


def words(unit: Unit, check: Check) -> dict[str, str]:
    """What the words of check.h stand for."""
    states = ("before", "after") if check.transition else ("state",)
    bounds = check.bounds if check.cases else (0, 0)
    return {
        "MODEL": unit.stem,
        "KIND": check.kind,
        "GIVEN": passed(check),
        "USABLE": " && ".join([*(f"is_state({s})" for s in states), "are_parameters(parameters)"]),
        "OUT_OF_RANGE": str(OUT_OF_RANGE),
        "FIRST": str(bounds[0]),
        "END": str(bounds[1]),
        "CASES": str(len(check.cases)),
    }


def begun(check: Check) -> list[str]:
    """A table of where the conditions of each case begin and end, for a loop over several cases."""
    if len(check.cases) < 2:
        return []
    bounds = check.bounds
    kind = "unsigned char" if bounds[-1] < 256 else "short"
    listed = ", ".join(map(str, bounds))
    about = (
        f"Where the conditions begin of {'; '.join(case.about for case in check.cases)}; and where they end."
    )
    return [
        *comment(about).split("\n"),
        *wrapped(f"static const {kind} firsts[{len(bounds)}] = {{{listed}}};"),
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
