"""How a simulator asks the exported monitor about its own steps: its arrays as the structs of the monitor."""

from collections.abc import Iterator

from dl2c.emit import names
from dl2c.emit.cfile import function
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.ir.model import Symbol
from dl2c.monitor.check import Kind

JUDGED: tuple[tuple[str, Kind, str], ...] = (
    (
        "control",
        "controller",
        "The condition of the monitor that the control of a step violates, 0 for none.",
    ),
    ("step", "model", "The condition that a whole step violates, 0 for none or where that has no check."),
)


def judging_functions(unit: Unit) -> Iterator[str]:
    """`model_monitor_control` and `model_monitor_step`."""
    model, stem = unit.monitor.model, unit.stem
    states = [
        f"{{{', '.join(_at(a, Symbol(v.name, 'variable')) for v in model.variables)}}}"
        for a in ("before", "after")
    ]
    constants = [_at("p", Symbol(c.name, "constant")) for c in unit.parameters]
    for name, kind, about in JUDGED:
        lines = ["return 0;"]
        if any(check.kind == kind for check in unit.monitor.checks):
            lines = [
                *_initialised(f"const {stem}_state first = {states[0]};"),
                *_initialised(f"const {stem}_state second = {states[1]};"),
                *_initialised(f"const {stem}_parameters constants = {{{', '.join(constants) or '0'}}};"),
                f"return {stem}_check_{kind}(&first, &second, &constants).id;",
            ]
        arguments = "const real *before, const real *after, const real *p"
        yield function(f"static int32_t model_monitor_{name}({arguments})", lines, about)


def _at(array: str, symbol: Symbol) -> str:
    return f"{array}[{names.index(symbol)}]"


def _initialised(line: str) -> list[str]:
    return line.replace("{", "{\n    ").replace("};", "\n};").split("\n") if len(line) > 98 else [line]
