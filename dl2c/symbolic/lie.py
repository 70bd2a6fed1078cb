"""Derivatives of terms, along an ODE or by one symbol, as tapes.

CasADi differentiates the graph of the term. Its result is full of zeros and ones, since
simplification is switched off; they are removed from the tape. That may change rounding
and drop undefined factors of zero, which is allowed here and nowhere else: no other part
of the meaning computes a derivative. Where a term has a kink (`abs`, `min`, `max`) the
result is the mean of both sides.
"""

from collections.abc import Sequence
from dataclasses import replace

from dl2c.ir.model import Symbol, Term
from dl2c.symbolic.exclusive import exclusive
from dl2c.symbolic.tape import Instruction, Tape, tape_of
from dl2c.symbolic.terms import Builder, casadi

ZERO = Instruction("constant", value=0.0)


@exclusive
def lie_tape(builder: Builder, term: Term, equations: Sequence[tuple[str, Term]], order: int = 1) -> Tape:
    """The tape of d^order/dt^order `term` along the ODE `equations`, pairs of a variable and its rate."""
    variables = casadi.vertcat(*(builder.term(Symbol(x, "variable")) for x, _ in equations))
    rates = casadi.vertcat(*(builder.term(rate) for _, rate in equations))
    graph = builder.term(term)
    for _ in range(order):
        graph = casadi.densify(casadi.jtimes(graph, variables, rates))
    return tidied(tape_of(builder, graph))


@exclusive
def partial_tape(builder: Builder, term: Term, symbol: Symbol) -> Tape | None:
    """The tape of d `term` / d `symbol`; None where it is zero whatever the values are."""
    graph = casadi.jacobian(builder.term(term), builder.term(symbol))
    if graph.nnz() == 0:
        return None
    tape = tidied(tape_of(builder, graph))
    return None if tape.instructions[tape.result] == ZERO else tape


def tidied(tape: Tape) -> Tape:
    """The same function over the reals without operations on zeros and ones, and what they made useless."""
    kept: list[Instruction] = []
    known: dict[Instruction, int] = {}
    places: list[int] = []
    for instruction in tape.instructions:
        moved = replace(instruction, args=tuple(places[a] for a in instruction.args))
        simpler = _simpler(moved, kept)
        if isinstance(simpler, Instruction):
            position = known.setdefault(simpler, len(kept))
            if position == len(kept):
                kept.append(simpler)
            simpler = position
        places.append(simpler)
    return _needed(replace(tape, instructions=tuple(kept), result=places[tape.result]))


def _simpler(instruction: Instruction, earlier: Sequence[Instruction]) -> Instruction | int:
    """What to compute instead: another instruction, or the index of an earlier one."""
    args = instruction.args
    values = [earlier[a].value if earlier[a].operation == "constant" else None for a in args]
    match instruction.operation, values:
        case ("mul", [0.0, _] | [_, 0.0]) | ("div", [0.0, _]):
            return ZERO
        case ("mul", [1.0, _]) | ("add", [0.0, _]):
            return args[1]
        case ("mul" | "div", [_, 1.0]) | ("add" | "sub", [_, 0.0]):
            return args[0]
        case ("mul", [-1.0, _]) | ("sub", [0.0, _]):
            return _simpler(Instruction("neg", (args[1],)), earlier)
        case "neg", [float(value)]:
            return Instruction("constant", value=-value)
        case "neg", _ if earlier[args[0]].operation == "neg":
            return earlier[args[0]].args[0]
        case "add", _ if earlier[args[1]].operation == "neg":
            return Instruction("sub", (args[0], earlier[args[1]].args[0]))
        case _:
            return instruction


def _needed(tape: Tape) -> Tape:
    """Without instructions and inputs that the result does not depend on."""
    needed = {tape.result}
    for k in range(tape.result, -1, -1):
        if k in needed:
            needed.update(tape.instructions[k].args)
    places = {old: new for new, old in enumerate(sorted(needed))}
    instructions = tuple(
        replace(tape.instructions[k], args=tuple(places[a] for a in tape.instructions[k].args))
        for k in places
    )
    names = {i.name for i in instructions if i.operation == "input"}
    return Tape(tuple(s for s in tape.inputs if s.name in names), instructions, places[tape.result])
