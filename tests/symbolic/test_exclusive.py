"""Threads that make tapes at once: CasADi has one of them at a time."""

import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from threading import Thread
from traceback import walk_tb
from typing import Any

import pytest

from dl2c.configuration import resolve_options
from dl2c.ir.model import Add, Compare, Div, Mul, Number, Symbol
from dl2c.pipeline import Compilation
from dl2c.source import Source
from dl2c.symbolic.exclusive import CASADI
from dl2c.symbolic.lie import lie_tape, partial_tape
from dl2c.symbolic.tape import defined_tape, formula_tape, term_tape
from dl2c.symbolic.terms import Builder, casadi

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
X = Symbol("x", "variable")
HALF = Number(Fraction(1, 2))
TERM = Div(Mul(X, X), Add(X, HALF))

TAPES: dict[str, Callable[[], object]] = {
    "term": lambda: term_tape(Builder(), TERM),
    "formula": lambda: formula_tape(Builder(), Compare("<=", TERM, HALF)),
    "defined": lambda: defined_tape(Builder(), [TERM]),
    "lie": lambda: lie_tape(Builder(), TERM, [("x", HALF)]),
    "partial": lambda: partial_tape(Builder(), TERM, X),
}

MANY = """
import time
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from random import Random

from dl2c.ir.model import Number
from dl2c.symbolic.tape import term_tape
from dl2c.symbolic.terms import Builder


def work(seed):
    rng, end = Random(seed), time.monotonic() + 60
    while time.monotonic() < end:
        term_tape(Builder(), Number(rng.randrange(3) + Fraction(1, 2)))


with ThreadPoolExecutor(3) as pool:
    list(pool.map(work, range(3)))
"""
"""Constants that are made and dropped all the time; without turns this ends by a signal within a minute."""

FORKED = """
import os
import signal
import time
from threading import Event, Thread

from dl2c.ir.model import Symbol
from dl2c.symbolic.exclusive import CASADI
from dl2c.symbolic.tape import term_tape
from dl2c.symbolic.terms import Builder

begun = Event()


def busy():
    with CASADI:
        begun.set()
        time.sleep(0.5)


Thread(target=busy).start()
begun.wait()
if (child := os.fork()) == 0:
    signal.alarm(60)
    term_tape(Builder(), Symbol("x", "variable"))
    os._exit(0)
_, status = os.waitpid(child, 0)
raise SystemExit(os.waitstatus_to_exitcode(status))
"""
"""A copy of the process, made while a thread that it does not have is in CasADi."""


@pytest.mark.parametrize("kind", TAPES)
def test_no_two_threads_are_in_casadi_at_once(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    inside: list[object] = []
    together: list[int] = []
    cse = casadi.cse

    def slow(graph: Any) -> Any:
        inside.append(graph)
        together.append(len(inside))
        time.sleep(0.01)
        inside.pop()
        return cse(graph)

    monkeypatch.setattr(casadi, "cse", slow)
    with ThreadPoolExecutor(3) as pool:
        made = list(pool.map(lambda _: TAPES[kind](), range(6)))
    assert len(together) == 6 and max(together) == 1
    assert made == [TAPES[kind]()] * 6


def test_threads_write_the_code_that_one_thread_writes() -> None:
    names = ("waypoint", "pendulum", "dubins", "acc")
    with ThreadPoolExecutor(3) as pool:
        made = list(pool.map(written, names))
    assert made == [written(name) for name in names]


def written(example: str) -> dict[str, str]:
    """The C of an example, from its text on."""
    model = Compilation(Source.read(EXAMPLES / f"{example}.kyx"), resolve_options({}))
    return model.emitted(model.claim())


def test_expressions_are_dropped_in_turn_too() -> None:
    builders = [Builder()]
    term_tape(builders[0], TERM)
    dropping = Thread(target=builders.clear)
    with CASADI:
        dropping.start()
        dropping.join(0.2)
        assert dropping.is_alive()
    dropping.join(60)
    assert not dropping.is_alive()


def test_a_tape_that_fails_keeps_no_expression(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(graph: Any) -> Any:
        raise MemoryError

    monkeypatch.setattr(casadi, "cse", failing)
    with pytest.raises(MemoryError) as failure:
        term_tape(Builder(), TERM)
    frames = [frame for frame, _ in walk_tb(failure.value.__traceback__)]
    kept = [value for frame in frames for value in frame.f_locals.values()]
    assert len(frames) >= 4 and not any(isinstance(value, casadi.SX) for value in kept)


def test_a_forked_copy_has_casadi_for_itself() -> None:
    run(FORKED)


@pytest.mark.slow
def test_threads_that_make_tapes_do_no_harm() -> None:
    run(MANY)


def run(program: str) -> None:
    command = [sys.executable, "-W", "ignore", "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
