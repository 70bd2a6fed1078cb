"""Which states a controller may lead to: an interpreter of the program text, exact and on its own.

Two states and parameters are related where some control path, of those that choices, branches and
repetitions make, leads from one to the other up to where the first motion begins, or to the end of the
step, and the domain of that motion holds there. Over the reals.

A path is executed forward. A value `x := *` that a variable still shows at its end is read off the state
after. A hidden one stays unknown, and so does what is computed from it; whether there is a value for it is
asked at the end (`one_unknown`). The same decision made again, in a repetition, has the same outcome.

Most states are decided in doubles with error bounds, many at once; the others in exact numbers.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import assert_never

import numpy as np
from oracles import exact_numbers, rigorous_arrays
from oracles.exact_numbers import Unclear, Undefined, Value, conjoined, decided
from oracles.one_unknown import folded, satisfiable, unknowns
from oracles.rigorous_arrays import UNKNOWN, Bools, Doubles, Near

from dl2c.ir.model import (
    FALSE,
    And,
    Assign,
    AssignAny,
    Block,
    Choice,
    Compare,
    Evolve,
    Flow,
    Formula,
    If,
    Model,
    Number,
    Or,
    Repeat,
    Statement,
    Symbol,
    Term,
    Test,
    Truth,
)

Simple = Assign | AssignAny | Test
TRUE, FALSE_, UNDECIDED = 1, 0, -1


@dataclass(frozen=True, slots=True)
class Path:
    """Statements without choices; `shown` is a variable that has the value of an input at the end."""

    statements: tuple[Simple, ...]
    shown: Mapping[str, str]

    @property
    def hidden(self) -> frozenset[str]:
        """Inputs that no variable shows."""
        return frozenset(s.key for s in self.statements if isinstance(s, AssignAny)) - self.shown.keys()


def control_paths(model: Model) -> list[Path]:
    """All paths of a step up to its first motion."""
    found = _lines((*model.lead, *model.body), model.flows)
    lines = dict.fromkeys(statements for statements, _ in found)
    return [Path(one, _shown(one)) for one in lines]


def _lines(block: Block, flows: tuple[Flow, ...]) -> Iterator[tuple[tuple[Simple, ...], bool]]:
    """The ways through a block, and whether a motion begins at their end."""
    if not block:
        yield (), False
        return
    for first, moves in _ways(block[0], flows):
        if moves:
            yield first, True
        else:
            yield from ((first + rest, ended) for rest, ended in _lines(block[1:], flows))


def _ways(statement: Statement, flows: tuple[Flow, ...]) -> Iterator[tuple[tuple[Simple, ...], bool]]:
    match statement:
        case Assign() | AssignAny() | Test():
            yield (statement,), False
        case Choice(_, alternatives):
            for alternative in alternatives:
                yield from _lines(alternative.body, flows)
        case If(condition, otherwise, then, orelse):
            yield from _lines((Test(condition), *then), flows)
            yield from _lines((Test(otherwise), *orelse), flows)
        case Repeat(_, body, most):
            for times in range(most + 1):
                yield from _lines(body * times, flows)
        case Evolve(flow):
            yield (Test(flows[flow].domain),), True
        case _:
            raise NotImplementedError("loops without a limit")


def _shown(statements: tuple[Simple, ...]) -> dict[str, str]:
    origin: dict[str, str | None] = {}
    for statement in statements:
        match statement:
            case AssignAny(variable, key):
                origin |= {x: None for x, k in origin.items() if k == key} | {variable: key}
            case Assign(variable, Symbol(other, "variable")):
                origin[variable] = origin.get(other)
            case Assign(variable):
                origin[variable] = None
            case _:
                pass
    return {key: variable for variable, key in origin.items() if key is not None}


class Relation:
    """The relation of a model on rows of doubles: the state before, the state after, the parameters, each
    in the order of the model.
    """

    def __init__(self, model: Model) -> None:
        self.paths = control_paths(model)
        self.variables = [v.name for v in model.variables]
        self.parameters = [c.name for c in model.constants if c.value is None]
        self.fixed = {c.name: c.value for c in model.constants if c.value is not None}

    def judged(self, rows: Doubles) -> "np.ndarray[tuple[int], np.dtype[np.int8]]":
        """1 where the states are related, 0 where not, -1 where this interpreter cannot tell."""
        found = np.zeros(len(rows), np.int8)
        open_paths: dict[int, list[Path]] = {}
        for path in self.paths:
            surely, possibly = self._likely(path, rows)
            found[surely] = TRUE
            for k in np.flatnonzero(possibly & ~surely).tolist():
                open_paths.setdefault(k, []).append(path)
        for k, paths in open_paths.items():
            if found[k] != TRUE:
                found[k] = self._exactly(paths, rows[k].tolist())
        return found

    def _likely(self, path: Path, rows: Doubles) -> tuple[Bools, Bools]:
        """Where a path surely leads from one state to the other, and where it possibly does."""
        n, size = len(self.variables), len(rows)
        after = {x: Near(rows[:, n + k]) for k, x in enumerate(self.variables)}
        env = {Symbol(x, "variable"): Near(rows[:, k]) for k, x in enumerate(self.variables)}
        env |= {Symbol(c, "constant"): Near(rows[:, 2 * n + k]) for k, c in enumerate(self.parameters)}
        env |= {Symbol(c, "constant"): rigorous_arrays.near(v) for c, v in self.fixed.items()}
        surely = possibly = np.ones(size, np.bool_)
        tests: list[Formula] = []
        with np.errstate(all="ignore"):
            for statement in path.statements:
                match statement:
                    case Assign(variable, term):
                        env[Symbol(variable, "variable")] = rigorous_arrays.evaluate(term, env)
                    case AssignAny(variable, key):
                        value = after[path.shown[key]] if key in path.shown else UNKNOWN
                        env[Symbol(variable, "variable")] = value
                    case Test(formula):
                        s, p = rigorous_arrays.truths(formula, env, size)
                        surely, possibly = surely & s, possibly & p
            env |= {Symbol(x, "start"): value for x, value in after.items()}
            tests = [Compare("=", Symbol(x, "variable"), Symbol(x, "start")) for x in self.variables]
            s, p = rigorous_arrays.truths(And(tuple(tests)), env, size)
        return surely & s, possibly & p

    def _exactly(self, paths: Sequence[Path], row: Sequence[float]) -> int:
        n = len(self.variables)
        numbers = [Fraction(value) for value in row]
        before, after = (dict(zip(self.variables, numbers[k : k + n], strict=True)) for k in (0, n))
        given: dict[Symbol, Value] = {Symbol(x, "variable"): v for x, v in before.items()}
        given |= {Symbol(c, "constant"): v for c, v in self.fixed.items()}
        constants = zip(self.parameters, numbers[2 * n :], strict=True)
        given |= {Symbol(c, "constant"): v for c, v in constants}
        found = [decided(lambda path=path: leads(path, given, after)) for path in paths]
        return TRUE if any(found) else UNDECIDED if None in found else FALSE_


def leads(path: Path, before: Mapping[Symbol, Value], after: Mapping[str, Value]) -> bool | None:
    """Whether a path leads from one state to the other."""
    env, unknown = dict(before), list[Formula]()
    clear: bool | None = True

    def judge(formula: Formula) -> bool | None:
        told = _partly(formula, env) if path.hidden else exact_numbers.truth(formula, env)
        if told is None or isinstance(told, bool):
            return told
        unknown.append(told)
        return True

    for statement in path.statements:
        match statement:
            case Assign(variable, term):
                try:
                    env[Symbol(variable, "variable")] = _value(term, env)
                except Unclear:
                    return None
            case AssignAny(variable, key):
                value = after[path.shown[key]] if key in path.shown else Symbol(key, "input")
                env[Symbol(variable, "variable")] = value
            case Test(formula):
                clear = conjoined((clear, judge(formula)))
                if clear is False:
                    return False
    env |= {Symbol(x, "start"): value for x, value in after.items()}
    same = (judge(Compare("=", Symbol(x, "variable"), Symbol(x, "start"))) for x in after)
    clear = conjoined((clear, conjoined(same)))
    return conjoined((clear, satisfiable(unknown))) if clear is not False else False


def _value(term: Term, env: Mapping[Symbol, Value]) -> Value:
    """A number, a term of hidden inputs, or None where it is undefined."""
    try:
        if any(isinstance(env[s], Term) for s in unknowns(term)):
            found = _substituted(term, env)
            return found.value if isinstance(found, Number) else found
        return exact_numbers.evaluate(term, env)
    except Undefined:
        return None


def _substituted(term: Term, env: Mapping[Symbol, Value]) -> Term:
    values = {s: env[s] for s in unknowns(term)}
    if None in values.values():
        raise Undefined
    if any(not isinstance(v, Term | Fraction) for v in values.values()):
        raise Unclear
    return folded(term, {s: Number(v) if isinstance(v, Fraction) else v for s, v in values.items()})


def _partly(formula: Formula, env: Mapping[Symbol, Value]) -> bool | Formula | None:
    """The truth of a formula, or what it says of hidden inputs."""
    if not any(isinstance(env[s], Term) for s in unknowns(formula)):
        return exact_numbers.truth(formula, env)
    match formula:
        case Compare(op, left, right):
            try:
                return Compare(op, _substituted(left, env), _substituted(right, env))
            except Undefined:
                return False
            except Unclear:
                return None
        case And(children) | Or(children):
            formulas: list[Formula] = []
            for part in [_partly(c, env) for c in children]:
                if part is None:
                    return None
                formulas.append(part if not isinstance(part, bool) else And(()) if part else FALSE)
            return type(formula)(tuple(formulas))
        case Truth():
            raise AssertionError("a truth value has no hidden input")
        case _:
            assert_never(formula)
