"""Leaf functions: one term or condition each, scalars in, one scalar out.

A leaf is pure and knows nothing of arrays, so the same text serves the simulator, its
vectorised form and the monitor. Adapters call leaves with `call`; a term that is only a
name or a number gets no function.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace

from dl2c.emit import names
from dl2c.emit.cexpr import Printed, print_tape
from dl2c.emit.cfile import WIDTH, function, wrapped
from dl2c.emit.derived import Derived
from dl2c.ir.model import Flow, Formula, Symbol, Term
from dl2c.symbolic.lie import lie_tape, partial_tape
from dl2c.symbolic.tape import Tape, defined_tape, formula_tape, term_tape
from dl2c.symbolic.terms import Builder
from dl2c.work import spend

Place = Callable[[Symbol], str]


@dataclass(slots=True)
class Leaves:
    """The leaf functions of one file, in the order they are made. `order` ranks parameters; `single` is
    for a file whose numbers are floats. Where functions are `shared`, those of the same parameters and
    body are one, under the first of their names. `taken` are the names of the model, `derived` its derived
    constants.
    """

    builder: Builder
    order: Callable[[Symbol], int]
    single: bool = False
    shared: bool = False
    taken: Collection[str] = ()
    derived: Derived = field(default_factory=Derived)
    texts: list[str] = field(default_factory=list[str])
    made: dict[str, Tape] = field(default_factory=dict[str, Tape])
    called: dict[str, str] = field(default_factory=dict[str, str])
    bodies: dict[tuple[str, ...], str] = field(default_factory=dict[tuple[str, ...], str])
    tapes: dict[Term, Tape] = field(default_factory=dict[Term, Tape])

    def apart(self) -> "Leaves":
        """No leaf functions yet, for another file about the same model."""
        return replace(self, texts=[], made={}, called={}, bodies={})

    def tape(self, term: Term) -> Tape:
        """The tape of a term, which many functions may ask for."""
        if (found := self.tapes.get(term)) is None:
            found = self.tapes[term] = term_tape(self.builder, term)
        return found

    def term(self, name: str, term: Term, about: str, place: Place = names.slot) -> str:
        """An expression for a term's value, each symbol read where `place` says."""
        return self._leaf(name, self.tape(term), "real", about, place)

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

    def same_operations(self, first: Term, second: Term, values: Mapping[str, float]) -> bool:
        """Whether two terms are computed by the same operations, with numbers for symbols of the first."""
        known: dict[tuple[object, ...], int] = {}
        tapes = self.tape(first), self.tape(second)
        left, right = (_interned(tape, values, known) for tape in tapes)
        return left == right

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
        if name in self.made:
            assert repr(self.made[name]) == repr(tape), f"two functions are called {name}"
        else:
            self.made[name] = tape
            self._define(name, tape, kind, about)
        return self.call(self.called[name], tape.inputs, place)

    def _define(self, name: str, tape: Tape, kind: str, about: str) -> None:
        """Adds the function, unless there is one to share."""
        parameter = _parameters(tape.inputs)
        ordered = sorted(tape.inputs, key=self.order)
        parameters = ", ".join(f"real {parameter[s.name]}" for s in ordered) or "void"
        body = _body(print_tape(tape, lambda n: parameter[n], kind == "bool", self.single))
        key = (kind, parameters, *body)
        self.called[name] = self.bodies.setdefault(key, name) if self.shared else name
        if self.called[name] == name:
            self.texts.append(function(f"static inline {kind} {name}({parameters})", body, about))


def _parameters(inputs: tuple[Symbol, ...]) -> dict[str, str]:
    """Parameters by symbol: all have names of their own, but for the only slack of a margin."""
    made = {s.name: names.local(s.name) for s in inputs}
    slacks = [s.name for s in inputs if s.kind == "start"]
    if len(slacks) == 1 and "slack" in slacks[0] and "slack" not in made:
        made[slacks[0]] = "slack"
    return made


def _interned(tape: Tape, values: Mapping[str, float], known: dict[tuple[object, ...], int]) -> int:
    """The number of a tape's result in a table of operations over operations."""
    numbers: list[int] = []
    for step in tape.instructions:
        operation, value = step.operation, step.value
        if operation == "input" and step.name in values:
            operation, value = "constant", values[step.name]
        name = step.name if operation == "input" else ""
        key = (operation, name, repr(value), *(numbers[a] for a in step.args))
        numbers.append(known.setdefault(key, len(known)))
    return numbers[tape.result]


def _body(printed: Printed) -> list[str]:
    lines = [line for s in printed.statements for line in wrapped(s)]
    return [*lines, *wrapped(f"return {printed.expression};")]


@dataclass(slots=True)
class Locals:
    """What one function computes of terms in place. Variables and constants are read into locals that have
    their names.
    """

    leaves: Leaves
    place: Place = names.slot
    lines: list[str] = field(default_factory=list[str])
    held: dict[Symbol, str] = field(default_factory=dict[Symbol, str])
    count: int = 0

    def symbol(self, symbol: Symbol) -> str:
        """The local that holds a symbol; values from where a flow began are read in place."""
        if symbol.kind == "start":
            return self.place(symbol)
        return self.held.setdefault(symbol, names.beside(symbol.name))

    def term(self, term: Term) -> str:
        """An expression for a term's value; `lines` come before it."""
        tape = self.leaves.tape(term)
        held = {s.name: self.symbol(s) for s in tape.inputs}
        stem = names.stem("t", self.leaves.taken)
        printed = print_tape(tape, lambda n: held[n], single=self.leaves.single, stem=stem, first=self.count)
        self.count += len(printed.statements)
        self.lines += [line for s in printed.statements for line in wrapped(s)]
        return printed.expression

    def begun(self) -> list[str]:
        """The function's first statements: locals, then what terms share."""
        held = sorted(self.held, key=self.leaves.order)
        read = [f"{self.held[s]} = {self.place(s)}" for s in held]
        return [*(_declared(read) if read else []), *self.lines]


def _declared(parts: list[str]) -> list[str]:
    """Declarations of constants, as many on a line as fit."""
    rows: list[list[str]] = [[]]
    for part in parts:
        if rows[-1] and len(", ".join([*rows[-1], part])) > WIDTH - 20:
            rows.append([])
        rows[-1].append(part)
    return [f"const real {', '.join(row)};" for row in rows]
