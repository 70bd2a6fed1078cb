"""A violation on the exported C: whether that asks for the same, and whether its monitor refuses it.

The state is asked of the program that `dl2c monitor --policy` writes, with the policy without its mask. What
it computes has to be what the exact judgement says, bit for bit: else one of both is wrong.
"""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from dl2c.emit.monitor.files import monitor_files
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.ir.evaluate import truth, value_of
from dl2c.ir.model import Bound, Symbol
from dl2c.monitor.check import Check, Controller, Run, after
from dl2c.native.program import answers, compile_program
from dl2c.policy.network import NetworkPolicy
from dl2c.policy_proof.exact import Violation, violation
from dl2c.policy_proof.question import Question

CONFIRMED = "the exported C asks for the same, and the monitor refuses it"
ACCEPTED = "the exported C asks for the same, but the monitor accepts it"
IMPOSSIBLE = "the exported C takes the same alternatives, and finds no values for them"
POSSIBLE = "the exported C takes the same alternatives, but finds values for them within its tolerance"

State = Mapping[str, float]


class Contradiction(Exception):
    """The exported C computes something else than what was judged exactly; the message says what."""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """What the exported C says of a violation. `state` is the one in which it was asked, a number for every
    variable and every constant that is not fixed; None where it was not asked.
    """

    confirmed: bool
    text: str
    state: State | None = None

    def to_json(self) -> dict[str, object]:
        return {"confirmed": self.confirmed, "text": self.text}


def confirmation(question: Question, found: Violation, unit: Unit, policy: NetworkPolicy) -> Confirmation:
    """Ask the exported C about a violation. Raises `Contradiction`, `CompileError`, `NativeError`."""
    nearest = {s: Fraction(_held(found.state[s.name], unit)) for s in question.dimensions}
    exact = violation(question, nearest)
    if exact is None:
        return Confirmation(
            False, f"the exported C is not asked: no state of {unit.real} numbers is this one"
        )
    state, lead, asked = _completed(exact, unit), dict(question.lead), replace(policy, masked=False)
    with tempfile.TemporaryDirectory() as folder:
        return _Exported(unit, asked, exact, state, lead, question.shares, Path(folder)).judged()


def _held(value: Fraction, unit: Unit) -> float:
    """The nearest number that the program holds."""
    return float(np.float32(float(value))) if unit.single else float(value)


def _completed(found: Violation, unit: Unit) -> dict[str, float]:
    """The state, with some value within bounds of each name on which nothing depends."""
    quantities = (*unit.monitor.model.variables, *unit.parameters)
    return {q.name: _held(found.state.get(q.name, _within(q.bound)), unit) for q in quantities}


def _within(bound: Bound) -> Fraction:
    low = bound.low if bound.low is not None else min(Fraction(0), bound.high or Fraction(0))
    return max(low, min(Fraction(0), bound.high if bound.high is not None else Fraction(0)))


@dataclass(frozen=True, slots=True)
class _Exported:
    """The exported program of a policy, and the violation that it is asked about: of requests, or where these
    are `shares` of what is admissible, of the alternatives that are taken.
    """

    unit: Unit
    policy: NetworkPolicy
    exact: Violation
    state: State
    lead: Mapping[str, int]
    shares: bool
    folder: Path

    @property
    def controller(self) -> Controller:
        assert self.unit.monitor.controller is not None
        return self.unit.monitor.controller

    @property
    def check(self) -> Check:
        return next(c for c in self.unit.monitor.checks if c.kind == "controller")

    def judged(self) -> Confirmation:
        """Compile, ask and compare. Raises `Contradiction`."""
        program = compile_program(monitor_files(self.unit, self.policy), self.folder)
        keys = [i.key for i in self.controller.inputs]
        given = [_held(self.exact.state.get(key, Fraction(0)), self.unit) for key in keys]
        given += [float(self.lead.get(d.key, 0)) for d in self.controller.measured]
        answer = answers(program, [self._line("asks", self.state, given)])[0].split()
        outputs = len(self.exact.outputs)
        asked = dict(zip(keys, map(float, answer[outputs : outputs + len(keys)]), strict=True))
        choices = tuple(map(int, answer[outputs + len(keys) :]))
        self._compare([Fraction(float(text)) for text in answer[:outputs]], asked, choices)
        if self.shares:
            numbers = [*asked.values(), *given[len(keys) :], *choices]
            impossible = answers(program, [self._line("run", self.state, numbers)])[0].split()[0] == "0"
            return Confirmation(impossible, IMPOSSIBLE if impossible else POSSIBLE, self.state)
        led = dict(self._led(asked, choices))
        verdicts = answers(program, [self._transition(state) for state in led.values()])
        passed = [run for run, verdict in zip(led, verdicts, strict=True) if verdict.split()[0] == "0"]
        text = f"{ACCEPTED}, {self._reason(passed[0], led[passed[0]])}" if passed else CONFIRMED
        return Confirmation(not passed, text, self.state)

    def _line(self, word: str, *parts: State | Sequence[float]) -> str:
        """A line for the program: states with the parameters after them, or numbers."""
        numbers: list[float] = []
        for part in parts:
            numbers += part.values() if isinstance(part, Mapping) else part
        return f"{word} {' '.join(map(repr, numbers))}"

    def _transition(self, led: State) -> str:
        names = [v.name for v in self.unit.monitor.model.variables]
        return self._line("controller", [self.state[n] for n in names], led)

    def _compare(
        self, outputs: Sequence[Fraction], asked: Mapping[str, float], choices: Sequence[int]
    ) -> None:
        """Raises `Contradiction` unless the program asks for what was judged."""
        found, wanted = self.exact, ", ".join(f"{n} = {v!r}" for n, v in self.state.items())
        if tuple(outputs) != found.outputs:
            ours, theirs = ([float(v) for v in values] for values in (found.outputs, outputs))
            raise Contradiction(f"with {wanted} the network gives {ours}, that of the exported C {theirs}")
        for name, value in asked.items():
            if name in found.requests and Fraction(value) != found.requests[name]:
                ours = float(found.requests[name])
                raise Contradiction(f"with {wanted} the policy asks for {name} = {ours}, its C for {value}")
        decisions = zip(self.controller.decisions, choices, strict=True)
        about = ", ".join(f"{d.key}={k}" for d, k in decisions if k >= 0)
        if about != found.about:
            raise Contradiction(f"with {wanted} the policy takes {found.about}, its C {about}")

    def _led(self, asked: Mapping[str, float], choices: Sequence[int]) -> Iterator[tuple[Run, State]]:
        """Where the control paths that are asked for lead, whether or not their tests hold."""
        values = {symbol: float(value) for symbol, value in self._values(self.state).items()}
        values |= {Symbol(key, "input"): value for key, value in asked.items()}
        measured = [self.lead.get(d.key, 0) for d in self.controller.measured]
        for run in self.controller.runs:
            updates = {name: value_of(term, values) for name, term in run.updates}
            taken = zip((*run.taken, *run.seen), (*choices, *measured), strict=True)
            if all(k in (-1, c) for k, c in taken):
                led = dict(self.state) | {n: float(v) for n, v in updates.items() if v is not None}
                if None not in updates.values():
                    yield run, led

    def _values(self, state: State) -> dict[Symbol, Fraction]:
        model = self.unit.monitor.model
        fixed = {c.symbol: c.value for c in model.constants if c.value is not None}
        names = (*model.variables, *self.unit.parameters)
        return fixed | {q.symbol: Fraction(state[q.name]) for q in names}

    def _reason(self, run: Run, led: State) -> str:
        """Why the monitor accepts a step. Raises `Contradiction` where it has no reason to."""
        values = self._values(self.state)
        values |= {after(v.name): Fraction(led[v.name]) for v in self.unit.monitor.model.variables}
        met = [
            all(truth(c.formula, values, exact=True) for c in case.conditions) for case in self.check.cases
        ]
        if met[run.case]:
            return "within its tolerance"
        if any(met):
            return "since another control path leads to the same state"
        sound = replace(self.unit, sound=True)
        program = compile_program(monitor_files(sound, self.policy), self.folder)
        if answers(program, [self._transition(led)])[0].split()[1] != "1":
            raise Contradiction(f"the exported monitor accepts a step from {self.state} to {led}")
        return "since it is violated by less than rounding"
