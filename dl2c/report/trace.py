"""Recorded traces, as `dl2c rollout --csv` writes them, through a compiled monitor.

A trace has the states between steps, but not the state in the middle of a step, when the controller has
decided and motion has not begun. That state is reconstructed for each control path: variables that do not
move have the value recorded after the step, the others what the path assigns, and what `x := *` chose is
in a column of its own. The monitor must accept one of these states.
"""

import csv
import io
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dl2c.diagnostics import Diagnostic, Mistake, warning
from dl2c.emit.cfile import place
from dl2c.emit.monitor.files import monitor_files
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.inputs import MALFORMED, read_text, reason
from dl2c.ir.evaluate import Undefined, evaluate
from dl2c.ir.logic import symbols
from dl2c.ir.model import ZERO, Model, Symbol
from dl2c.monitor.check import OUT_OF_RANGE, Check, Monitor, after
from dl2c.monitor.control import Control, control_paths
from dl2c.native.program import answers, compile_program
from dl2c.source import Span
from dl2c.training.rollout import column

UNMOVED = ("blocked", "diverged", "numerical", "solver")
"""Reasons to end an episode with a step that is not a step of the model."""

MOST_BYTES = 1024**3
"""A longer trace is not read."""


class TraceError(Mistake):
    """A file that is not a trace of the model; the message says why."""


Row = Mapping[str | Any, str | Any]


@dataclass(frozen=True, slots=True)
class Violation:
    """A row of a trace, counted from 1 after the header, that a check does not accept."""

    row: int
    episode: str
    step: str
    kind: str
    id: int
    about: str
    where: str

    def as_data(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self.__slots__}

    def sentence(self) -> str:
        where = f" ({self.where})" if self.where else ""
        what = f"row {self.row} (episode {self.episode}, step {self.step})"
        return f"{what} violates condition {self.id} of the {self.kind} check{where}: {self.about}"


@dataclass(frozen=True, slots=True)
class Question:
    """A line for the monitor's program about a row; a step has one for each state it may have led to."""

    row: int
    check: Check
    line: str


def replayed(unit: Unit, rows: list[Row]) -> tuple[list[Violation], int]:
    """All violations of a trace in the order of its rows, and how many steps it has. Raises `NativeError`."""
    asked = list(questions(unit, rows))
    with tempfile.TemporaryDirectory() as folder:
        program = compile_program(monitor_files(unit), Path(folder))
        said = answers(program, (q.line for q in asked))
    verdicts: dict[tuple[int, str], list[int]] = {}
    for question, answer in zip(asked, said, strict=True):
        verdicts.setdefault((question.row, question.check.kind), []).append(int(answer.split()[0]))
    steps = sum(row["step"] != "0" for row in rows)
    bad = [(row, kind, ids) for (row, kind), ids in sorted(verdicts.items()) if 0 not in ids]
    return [_violation(unit.monitor, row, rows[row], kind, ids) for row, kind, ids in bad], steps


def questions(unit: Unit, rows: list[Row]) -> Iterator[Question]:
    """Everything that the checks of a monitor say about a trace."""
    model = unit.monitor.model
    controls = controls_of(model)
    seen = not unseen(model, rows[0])
    whole = not model.lead and not model.prefix
    for k, row in enumerate(rows):
        state, numbers = _state(model, row), _line(_parameters(unit, row))
        for check in unit.monitor.checks:
            if check.kind == "safety":
                yield Question(k, check, f"safety {_line(state)} {numbers}")
            elif check.kind == "init" and row["step"] == "0" and whole:
                yield Question(k, check, f"init {_line(state)} {numbers}")
            elif check.kind == "controller" and not seen:
                continue
            elif check.transition and not model.lead and (last := before(rows, k)) is not None:
                begun = _line(_state(model, last))
                between = [state] if check.kind == "model" else led_to(model, controls, last, row)
                for one in between:
                    yield Question(k, check, f"{check.kind} {begun} {_line(one)} {numbers}")


def before(rows: Sequence[Row], k: int) -> Row | None:
    """The row from which a step of the model leads to this one, if the trace has it."""
    row, last = rows[k], rows[k - 1] if k else None
    if last is None or row["reason"] in UNMOVED or last["episode"] != row["episode"]:
        return None
    return last if _number(last["step"]) + 1 == _number(row["step"]) else None


def disconnected(rows: Sequence[Row]) -> list[int]:
    """Steps of the model that lack the row before them."""
    steps = [k for k, row in enumerate(rows) if row["step"] != "0" and row["reason"] not in UNMOVED]
    return [k for k in steps if before(rows, k) is None]


def controls_of(model: Model) -> tuple[Control, ...]:
    """The control paths, with the inputs that the state after a whole step shows."""
    moving = {x for flow in model.flows for x, rate in flow.equations if rate != ZERO}
    return control_paths(model, frozenset(v.name for v in model.variables) - moving)


def unseen(model: Model, row: Row) -> tuple[Diagnostic, ...]:
    """Why steps of a trace with rows like this are not checked. It does not show where a step begins if the
    step has leading statements, nor where its motion begins if it lacks the column of a value that was
    chosen for a variable that then moves.
    """
    if model.lead:
        title = "the controller and whole steps are not checked: the trace has no states before this"
        label = "executed when the step before is over, so that the agent observes what it leads to"
        return (warning("not-replayed", title, model.lead[0].span, label, "other checks are replayed"),)
    moving = {x for flow in model.flows for x, rate in flow.equations if rate != ZERO}
    places: dict[str, Span] = {}
    for control in controls_of(model):
        used = symbols(*(value for x, value in control.values.items() if x in moving))
        keys = [key for key in control.hidden if Symbol(key, "input") in used and key not in row]
        places |= {key: control.draft.place_of(key) for key in keys}
    title = "the controller is not checked: the trace does not show this value"
    label = "given to a variable that moves"
    advice = "`dl2c rollout --csv` writes it as `{}`, but not with `action_map=squash`"
    return tuple(
        warning("not-replayed", title, place, label, f"{advice.format(key)}; other checks are replayed")
        for key, place in places.items()
    )


def led_to(model: Model, controls: tuple[Control, ...], before: Row, now: Row) -> list[dict[str, float]]:
    """The states in which the motion of a step may have begun."""
    env: dict[Symbol, Any] = {Symbol(v.name, "variable"): _value(before, v.name) for v in model.variables}
    env |= {after(v.name): _value(now, v.name) for v in model.variables}
    env |= {
        Symbol(key, "input"): _number(now[key])
        for control in controls
        for key in control.hidden
        if key in now
    }
    env |= {
        Symbol(c.name, "constant"): _value(now, c.name) if c.value is None else float(c.value)
        for c in model.constants
    }
    moving = {x for flow in model.flows for x, rate in flow.equations if rate != ZERO}
    found: list[dict[str, float]] = []
    for control in controls:
        try:
            state = {
                x: float(evaluate(value, env)) if x in moving else _value(now, x)
                for x, value in control.values.items()
            }
        except (Undefined, KeyError):
            continue
        if state not in found:
            found.append(state)
    return found


def _violation(monitor: Monitor, row: int, values: Row, kind: str, ids: list[int]) -> Violation:
    """Of several states that a step may have led to, the one that came closest to satisfying its case."""
    reached = {
        c.number: (k, c)
        for check, case, _ in monitor.conditions
        for k, c in enumerate(case.conditions)
        if check.kind == kind
    }
    number = max(ids, key=lambda i: reached[i][0] if i in reached else -1)
    head = (row + 1, values["episode"], values["step"], kind, number)
    if number == OUT_OF_RANGE:
        return Violation(*head, "a number is out of range", "")
    condition = reached[number][1]
    return Violation(*head, condition.about, place(condition.span))


def rows_of(trace: Path, unit: Unit) -> list[Row]:
    """Raises `TraceError` for a file that is not a trace of the model, `OSError`."""
    try:
        text = read_text(trace, MOST_BYTES)
        rows: list[Row] = list(csv.DictReader(io.StringIO(text, newline="")))
    except (*MALFORMED, csv.Error) as problem:
        raise TraceError(f"{trace} is not a trace: {reason(problem)}") from None
    wanted = [*(v.name for v in unit.monitor.model.variables), *(c.name for c in unit.parameters)]
    columns = ["episode", "step", "reason", *(column(n) for n in wanted)]
    if missing := [c for c in columns if not rows or rows[0].get(c) is None]:
        model = unit.monitor.model.name
        raise TraceError(f"{trace} is not a trace of {model}: it lacks {', '.join(missing)}")
    return rows


def _value(row: Row, name: str) -> float:
    return _number(row[column(name)])


def _number(text: Any) -> float:
    try:
        return float(text)
    except (TypeError, ValueError):
        return float("nan")


def _state(model: Model, row: Row) -> dict[str, float]:
    return {v.name: _value(row, v.name) for v in model.variables}


def _parameters(unit: Unit, row: Row) -> dict[str, float]:
    return {c.name: _value(row, c.name) for c in unit.parameters}


def _line(values: Mapping[str, float]) -> str:
    return " ".join(map(repr, values.values()))
