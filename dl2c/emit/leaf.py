"""Leaf functions: one term or condition each, scalars in, one scalar out.

A leaf is pure and knows nothing of arrays, so the same text serves the simulator, its
vectorised form and the monitor. Adapters call leaves with `call`; a term that is only a
name or a number gets no function.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

from dl2c.emit import names
from dl2c.emit.cexpr import Printed, print_tape
from dl2c.emit.cfile import function, wrapped
from dl2c.ir.model import Flow, Formula, Symbol, Term
from dl2c.symbolic.lie import lie_tape, partial_tape
from dl2c.symbolic.tape import Tape, defined_tape, formula_tape, term_tape
from dl2c.symbolic.terms import Builder
from dl2c.work import spend

Place = Callable[[Symbol], str]


@dataclass(slots=True)
class Leaves:
    """The leaf functions of one file, in the order they are made. `order` ranks parameters; `single` is
    for a file whose numbers are floats.
    """

    builder: Builder
    order: Callable[[Symbol], int]
    single: bool = False
    texts: list[str] = field(default_factory=list[str])
    made: dict[str, Tape] = field(default_factory=dict[str, Tape])

    def term(self, name: str, term: Term, about: str, place: Place = names.slot) -> str:
        """An expression for a term's value, each symbol read where `place` says."""
        return self._leaf(name, term_tape(self.builder, term), "real", about, place)

    def condition(self, name: str, formula: Formula, about: str, place: Place = names.slot) -> str:
        """An expression for a formula's truth."""
        return self._leaf(name, formula_tape(self.builder, formula), "bool", about, place)

    def defined(self, name: str, terms: list[Term], about: str, place: Place = names.slot) -> str | None:
        """An expression for whether all terms are defined and finite; None if they always are."""
        tape = defined_tape(self.builder, terms)
        return None if tape is None else self._leaf(name, tape, "bool", about, place)

    def lie(
        self, name: str, term: Term, flow: Flow, about: str, place: Place = names.slot, order: int = 1
    ) -> str:
        """An expression for how fast a term changes along a flow, or for a higher derivative."""
        return self._leaf(name, lie_tape(self.builder, term, flow.equations, order), "real", about, place)

    def partial(
        self, name: str, term: Term, symbol: Symbol, about: str, place: Place = names.slot
    ) -> str | None:
        """An expression for the derivative of a term by a symbol; None if it is always zero."""
        tape = partial_tape(self.builder, term, symbol)
        return None if tape is None else self._leaf(name, tape, "real", about, place)

    def call(self, name: str, inputs: tuple[Symbol, ...], place: Place = names.slot) -> str:
        """A call of a leaf with its arguments read from the arrays."""
        arguments = ", ".join(place(s) for s in sorted(inputs, key=self.order))
        return f"{name}({arguments})"

    def _leaf(self, name: str, tape: Tape, kind: str, about: str, place: Place) -> str:
        spend()
        slots = {s.name: place(s) for s in tape.inputs}
        direct = print_tape(tape, lambda n: slots[n], kind == "bool", self.single)
        if direct.trivial:
            return direct.expression
        ordered = sorted(tape.inputs, key=self.order)
        parameters = ", ".join(f"real {names.local(s.name)}" for s in ordered) or "void"
        head = f"static inline {kind} {name}({parameters})"
        if name in self.made:
            assert repr(self.made[name]) == repr(tape), f"two functions are called {name}"
        else:
            self.made[name] = tape
            printed = print_tape(tape, truth=kind == "bool", single=self.single)
            self.texts.append(function(head, _body(printed), about))
        return self.call(name, tape.inputs, place)


def _body(printed: Printed) -> list[str]:
    lines = [line for s in printed.statements for line in wrapped(s)]
    return [*lines, *wrapped(f"return {printed.expression};")]
