"""CasADi functions as instruction tapes: plain data that a printer can turn into code.

Every instruction has a value of its own (CasADi reuses work slots), common
subexpressions are shared, and operations have our names.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dl2c.ir.functions import FUNCTIONS, OF_DERIVATIVES
from dl2c.ir.model import Formula, Symbol, Term
from dl2c.symbolic.exclusive import exclusive
from dl2c.symbolic.terms import Builder, Graph, casadi

OPERATIONS: dict[int, str] = {
    casadi.OP_ADD: "add",
    casadi.OP_SUB: "sub",
    casadi.OP_MUL: "mul",
    casadi.OP_DIV: "div",
    casadi.OP_NEG: "neg",
    casadi.OP_POW: "pow",
    casadi.OP_LT: "lt",
    casadi.OP_LE: "le",
    casadi.OP_EQ: "eq",
    casadi.OP_NE: "ne",
    casadi.OP_AND: "and",
    casadi.OP_OR: "or",
    casadi.OP_NOT: "not",
    **{getattr(casadi, f"OP_{row.casadi.upper()}"): name for name, row in FUNCTIONS.items()},
    **{getattr(casadi, f"OP_{name.upper()}"): name for name in OF_DERIVATIVES},
}
"""Besides these a tape has the operations "input" and "constant"."""


@dataclass(frozen=True, slots=True)
class Instruction:
    """`args` are indices of earlier instructions; an input has its `name`, a constant its `value`."""

    operation: str
    args: tuple[int, ...] = ()
    name: str = ""
    value: float = 0.0


@dataclass(frozen=True, slots=True)
class Tape:
    """A function of `inputs` in the order given; its value is that of instruction `result`."""

    inputs: tuple[Symbol, ...]
    instructions: tuple[Instruction, ...]
    result: int


@exclusive
def term_tape(builder: Builder, term: Term) -> Tape:
    """The tape of a term's value."""
    return tape_of(builder, builder.term(term))


@exclusive
def formula_tape(builder: Builder, formula: Formula) -> Tape:
    """The tape of a formula's truth, definedness included."""
    return tape_of(builder, builder.holds(formula))


@exclusive
def defined_tape(builder: Builder, terms: Sequence[Term]) -> Tape | None:
    """The tape of whether all terms are defined and finite; None if they always are."""
    if not any(builder.defined(t) for t in terms):
        return None
    return tape_of(builder, builder.all_defined(list(terms)))


def function(builder: Builder, graph: Graph) -> tuple[tuple[Symbol, ...], Any]:
    """A graph as a CasADi function of the symbols it uses, in the order they were first met."""
    used = {str(s) for s in casadi.symvar(graph)}
    order = tuple(s for s in builder.inputs if str(builder.inputs[s]) in used)
    return order, casadi.Function("f", [builder.inputs[s] for s in order], [casadi.cse(graph)])


def tape_of(builder: Builder, graph: Graph) -> Tape:
    """The tape of a graph over the builder's symbols."""
    order, compiled = function(builder, graph)
    instructions: list[Instruction] = []
    slots: dict[int, int] = {}
    result = -1
    for k in range(compiled.n_instructions()):
        code, inputs, outputs = (
            compiled.instruction_id(k),
            compiled.instruction_input(k),
            compiled.instruction_output(k),
        )
        if code == casadi.OP_OUTPUT:
            result = slots[inputs[0]]
            continue
        if code == casadi.OP_INPUT:
            place: int = inputs[0]
            instruction = Instruction("input", name=order[place].name)
        elif code == casadi.OP_CONST:
            instruction = Instruction("constant", value=compiled.instruction_constant(k))
        elif code in (casadi.OP_SQ, casadi.OP_TWICE):
            operation = "mul" if code == casadi.OP_SQ else "add"
            instruction = Instruction(operation, (slots[inputs[0]], slots[inputs[0]]))
        else:
            instruction = Instruction(OPERATIONS[code], tuple(slots[i] for i in inputs))
        instructions.append(instruction)
        slots[outputs[0]] = len(instructions) - 1
    return Tape(order, tuple(instructions), result)
