"""A sound exported monitor: its verdicts hold over the reals, or say that they are not known.

Every condition is evaluated in intervals (interval_c.py), its truth is one of three. A case is false
where a condition is false, else not known where one is not known.
"""

import re

from dl2c.emit import names
from dl2c.emit.cfile import function, place, wrapped
from dl2c.emit.control_c import Holds, controller_functions
from dl2c.emit.interval_c import Statements, prelude
from dl2c.emit.leaf import Leaves, Place
from dl2c.emit.monitor_c import RUNTIME, arguments, builder_of, in_range, order_of, passed, places
from dl2c.emit.monitor_h import Unit, head, title_of
from dl2c.ir.logic import mapped, substituted, symbols
from dl2c.ir.model import Formula, Number, Symbol, Term
from dl2c.monitor.check import OUT_OF_RANGE, Case, Check, Condition
from dl2c.monitor.control import place_of
from dl2c.source import Span


def sound_monitor_c(unit: Unit) -> str:
    """The whole file. Raises `CompileError` for functions that have no enclosure."""
    leaves = [_condition(unit, c) for _, _, c in unit.monitor.conditions if c.first == c.number]
    functions: list[str] = []
    for check in unit.monitor.checks:
        functions += [_case(unit, check, k, case) for k, case in enumerate(check.cases)]
        functions.append(_check(unit, check))
    plain = Leaves(builder_of(unit), order_of(unit), unit.single)
    if unit.monitor.controller is not None:
        functions += controller_functions(unit, plain, "CASE.id == 0", _surely(unit, plain.texts))
    body = "\n".join([*leaves, *plain.texts, in_range(unit), _settled(unit), *functions])
    kind = "FLT" if unit.single else "DBL"
    needs_root = "iv_root(" in body
    text = prelude(body)
    needs_math = needs_root or re.search(LIBRARY, body) is not None
    used = [text for name, text in RUNTIME.items() if re.search(rf"\b{name}\b", body)]
    return "\n".join(
        [
            f'{title_of(unit)}\n#include "{unit.stem}_monitor.h"\n',
            "#include <float.h>" + ("\n#include <math.h>" if needs_math else "") + "\n",
            *(f"#define IV_{name} {kind}_{value}" for name, value in LIMITS.items()),
            *([f"#define IV_TINY {unit.literal(1 / unit.largest)}"] if "IV_TINY" in text else []),
            *([f"#define IV_SQRT {'sqrtf' if unit.single else 'sqrt'}"] if needs_root else []),
            "",
            f"#define DL2C_SMALLEST {kind}_MIN\n",
            "enum { IV_FALSE, IV_UNKNOWN, IV_TRUE };\n",
            f"typedef {unit.real} real;\n",
            text,
            *used,
            body,
        ]
    )


LIBRARY = r"\b(fabs|sqrt|exp|sin|cos|tan|asin|atan|tanh|pow|log)f?\(|\bisfinite\("
"""Calls of <math.h>."""

LIMITS = {"EPSILON": "EPSILON", "SMALLEST": "MIN", "LARGEST": "MAX"}


def _condition(unit: Unit, condition: Condition) -> str:
    about = f"{place(condition.span)}  {condition.about}".strip()
    return _truth(unit, f"condition_n{condition.number}", condition.formula, about, condition.span)


def _truth(unit: Unit, name: str, formula: Formula, about: str, span: Span) -> str:
    """The truth of a formula as a function of the numbers in it."""
    fixed: dict[Symbol, Term] = {
        Symbol(c.name, "constant"): Number(c.value)
        for c in unit.monitor.model.constants
        if c.value is not None
    }
    formula = mapped(formula, lambda term: substituted(term, fixed))
    statements = Statements(lambda s: names.local(s.name), unit.single, span)
    result = statements.condition(formula)
    used = sorted(symbols(formula), key=order_of(unit))
    parameters = ", ".join(f"real {names.local(s.name)}" for s in used) or "void"
    lines = [line for statement in statements.lines for line in wrapped(statement)]
    return function(f"static int {name}({parameters})", [*lines, *wrapped(f"return {result};")], about)


def _called(unit: Unit, check: Check, condition: Condition) -> str:
    return _call(unit, f"condition_n{condition.first}", condition.formula, places(unit, check))


def _call(unit: Unit, name: str, formula: Formula, read: Place) -> str:
    fixed = {Symbol(c.name, "constant") for c in unit.monitor.model.constants if c.value is not None}
    used = sorted(symbols(formula) - fixed, key=order_of(unit))
    return f"{name}({', '.join(map(read, used))})"


def _surely(unit: Unit, texts: list[str]) -> Holds:
    """What judges tests of inputs: only what surely holds is chosen."""

    def holds(name: str, formula: Formula, about: str, read: Place) -> str:
        texts.append(_truth(unit, name, formula, about, place_of(formula)))
        return f"{_call(unit, name, formula, read)} == IV_TRUE"

    return holds


def _settled(unit: Unit) -> str:
    lines = [
        "if (truth == IV_FALSE) {",
        "  verdict->id = id;",
        "  verdict->unknown = false;",
        "  return true;",
        "}",
        "if (truth == IV_UNKNOWN && verdict->id == 0) {",
        "  verdict->id = id;",
        "  verdict->unknown = true;",
        "}",
        "return false;",
    ]
    signature = f"static bool is_settled(int truth, int id, {unit.stem}_verdict *verdict)"
    return function(signature, lines, "Whether a condition decides its case; its verdict so far.")


def _case(unit: Unit, check: Check, k: int, case: Case) -> str:
    body = [f"{unit.stem}_verdict verdict = {{0, false}};"]
    for condition in case.conditions:
        test = f"if (is_settled({_called(unit, check, condition)}, {condition.number}, &verdict))"
        body += [*wrapped(test), "  return verdict;"]
    signature = f"static {unit.stem}_verdict {check.kind}_case{k}({arguments(unit, check)}"
    return function(signature, [*body, "return verdict;"], f"{check.kind}, {case.about}.")


def _check(unit: Unit, check: Check) -> str:
    """A check, as the header declares it: a case that may hold comes before those that do not."""
    states = ("before", "after") if check.transition else ("state",)
    usable = " && ".join([*(f"is_state({s})" for s in states), "are_parameters(parameters)"])
    lines = [
        f"{unit.stem}_verdict verdict = {{{OUT_OF_RANGE}, false}};",
        f"if (!({usable}))",
        "  return verdict;",
        *(["int closest = -1;"] if any(case.conditions for case in check.cases) else []),
    ]
    for k, case in enumerate(check.cases):
        first = case.conditions[0].number if case.conditions else 0
        lines += [
            f"const {unit.stem}_verdict case{k} = {check.kind}_case{k}({passed(check)});",
            f"if (case{k}.id == 0)",
            f"  return case{k};",
        ]
        if case.conditions:
            better = f"case{k}.unknown == verdict.unknown && case{k}.id - {first} > closest"
            lines += [
                *wrapped(f"if ((case{k}.unknown && !verdict.unknown) || ({better})) {{"),
                f"  closest = case{k}.id - {first};",
                f"  verdict = case{k};",
                "}",
            ]
    return function(head(unit, check), [*lines, "return verdict;"])
