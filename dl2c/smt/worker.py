"""The process that runs solvers: `python -m dl2c.smt.worker`, started by `portfolio`.

Each line on stdin is a question in JSON: solver, SMT-LIB text, seconds, names whose values are wanted.
A child of its own works on it, so that a solver that ignores its limit of time is stopped. What takes long
to make is made here, before anything is asked, and each child has a copy. Each answer is a line of JSON on
stdout. A line that comes while a child works stops it, and is not read.
"""

import importlib.util
import json
import os
import resource
import select
import signal
import sys
import time
from contextlib import suppress
from typing import Any

from dl2c.smt.terms import z3

GRACE = 0.5
"""Seconds that a solver gets beyond its limit before it is stopped."""

BYTES = 3 * 1024**3
"""Memory of a child."""

CONTEXT = z3.Context()
"""Used by children alone, of which each has a copy."""

NOTHING: dict[str, Any] = {"verdict": "unknown", "values": {}}


def main() -> None:
    """Answer questions until stdin is closed, or nobody reads the answers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        _answer_all()
    except BrokenPipeError:
        os._exit(0)


def _answer_all() -> None:
    waiting = b""
    print(json.dumps({"cvc5": importlib.util.find_spec("cvc5") is not None}), flush=True)
    while data := os.read(0, 1 << 16):
        *lines, waiting = (waiting + data).split(b"\n")
        for line in lines:
            if line.strip():
                _answer(json.loads(line))


def _answer(question: dict[str, Any]) -> None:
    if question["solver"] == "cvc5":
        with suppress(Exception):  # the child says what is wrong
            _import_cvc5()
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        _work(question, writing)
    os.close(writing)
    until = time.monotonic() + question["seconds"] + GRACE
    found = b""
    while True:
        ready, _, _ = select.select([0, reading], [], [], max(0.0, until - time.monotonic()))
        data = os.read(reading, 1 << 16) if reading in ready else b""
        found += data
        if not data or (0 in ready and reading not in ready):
            break
    os.close(reading)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    try:
        answer = json.loads(found)
    except ValueError:
        answer = NOTHING
    print(json.dumps({"id": question["id"], **answer}), flush=True)


def _work(question: dict[str, Any], writing: int) -> None:
    """In the child, which ends here."""
    try:
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        most = BYTES if most == resource.RLIM_INFINITY else min(BYTES, most)
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        ask = _cvc5 if question["solver"] == "cvc5" else _z3
        answer = ask(question)
    except BaseException as failure:  # the child has nobody else to tell
        answer = {**NOTHING, "failure": f"{type(failure).__name__}: {failure}"[:200]}
    with suppress(OSError), os.fdopen(writing, "w") as out:
        json.dump(answer, out)
    os._exit(0)


def _z3(question: dict[str, Any]) -> dict[str, Any]:
    if question["solver"] == "z3-nlsat":
        solver = z3.Then(
            "simplify", "purify-arith", "propagate-values", "solve-eqs", "qfnra-nlsat", ctx=CONTEXT
        )
        solver = solver.solver()
    else:
        solver = z3.Solver(ctx=CONTEXT)
    solver.set("timeout", max(1, int(question["seconds"] * 1000)))
    solver.add(*z3.parse_smt2_string(question["text"], ctx=CONTEXT))
    verdict = solver.check()
    if verdict != z3.sat:
        return {"verdict": "unsat" if verdict == z3.unsat else "unknown", "values": {}}
    model = solver.model()
    values = {name: _value(model.eval(z3.Real(name, CONTEXT), True)) for name in question["names"]}
    return {"verdict": "sat", "values": values}


def _value(value: Any) -> str:
    """A fraction, or a decimal ending in `?`."""
    if z3.is_rational_value(value):
        return f"{value.numerator_as_long()}/{value.denominator_as_long()}"
    return str(value.as_decimal(30)) if z3.is_algebraic_value(value) else "0?"


def _import_cvc5() -> Any:
    import cvc5 as untyped_cvc5  # pyright: ignore[reportMissingImports]

    return untyped_cvc5


def _cvc5(question: dict[str, Any]) -> dict[str, Any]:
    cvc5 = _import_cvc5()
    solver = cvc5.Solver()
    solver.setOption("tlimit-per", str(max(1, int(question["seconds"] * 1000))))
    parser = cvc5.InputParser(solver)
    parser.setStringInput(cvc5.InputLanguage.SMT_LIB_2_6, question["text"], "query")
    symbols = parser.getSymbolManager()
    while not (command := parser.nextCommand()).isNull():
        command.invoke(solver, symbols)
    verdict = solver.checkSat()
    known = "unsat" if verdict.isUnsat() else "sat" if verdict.isSat() else "unknown"
    return {"verdict": known, "values": {}}


if __name__ == "__main__":
    sys.exit(main())
