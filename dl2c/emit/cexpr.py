"""Instruction tapes as C expressions.

Operations used once are written in place; shared ones get a name. Conditions are joined
by & and |, which evaluate both sides: no branch, so that loops over lanes vectorise. The printed code does
the tape's operations in the tape's order of operands, so its results have the same bits.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from dl2c.emit import names
from dl2c.ir.functions import FUNCTIONS as LIBRARY
from dl2c.ir.functions import OF_DERIVATIVES
from dl2c.symbolic.tape import Instruction, Tape
from dl2c.symbolic.terms import LARGEST

ATOM, UNARY, PRODUCT, SUM, ORDER, EQUALITY, CONJUNCTION, DISJUNCTION = 9, 8, 7, 6, 5, 4, 3, 2
LONGEST = 72
"""Longer operands get a name of their own."""

INFIX = {
    "add": ("+", SUM),
    "sub": ("-", SUM),
    "mul": ("*", PRODUCT),
    "div": ("/", PRODUCT),
    "lt": ("<", ORDER),
    "le": ("<=", ORDER),
    "eq": ("==", EQUALITY),
    "ne": ("!=", EQUALITY),
    "and": ("&", CONJUNCTION),
    "or": ("|", DISJUNCTION),
}
MIRRORED = {"<": ">", "<=": ">="}
FUNCTIONS = {name: row.c for name, row in LIBRARY.items()} | OF_DERIVATIVES
MATH = "|".join(c for c in FUNCTIONS.values() if not c.startswith("dl2c_"))
"""Those of <math.h>, as a pattern."""
INEXACT = re.compile(rf"\b({'|'.join(row.c or name for name, row in LIBRARY.items() if not row.exact)})\(")
"""A call of a function whose last bit is not that of every C library."""

TRUTHS = frozenset({"lt", "le", "eq", "ne", "and", "or", "not"})


@dataclass(frozen=True, slots=True)
class Printed:
    """Statements to place first, and the expression of the result. `trivial`: a name or number alone."""

    statements: tuple[str, ...]
    expression: str
    trivial: bool


def number(value: float) -> str:
    """The shortest text that reads back as the same double."""
    if value == LARGEST:
        return "DBL_MAX"
    if math.isnan(value):
        return "(real)NAN"
    if math.isinf(value):
        return "(real)INFINITY" if value > 0 else "-(real)INFINITY"
    return repr(value)


def print_tape(
    tape: Tape,
    name: Callable[[str], str] = names.local,
    truth: bool = False,
    single: bool = False,
    stem: str | None = None,
    first: int = 0,
) -> Printed:
    """The tape as C, input `a` written as `name(a)`; `truth` for a result that is a condition, `single`
    for numbers and functions of single precision. Names of statements begin with `stem`, a free one if it
    is None, and count from `first` on.
    """
    uses = [0] * len(tape.instructions)
    for instruction in tape.instructions:
        for arg in instruction.args:
            uses[arg] += 1
    prefix = stem or names.stem("t", {i.name for i in tape.instructions})
    statements: list[str] = []
    texts: list[tuple[str, int]] = []
    for k, instruction in enumerate(tape.instructions):
        text, binds = _expression(instruction, tape, texts, name, "f" if single else "")
        shared = uses[k] > 1 and instruction.operation not in ("input", "constant")
        if shared or (
            len(text) > LONGEST and k != tape.result and instruction.operation not in ("and", "or")
        ):
            temporary = f"{prefix}{first + len(statements)}"
            kind = "bool" if instruction.operation in TRUTHS else "real"
            statements.append(f"const {kind} {temporary} = {text};")
            text, binds = temporary, ATOM
        texts.append((text, binds))
    text, _ = texts[tape.result]
    result = tape.instructions[tape.result]
    if truth and result.operation == "constant":
        text = "true" if result.value else "false"
    return Printed(_needed(statements, text), text, result.operation in ("input", "constant"))


def _needed(statements: list[str], text: str) -> tuple[str, ...]:
    """Without names that only a peephole rewriting left unused."""
    kept: list[str] = []
    for statement in reversed(statements):
        name = statement.split()[2]
        if any(re.search(rf"\b{name}\b", t) for t in (text, *kept)):
            kept.append(statement)
    return tuple(reversed(kept))


def _expression(
    instruction: Instruction,
    tape: Tape,
    texts: list[tuple[str, int]],
    name: Callable[[str], str],
    suffix: str,
) -> tuple[str, int]:
    """The text of an instruction and how tightly it binds; `texts` are those of earlier ones. Numbers and
    functions of the library get the `suffix`.
    """
    match instruction.operation:
        case "input":
            return name(instruction.name), ATOM
        case "constant":
            text = number(instruction.value)
            text = text if text.endswith(("X", ")")) else text + suffix
            return text, UNARY if text.startswith("-") else ATOM
        case "neg":
            return f"-{_operand(texts, instruction.args[0], ATOM)}", UNARY
        case "not":
            return f"!{_operand(texts, instruction.args[0], ATOM)}", UNARY
        case "le" if _is_finiteness(tape, instruction.args):
            inner = tape.instructions[instruction.args[0]].args[0]
            return f"isfinite({texts[inner][0]})", ATOM
        case "lt" | "le" if tape.instructions[instruction.args[0]].operation == "constant":
            sign, level = INFIX[instruction.operation]
            constant, other = instruction.args
            left, right = _operand(texts, other, level), _operand(texts, constant, level, True)
            return f"{left} {MIRRORED[sign]} {right}", level
        case "add" | "sub" | "mul" | "div":
            sign, level = INFIX[instruction.operation]
            values = [_value(tape, texts, arg) for arg in instruction.args]
            return f"{_operand(values, 0, level)} {sign} {_operand(values, 1, level, True)}", level
        case "lt" | "le" | "eq" | "ne":
            sign, level = INFIX[instruction.operation]
            first, second = instruction.args
            return f"{_operand(texts, first, level)} {sign} {_operand(texts, second, level, True)}", level
        case "and" | "or":
            sign, level = INFIX[instruction.operation]
            left, right = (_condition(instruction.args, texts, k, level) for k in (0, 1))
            return f"{left} {sign} {right}", level
        case function:
            arguments = ", ".join(texts[a][0] for a in instruction.args)
            called = FUNCTIONS[function]
            return f"{called if called.startswith('dl2c_') else called + suffix}({arguments})", ATOM


def _value(tape: Tape, texts: list[tuple[str, int]], k: int) -> tuple[str, int]:
    """Operand k of arithmetic: a truth, as derivatives of `min` and `max` have it, counts as 0 or 1."""
    if tape.instructions[k].operation not in TRUTHS:
        return texts[k]
    return f"(real){_operand(texts, k, ATOM)}", UNARY


def _operand(texts: list[tuple[str, int]], k: int, level: int, strictly: bool = False) -> str:
    """Operand k, parenthesised where it binds less tightly than its operator."""
    text, binds = texts[k]
    return f"({text})" if binds < level or (strictly and binds == level) else text


def _condition(args: tuple[int, ...], texts: list[tuple[str, int]], k: int, level: int) -> str:
    """An operand of & or |; only a chain of one operator needs no parentheses."""
    text, binds = texts[args[k]]
    return text if binds in (level, ATOM) else f"({text})"


def _is_finiteness(tape: Tape, args: tuple[int, ...]) -> bool:
    left, right = (tape.instructions[a] for a in args)
    return left.operation == "abs" and right.operation == "constant" and right.value == LARGEST
