"""Conditions over intervals in C (cgen/runtime/hull.h): whether one is false wherever an input may be.

Printed from instruction tapes. Rounding is monotone, so that the operations of a tape at the ends enclose
what they compute from doubles between them.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

from dl2c.emit.cexpr import FUNCTIONS, INFIX, TRUTHS, number
from dl2c.symbolic.tape import Instruction, Tape

REFUTED = {
    "lt": "{0}.low >= {1}.high",
    "le": "{0}.low > {1}.high",
    "eq": "({0}.low > {1}.high) | ({0}.high < {1}.low)",
    "ne": "({0}.low == {1}.high) & ({0}.high == {1}.low)",
}
"""When no values of two intervals compare so: never where ends are NaN."""

ARITHMETIC = frozenset({"add", "sub", "mul", "div", "neg", "abs", "min", "max", "sqrt"})
JOINING = frozenset({"and", "or"})
KNOWN = frozenset({"input", "constant", *REFUTED}) | ARITHMETIC | JOINING


def refutation(tape: Tape, place: Callable[[str], str], moving: str, within: str) -> list[str] | None:
    """Statements that return whether the condition of a tape is false for every double that the input
    `moving` has `within` an interval; other inputs are where `place` says. None for a tape without one.
    """
    steps = tape.instructions
    mixed = any(
        (steps[a].operation in TRUTHS) != (s.operation in JOINING) for s in steps for a in s.args
    )  # truths that count as numbers, or numbers as truths
    if mixed or not all(s.operation in KNOWN for s in steps) or steps[tape.result].operation not in TRUTHS:
        return None
    printed = _Printed(steps, place, moving, within)
    return [*printed.lines, f"return {printed.texts[tape.result]};"]


@dataclass(slots=True)
class _Printed:
    """A statement for each operation. What does not move is a number, all else an interval; of conditions
    there is whether they are refuted.
    """

    steps: tuple[Instruction, ...]
    place: Callable[[str], str]
    moving: str
    within: str
    lines: list[str] = field(default_factory=list[str])
    texts: list[str] = field(default_factory=list[str])
    moves: list[bool] = field(default_factory=list[bool])
    hulls: dict[int, str] = field(default_factory=dict[int, str])

    def __post_init__(self) -> None:
        for k, step in enumerate(self.steps):
            self.moves.append(step.name == self.moving or any(self.moves[a] for a in step.args))
            match step.operation:
                case "input":
                    self.texts.append(self.within if self.moves[k] else self.place(step.name))
                case "constant":
                    self.texts.append(number(step.value))
                case operation if operation in TRUTHS:
                    self._define(k, "bool", self._refuted(step))
                case _ if self.moves[k]:
                    self._define(k, "dl2c_hull", self._interval(step))
                case _:
                    self._define(k, "real", self._number(step))

    def _define(self, k: int, kind: str, text: str) -> None:
        self.lines.append(f"const {kind} t{k} = {text};")
        self.texts.append(f"t{k}")

    def _refuted(self, step: Instruction) -> str:
        if step.operation in REFUTED:
            return REFUTED[step.operation].format(*(self._hull(a) for a in step.args))
        dual = " | " if step.operation == "and" else " & "
        return dual.join(self.texts[a] for a in step.args)

    def _hull(self, k: int) -> str:
        """An operand as the name of an interval."""
        if self.moves[k]:
            return self.texts[k]
        if k not in self.hulls:
            self.hulls[k] = f"h{k}"
            self.lines.append(f"const dl2c_hull h{k} = dl2c_hull_at({self.texts[k]});")
        return self.hulls[k]

    def _interval(self, step: Instruction) -> str:
        if step.operation == "mul" and step.args[0] == step.args[1]:
            return f"dl2c_hull_square({self.texts[step.args[0]]})"
        return f"dl2c_hull_{step.operation}({', '.join(self._hull(a) for a in step.args)})"

    def _number(self, step: Instruction) -> str:
        values = [self.texts[a] for a in step.args]
        if step.operation in INFIX:
            values = [f"({v})" if v.startswith("-") else v for v in values]
            return f"{values[0]} {INFIX[step.operation][0]} {values[1]}"
        called = "-" if step.operation == "neg" else FUNCTIONS[step.operation]
        return f"{called}({', '.join(values)})"
