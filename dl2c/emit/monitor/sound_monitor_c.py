"""A sound exported monitor: a verdict is right over the reals, or says that the truth is not known.

Every condition is evaluated in interval arithmetic (interval_c.py): it is true, false or unknown. A case is
false where a condition is false, else unknown where one is unknown.
"""

import re

from dl2c.emit import names
from dl2c.emit.cexpr import MATH
from dl2c.emit.cfile import function, place, wrapped
from dl2c.emit.leaf import Leaves, Place
from dl2c.emit.monitor.control_c import Holds, controller_functions
from dl2c.emit.monitor.copied import copied_body, one_line
from dl2c.emit.monitor.interval_c import Statements, prelude
from dl2c.emit.monitor.monitor_c import (
    RUNTIME,
    arguments,
    arithmetic,
    builder_of,
    checking,
    in_range,
    order_of,
    places,
    selected,
    words,
)
from dl2c.emit.monitor.monitor_h import Unit, head, title_of, with_fixed
from dl2c.emit.monitor.own_names import with_own_names
from dl2c.ir.logic import symbols
from dl2c.ir.model import Formula
from dl2c.monitor.check import Check, Condition


def sound_monitor_c(unit: Unit) -> str:
    """The whole file."""
    leaves = [_condition(unit, c) for _, _, c in unit.monitor.conditions if c.first == c.number]
    functions: list[str] = []
    for check in unit.monitor.checks:
        if check.cases:
            functions += [_truth_of(unit, check), _case(unit, check)]
        functions.append(_check(unit, check))
    plain = Leaves(builder_of(unit), order_of(unit), unit.single)
    if unit.monitor.controller is not None:
        functions += controller_functions(unit, plain, "CASE.id == 0", _surely(unit, plain.texts))
    body = "\n".join([*leaves, *plain.texts, in_range(unit), *functions])
    text = prelude(body, unit.single, unit.largest)
    needs_math = re.search(LIBRARY, f"{text}{body}") is not None
    used = [one_line(name) for name in RUNTIME if re.search(rf"\b{name}\b", body)]
    whole = "\n".join(
        [
            f'{title_of(unit)}\n#include "{unit.stem}_monitor.h"\n',
            "#include <float.h>" + ("\n#include <math.h>" if needs_math else "") + f"\n\n{arithmetic(unit)}",
            f"typedef {unit.real} real;\n",
            text,
            *used,
            body,
        ]
    )
    return with_own_names(whole, unit.stem)


LIBRARY = rf"\b({MATH}|ldexp|frexp)f?\b|\bisfinite\("
"""Names that <math.h> declares."""


def _condition(unit: Unit, condition: Condition) -> str:
    about = f"{place(condition.span)}  {condition.about}".strip()
    return _truth(unit, f"condition_n{condition.number}", condition.formula, about)


def _truth(unit: Unit, name: str, formula: Formula, about: str) -> str:
    """A C function that computes the truth of a formula from the values of its symbols."""
    formula = with_fixed(unit, formula)
    statements = Statements(lambda s: names.local(s.name), unit.single)
    result = statements.condition(formula)
    used = sorted(symbols(formula), key=order_of(unit))
    parameters = ", ".join(f"real {names.local(s.name)}" for s in used) or "void"
    lines = [line for statement in statements.lines for line in wrapped(statement)]
    return function(f"static int {name}({parameters})", [*lines, *wrapped(f"return {result};")], about)


def _called(unit: Unit, check: Check, condition: Condition) -> str:
    return _call(unit, f"condition_n{condition.first}", condition.formula, places(unit, check))


def _call(unit: Unit, name: str, formula: Formula, read: Place) -> str:
    used = sorted(symbols(with_fixed(unit, formula)), key=order_of(unit))
    return f"{name}({', '.join(map(read, used))})"


def _surely(unit: Unit, texts: list[str]) -> Holds:
    """Adds functions for tests of inputs to `texts`; a value passes only where its tests surely hold."""

    def holds(name: str, formula: Formula, about: str, read: Place) -> str:
        texts.append(_truth(unit, name, formula, about))
        return f"{_call(unit, name, formula, read)} == IV_TRUE"

    return holds


def _truth_of(unit: Unit, check: Check) -> str:
    values = {c.first: _called(unit, check, c) for c in check.conditions}
    return function(
        f"static int {check.kind}_truth(int id, {arguments(unit, check)}",
        [*selected(check, values), "return IV_FALSE;"],
        "Whether a condition holds.",
    )


def _case(unit: Unit, check: Check) -> str:
    return function(
        f"static {unit.stem}_verdict {check.kind}_case(int first, int end, {arguments(unit, check)}",
        copied_body("sound_check.h", "KIND_case", words(unit, check)),
        "The first of a case's conditions that is false, else the first that is unknown, 0 if all hold.",
    )


def _check(unit: Unit, check: Check) -> str:
    """The C function of a check. If none holds, a case that is unknown is told before a false one."""
    return function(head(unit, check), checking(unit, check, "sound_check.h"))
