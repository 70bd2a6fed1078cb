"""Several solvers, asked at once whether a formula of real arithmetic has a solution.

A question comes in as SMT-LIB text; the first definite answer goes out. Solvers run in processes of their
own: they are stopped when another one has answered, and when their time is over.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from selectors import EVENT_READ, DefaultSelector
from typing import Any, Literal, Self, TypeAlias

from dl2c.interruption import later

Verdict: TypeAlias = Literal["sat", "unsat", "unknown"]
Solver: TypeAlias = Literal["z3-nlsat", "z3", "cvc5"]

SOLVERS: tuple[Solver, ...] = ("z3-nlsat", "z3", "cvc5")
"""In the order in which they are asked, as many at once as there are jobs."""

PATIENCE = 1.5
"""Seconds after the limit of a question in which a process must have answered."""

LAST = 1.0
"""Seconds in which a process that is told to end must have ended its own."""


class SolverContradiction(Exception):
    """One solver says that a formula has a solution, another one that it has none."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """`values` are exact, or decimal text of irrational numbers; only with "sat", and not from cvc5."""

    verdict: Verdict
    solver: str = ""
    values: Mapping[str, Fraction | str] = field(default_factory=dict[str, Fraction | str])


UNDECIDED = Outcome("unknown")


class _Process:
    """One process of `worker`, which is asked one question at a time."""

    def __init__(self) -> None:
        path = os.pathsep.join(p for p in sys.path if p)
        with later():
            self.popen: subprocess.Popen[bytes] = subprocess.Popen(
                [sys.executable, "-m", "dl2c.smt.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, "PYTHONPATH": path},
            )
        self.knows_cvc5 = bool(self.read().get("cvc5"))

    def ask(self, question: dict[str, Any]) -> None:
        self._send(json.dumps(question).encode())

    def stop(self) -> None:
        """Give up what it works on, whose answer is read and dropped."""
        self._send(b"")
        self.read()

    def _send(self, line: bytes) -> None:
        """A process that is gone says so by its empty answer."""
        assert self.popen.stdin is not None
        with suppress(OSError):
            self.popen.stdin.write(line + b"\n")
            self.popen.stdin.flush()

    def read(self) -> dict[str, Any]:
        """The next answer; empty where the process is gone."""
        assert self.popen.stdout is not None
        line = self.popen.stdout.readline()
        return json.loads(line) if line else {}

    def end(self) -> None:
        """Stop it, and whatever it works on."""
        assert self.popen.stdin is not None and self.popen.stdout is not None
        with suppress(OSError):
            self.popen.stdin.close()
        try:
            self.popen.wait(LAST)
        except subprocess.TimeoutExpired:
            self.popen.kill()
            self.popen.wait()
        self.popen.stdout.close()


class Portfolio:
    """Solvers in `jobs` processes. `only` says which to ask; cvc5 is left out where it is not installed. With
    `agree` all of them are heard, and cvc5 where one alone is asked.
    """

    def __init__(self, jobs: int = 2, only: Sequence[Solver] = SOLVERS, agree: bool = False) -> None:
        self.jobs = max(1, jobs)
        self.agree = agree
        self._only = tuple(only)
        self._processes: list[_Process] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all processes."""
        for process in self._processes:
            process.end()
        self._processes = []

    @property
    def solvers(self) -> tuple[Solver, ...]:
        """Those that are there."""
        self._start()
        return tuple(s for s in self._only if s != "cvc5" or self._processes[0].knows_cvc5)

    def _start(self) -> None:
        while len(self._processes) < self.jobs:
            self._processes.append(_Process())

    def ask(
        self, text: str, seconds: float, names: Sequence[str] = (), only: Solver | None = None
    ) -> Outcome:
        """The first definite answer, with `only` that of this solver.

        Each solver gets a fair share of `seconds`. Raises `SolverContradiction`.
        """
        self._start()
        waiting: list[Solver] = [s for s in self.solvers if only in (None, s) or (self.agree and s == "cvc5")]
        rounds = -(-len(waiting) // self.jobs)
        share = seconds / rounds
        found = UNDECIDED
        with DefaultSelector() as selector:
            running: dict[int, tuple[_Process, str, float]] = {}
            while waiting or running:
                self._fill(waiting, running, selector, text, share, names)
                for outcome in self._heard(running, selector):
                    found = _agreed(found, outcome)
                if found.verdict != "unknown" and not self.agree:
                    waiting.clear()
                    for process, _, _ in running.values():
                        process.stop()
                    running.clear()
        return found

    def _fill(
        self,
        waiting: list[Solver],
        running: dict[int, tuple[_Process, str, float]],
        selector: DefaultSelector,
        text: str,
        seconds: float,
        names: Sequence[str],
    ) -> None:
        """Give every free process a solver to run."""
        for k, process in enumerate(self._processes):
            if k not in running and waiting:
                solver = waiting.pop(0)
                question = {"id": k, "solver": solver, "text": text, "seconds": seconds, "names": list(names)}
                process.ask(question)
                assert process.popen.stdout is not None
                selector.register(process.popen.stdout, EVENT_READ, k)
                running[k] = (process, solver, time.monotonic() + seconds + PATIENCE)

    def _heard(
        self, running: dict[int, tuple[_Process, str, float]], selector: DefaultSelector
    ) -> list[Outcome]:
        """The answers that have come; a process that is late or gone is replaced."""
        latest = min(until for _, _, until in running.values())
        ready = {key.data for key, _ in selector.select(max(0.0, latest - time.monotonic()))}
        outcomes: list[Outcome] = []
        for k, (process, solver, until) in list(running.items()):
            if k not in ready and time.monotonic() < until:
                continue
            assert process.popen.stdout is not None
            selector.unregister(process.popen.stdout)
            answer = process.read() if k in ready else {}
            del running[k]
            if answer:
                outcomes.append(_outcome(answer, solver))
            else:
                process.end()
                self._processes[k] = _Process()
        return outcomes


def _outcome(answer: dict[str, Any], solver: str) -> Outcome:
    values = {name: _number(text) for name, text in answer["values"].items()}
    return Outcome(answer["verdict"], solver, values)


def _number(text: str) -> Fraction | str:
    return text if text.endswith("?") else Fraction(text)


def _agreed(known: Outcome, other: Outcome) -> Outcome:
    """The better of two answers: definite, with values. Raises `SolverContradiction`."""
    if "unknown" in (known.verdict, other.verdict):
        return other if known.verdict == "unknown" else known
    if known.verdict != other.verdict:
        raise SolverContradiction(f"{known.solver}: {known.verdict}, {other.solver}: {other.verdict}")
    return other if known.solver == "cvc5" else known
