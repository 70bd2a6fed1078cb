"""The values of inputs in C: where the tests on a path may change, and whether a value passes.

Sections, in order: leaf functions (through `Leaves`), `model_limits`, `model_criticals`,
`model_pins`, `model_admits`, `model_refuses`.
"""

from collections.abc import Callable, Iterator

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import function, place, wrapped
from dl2c.emit.hulls import refutation
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import slot
from dl2c.emit.plan import BuildPlan
from dl2c.ir.doubles import rounded_down, rounded_up
from dl2c.ir.model import TRUE, ZERO, Symbol
from dl2c.ir.polynomial import Coefficients
from dl2c.ir.printer import print_formula, print_term
from dl2c.paths.admission import Admission, Solved
from dl2c.paths.path import Input, Path
from dl2c.paths.zeros import zero_count
from dl2c.symbolic.tape import formula_tape

STATE = "int path, int input, const real *x, const real *p, const real *u"


def input_functions(build: BuildPlan, leaves: Leaves) -> list[str]:
    """The functions that the runtime asks about the values of inputs: those of no_inputs.h where there are
    none."""
    if not any(path.admissions for path in build.paths.paths):
        return ['#include "no_inputs.h"\n']
    return [
        _limits(build, leaves),
        _criticals(build, leaves),
        _pins(build, leaves),
        _admits(build, leaves),
        *_refuses(build, leaves),
    ]


def critical_count(build: BuildPlan) -> int:
    """How many roots `model_criticals` gives at most."""
    found = (a for path in build.paths.paths for a in path.admissions)
    return max((sum(zero_count(len(c) - 1) for c in a.criticals) for a in found), default=0)


def _limits(build: BuildPlan, leaves: Leaves) -> str:
    def lines(k: int, path: Path, admission: Admission) -> Iterator[str]:
        name = build.paths.inputs[admission.input].variable
        for j, limit in enumerate(admission.limits):
            stem = f"path{k}_limit{admission.input}_{j}"
            offset = f"{print_term(limit.offset)} + ... * {name}"
            slope = f"... + ({print_term(limit.slope)}) * {name}"
            arguments = (
                leaves.term(f"{stem}_offset", limit.offset, offset),
                leaves.term(f"{stem}_slope", limit.slope, slope),
            )
            yield f"dl2c_limit({', '.join(arguments)}, low, high);"

    return function(
        f"DL2C_INLINE void model_limits({STATE}, real *low, real *high)",
        _each(build, lines),
        "Narrows the values of an input to those its tests leave, up to rounding.",
    )


def _criticals(build: BuildPlan, leaves: Leaves) -> str:
    def lines(k: int, path: Path, admission: Admission) -> Iterator[str]:
        if not admission.criticals:
            return
        name = build.paths.inputs[admission.input].variable
        yield "int n = 0;"
        for j, polynomial in enumerate(admission.criticals):
            stem = f"path{k}_critical{admission.input}_{j}"
            if len(polynomial) <= 3:
                yield f"n = dl2c_roots({_coefficients(leaves, stem, polynomial, name)}, root, n);"
            else:
                between = _between(leaves, stem, polynomial, build.paths.inputs[admission.input])
                yield f"n = dl2c_zeros({between}, true, root, n);"
        yield "return n;"

    return function(
        f"static inline int model_criticals({STATE}, real *root)",
        [*_each(build, lines), "return 0;"],
        "Where the tests of an input may begin or cease to hold, in no order; how many.",
    )


def _pins(build: BuildPlan, leaves: Leaves) -> str:
    def lines(k: int, path: Path, admission: Admission) -> Iterator[str]:
        for solved in admission.solved:
            if solved.polynomial == admission.pin:
                stem = f"path{k}_{solved.symbol.name}"
                if len(solved.polynomial) <= 3:
                    coefficients = _coefficients(leaves, stem, solved.polynomial, solved.input.name)
                    yield f"return dl2c_pins({coefficients}, root);"
                else:
                    given = build.paths.inputs[admission.input]
                    between = _between(leaves, stem, solved.polynomial, given)
                    yield f"return dl2c_pin_zeros({between}, root);"
                return

    return function(
        f"static inline int model_pins({STATE}, real *root)",
        [*_each(build, lines), "return -1;"],
        "The only values that an equality leaves to an input, up to its Box; -1 where none does.",
    )


def _admits(build: BuildPlan, leaves: Leaves) -> str:
    inputs = {given.key: given for given in build.paths.inputs}

    def lines(k: int, path: Path, admission: Admission) -> Iterator[str]:
        if admission.condition == TRUE:
            return
        about = f"{place(path.span)}  {print_formula(admission.tests)}"
        solved = {s.symbol: _solved(leaves, k, s, inputs[s.input.name]) for s in admission.solved}

        def where(symbol: Symbol) -> str:
            return solved.get(symbol) or slot(symbol)

        call = leaves.condition(f"path{k}_admits{admission.input}", admission.condition, about, where)
        yield f"return {call};"

    return function(
        f"DL2C_INLINE bool model_admits({STATE})",
        [*_each(build, lines), "return true;"],
        "Whether the value of an input passes the tests of it and of no later input.",
    )


def _refuses(build: BuildPlan, leaves: Leaves) -> Iterator[str]:
    def lines(k: int, path: Path, admission: Admission) -> Iterator[str]:
        own = path.admissions.index(admission)
        asked = any(other.following == own for other in path.admissions)
        if not asked or admission.solved or admission.condition == TRUE:
            return
        tape = formula_tape(leaves.builder, admission.condition)
        slots = {s.name: slot(s) for s in tape.inputs}
        moving = build.paths.inputs[admission.input].key
        yield from refutation(tape, slots.__getitem__, moving, "z") or ()

    if body := _each(build, lines):
        yield "#define DL2C_REFUSES\n"
        yield function(
            f"static inline bool model_refuses({STATE}, dl2c_hull z)",
            [*body, "return false;"],
            "Whether no double of an input in z passes the tests that model_admits looks at, as far as "
            "intervals prove that.",
        )


def _solved(leaves: Leaves, k: int, solved: Solved, given: Input) -> str:
    """An expression that is 1 where the input is a root, else 0."""
    stem = f"path{k}_{solved.symbol.name}"
    if len(solved.polynomial) <= 3:
        coefficients = _coefficients(leaves, stem, solved.polynomial, solved.input.name)
        call = f"dl2c_solves({coefficients}, {slot(solved.input)})"
    else:
        between = _between(leaves, stem, solved.polynomial, given)
        call = f"dl2c_is_zero({between}, {slot(solved.input)})"
    defined = leaves.defined(f"{stem}_defined", list(solved.polynomial), "all of these have a value")
    return call if defined is None else f"{defined} * {call}"


def _coefficients(leaves: Leaves, stem: str, polynomial: Coefficients, name: str) -> str:
    """Its coefficients up to the square as arguments."""
    padded = (*polynomial, ZERO, ZERO)[:3]
    texts = [f"... + ({print_term(c)}) * {name}^{j}" for j, c in enumerate(padded)]
    return ", ".join(leaves.term(f"{stem}_c{j}", c, texts[j]) for j, c in enumerate(padded))


def _between(leaves: Leaves, stem: str, polynomial: Coefficients, given: Input) -> str:
    """All its coefficients, its degree and the ends of the input's Box as arguments."""
    texts = [f"... + ({print_term(c)}) * {given.key}^{j}" for j, c in enumerate(polynomial)]
    low, high = number(rounded_up(given.low)), number(rounded_down(given.high))
    values = ", ".join(leaves.term(f"{stem}_c{j}", c, texts[j]) for j, c in enumerate(polynomial))
    return f"(const real[]){{{values}}}, {len(polynomial) - 1}, {low}, {high}"


def _each(build: BuildPlan, lines: Callable[[int, Path, Admission], Iterator[str]]) -> list[str]:
    """A case for every input of every path that has something to say."""
    body: list[str] = []
    for k, path in enumerate(build.paths.paths):
        for admission in path.admissions:
            own = [part for line in lines(k, path, admission) for part in wrapped(line)]
            if own:
                body.append(f"if (path == {k} && input == {admission.input}) {{")
                body += [*(f"  {line}" for line in own), "}"]
    return body
