"""A monitor compiled for the host, asked by tests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dl2c.emit.monitor.files import monitor_files
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.monitor.check import Kind
from dl2c.native.program import answers, compile_program

Values = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Program:
    """A unit and what it was compiled to."""

    unit: Unit
    path: Path

    def verdicts(self, kind: Kind, rows: Sequence[Sequence[Values]]) -> list[tuple[int, float]]:
        """Number and value for each row, which is the states and then the parameters."""
        lines = [f"{kind} " + " ".join(repr(v) for part in row for v in part.values()) for row in rows]
        return [(int(a), float(b)) for a, b in (text.split() for text in answers(self.path, lines))]


def program_of(unit: Unit, folder: Path) -> Program:
    folder.mkdir(parents=True, exist_ok=True)
    return Program(unit, compile_program(monitor_files(unit), folder))
