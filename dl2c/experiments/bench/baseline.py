"""The usual way to run a hybrid program in Python, to compare with: the recipe of "Gymnasium dL" (eq. 1).

Made from the same step model as the C: guards, assignments, rewards and ends as Python functions,
flows by `scipy.integrate.solve_ivp` with a terminal event for each condition of the domain, up to the
time at which a clock ends them. The functions are compiled from straight-line source text, so that no
tree is walked at run time. The policy is that of a request of zeros: the first enabled alternative,
inputs nearest to zero.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import isfinite
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import (
    solve_ivp,  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType] # scipy publishes no types
)

from dl2c.experiments.bench.python_source import NAMESPACE, formula_source, margin_source, term_source
from dl2c.ir.logic import conjuncts, symbols
from dl2c.ir.model import Compare, Flow, Formula, Model, Predicate, Symbol, Term, Trigger
from dl2c.paths.admission import Admission
from dl2c.paths.path import END, Input, Path, Paths
from dl2c.paths.zeros import roots

RTOL = 1e-6
"""Relative tolerance of `solve_ivp`."""

NUDGE = 1e-12
"""How far beside a root its neighbours are, relatively."""

Row: TypeAlias = tuple[float, ...]
"""A state in the order of `Model.variables`, or constants in that of `Model.constants`."""

Start: TypeAlias = tuple[Row, Row]
"""An initial state and its constants."""

PathFunction: TypeAlias = Callable[[Row, Row], Row | None]
FlowFunction: TypeAlias = Callable[[Row, Row], tuple[Row, float]]

# Source text ------------------------------------------------------------------


def baseline_source(model: Model, paths: Paths, observed: Sequence[str]) -> str:
    """The Python functions of a model: `path_<k>`, `flow_<k>`, `judge` and `observe`."""
    parts = [
        *(_path(model, paths, k) for k in range(len(paths.paths))),
        *(_flow(model, k, flow) for k, flow in enumerate(model.flows)),
        _judge(model),
        _function(model, "observe", [f"return array({_row(_observed(model, observed))}, float32)"]),
    ]
    return "\n\n".join(parts) + "\n"


def _function(model: Model, name: str, body: Iterable[str]) -> str:
    """A function of state `x` and constants `p`, with both unpacked."""
    unpacked = [
        f"{_row(names)} = {vector}"
        for vector, names in (("x", _variables(model)), ("p", [f"P_{c.name}" for c in model.constants]))
        if names
    ]
    return "\n    ".join([f"def {name}(x, p):", *unpacked, *body])


def _variables(model: Model) -> list[str]:
    return [f"X_{v.name}" for v in model.variables]


def _row(items: Iterable[str]) -> str:
    """A tuple; also where it has one entry."""
    return f"({''.join(f'{item}, ' for item in items)})"


def _observed(model: Model, names: Iterable[str]) -> list[str]:
    variables = {v.name for v in model.variables}
    return [f"X_{name}" if name in variables else f"P_{name}" for name in names]


def _path(model: Model, paths: Paths, k: int) -> str:
    """`path_<k>`: the state after tests, inputs and assignments of a path, None where it is not enabled."""
    path = paths.paths[k]
    lines = [f"if not {formula_source(path.guard)}: return None"]
    margin = ""
    for admission in path.admissions:
        given = paths.inputs[admission.input]
        own = (
            _interval(given, admission, "continue" if margin else "return None")
            if admission.is_interval
            else _union(given, admission)
        )
        lines += [margin + line for line in own]
        margin += "" if admission.is_interval else "    "
    updates = {name: term_source(term) for name, term in path.updates}
    lines.append(f"{margin}return {_row(updates.get(v.name, f'X_{v.name}') for v in model.variables)}")
    return _function(model, f"path_{k}", lines)


def _interval(given: Input, admission: Admission, otherwise: str) -> Iterator[str]:
    """The admissible value of an input that is nearest to zero, `otherwise` where there is none."""
    yield f"low, high = {float(given.low)!r}, {float(given.high)!r}"
    for limit in admission.limits:
        yield f"offset, slope = {term_source(limit.offset)}, {term_source(limit.slope)}"
        yield "if slope > 0.0: low = max(low, -offset / slope)"
        yield "elif slope < 0.0: high = min(high, -offset / slope)"
        yield f"elif not offset >= 0.0: {otherwise}"
    yield f"if not low <= high: {otherwise}"
    yield f"U_{given.key} = min(max(0.0, low), high)"


def _union(given: Input, admission: Admission) -> Iterator[str]:
    """A loop over the values of an input that pass, nearest to zero first; what follows is its body."""
    criticals = ", ".join(_row(map(term_source, c)) for c in admission.criticals)
    yield f"for U_{given.key} in candidates({float(given.low)!r}, {float(given.high)!r}, [{criticals}]):"
    for s in admission.solved:
        coefficients = _row(map(term_source, s.polynomial))
        yield f"    U_{s.symbol.name} = {term_source(s.input)} in roots({coefficients}, False)"
    yield f"    if not {formula_source(admission.condition)}: continue"


def candidates(low: float, high: float, polynomials: Sequence[Sequence[float]]) -> list[float]:
    """Values among which is the nearest to zero that passes, up to rounding, in the order of their size."""
    found = [0.0, low, high]
    for root in (r for c in polynomials for r in roots(c, False)):
        found += [float(root) + sign * NUDGE * (1.0 + abs(float(root))) for sign in (-1.0, 0.0, 1.0)]
    return sorted((u for u in found if low <= u <= high), key=abs)


def _flow(model: Model, k: int, flow: Flow) -> str:
    """`flow_<k>`: the state at the end of a flow, and its duration."""
    moved = [name for name, _ in flow.equations]
    row = _row(f"X_{name}" for name in moved)
    ends = [f"{term_source(h.bound)} - X_{h.clock}" for h in flow.horizons]
    longest = flow.reach or flow.cap
    ends += [repr(float(longest))] if longest is not None else []
    lines = [
        f"until = min({', '.join(ends)})" if len(ends) > 1 else f"until = {ends[0]}",
        "if not until > 0.0: return x, 0.0",
        "def rhs(tau, y):",
        *_entries(moved, [term for _, term in flow.equations]),
        f"    return {_row(term_source(term) for _, term in flow.equations)}",
    ]
    moving = {Symbol(name, "variable") for name in moved}
    events = [part for part in conjuncts(flow.domain) if moving & symbols(part) and not _is_equality(part)]
    for i, part in enumerate(events):
        lines += [
            f"def event_{i}(tau, y):",
            *_entries(moved, [part]),
            f"    return {margin_source(part)}",
            f"event_{i}.terminal = True",
            f"event_{i}.direction = {0.0 if isinstance(part, Compare) and part.op == '!=' else -1.0}",
        ]
    lines += [
        f"events = {_row(f'event_{i}' for i in range(len(events))) if events else None}",
        f"done = solve_ivp(rhs, (0.0, until), {row}, events=events, rtol={RTOL})",
        *_again(flow, row),
        f"{row} = done.y[:, -1].tolist()",
        f"return {_row(_variables(model))}, float(done.t[-1])",
    ]
    return _function(model, f"flow_{k}", lines)


def _again(flow: Flow, row: str) -> Iterator[str]:
    """The shorter time of a flow without a clock that its domain did not end."""
    if flow.reach is not None and flow.cap is not None:
        short = f"(0.0, {float(flow.cap)!r})"
        yield f"if done.status != 1: done = solve_ivp(rhs, {short}, {row}, events=events, rtol={RTOL})"


def _entries(moved: Sequence[str], used: Sequence[Term | Formula]) -> list[str]:
    """Lines that read the variables used, as plain numbers, from the solver's vector."""
    names = {s.name for part in used for s in symbols(part) if s.kind == "variable"}
    return [f"    X_{name} = float(y[{i}])" for i, name in enumerate(moved) if name in names]


def _is_equality(part: Formula) -> bool:
    """Equalities hold at the start and are kept by the flow: they have no event."""
    return isinstance(part, Compare) and part.op == "="


def _judge(model: Model) -> str:
    """`judge`: reward, terminated, truncated; of the predicates that end the episode the first wins."""
    lines = [f"good_{k} = {formula_source(p.relaxed)}" for k, p in enumerate(model.predicates)]
    lines.append("reward = 0.0")
    for k, predicate in enumerate(model.predicates):
        lines += _rewards(k, predicate)
    for _, _, condition, action in sorted(_endings(model.predicates)):
        ends = f"{action == 'terminate'}, {action == 'truncate'}"
        lines.append(f"if {condition}: return reward, {ends}")
    lines.append("return reward, False, False")
    return _function(model, "judge", lines)


def _rewards(k: int, predicate: Predicate) -> Iterator[str]:
    for term, condition in (
        (predicate.reward, f"if good_{k}: "),
        (predicate.penalty, f"if not good_{k}: "),
        (predicate.shape, ""),
    ):
        if term is not None:
            yield f"{condition}reward += {term_source(term)}"


def _endings(predicates: Sequence[Predicate]) -> Iterator[tuple[int, int, str, str]]:
    """Rank, declaration order, condition and action of all that may end the episode (semantics 6)."""
    for k, predicate in enumerate(predicates):
        failed = f"not good_{k}"
        if predicate.category == "progress":
            failed += f" and {'False' if predicate.due is None else formula_source(predicate.due)}"
        for trigger, condition in ((predicate.on_success, f"good_{k}"), (predicate.on_failure, failed)):
            if trigger is not None and trigger.action != "continue":
                yield _rank(trigger, predicate), k, condition, trigger.action


def _rank(trigger: Trigger, predicate: Predicate) -> int:
    status = ("failure", "success", "none").index(trigger.status)
    return 3 * status + ("safety", "progress", "stability").index(predicate.category)


# Running it -------------------------------------------------------------------


@final
class Baseline:
    """One environment by the recipe. `starts` are the initial states of its episodes, taken in turn;
    drawing them costs nothing here. `max_steps` truncates an episode, 0: never.
    """

    __slots__ = (
        *("_flows", "_judge", "_loops", "_max_steps", "_next", "_observe", "_points", "_starts"),
        *("p", "steps", "x"),
    )

    def __init__(
        self, model: Model, paths: Paths, observed: Sequence[str], starts: Sequence[Start], max_steps: int
    ) -> None:
        names: dict[str, Any] = NAMESPACE | {"solve_ivp": solve_ivp, "array": np.array, "float32": np.float32}
        names |= {"candidates": candidates, "roots": roots}
        exec(compile(baseline_source(model, paths, observed), "<baseline>", "exec"), names)
        self._points = [
            [(names[f"path_{k}"], paths.paths[k].flow, paths.paths[k].target) for k in _preferred(paths, i)]
            for i in range(paths.points)
        ]
        self._flows: list[FlowFunction] = [names[f"flow_{k}"] for k in range(len(model.flows))]
        self._judge, self._observe = names["judge"], names["observe"]
        self._loops, self._max_steps, self._starts = model.loops, max_steps, starts
        self._next = 0
        self.reset()

    def reset(self) -> NDArray[np.float32]:
        """Begin the next episode; its first observation."""
        self.x, self.p = self._starts[self._next % len(self._starts)]
        self._next += 1
        self.steps = 0
        return self._observe(self.x, self.p)

    def step(self) -> tuple[NDArray[np.float32], float, bool, bool]:
        """Observation, reward, terminated and truncated of one step. No run or no finite state truncates."""
        self.steps += 1
        moved = self._completed(0, self.x)
        if moved is None or not isfinite(sum(moved)):
            return self._observe(self.x, self.p), 0.0, False, True
        self.x = moved
        reward, terminated, truncated = self._judge(moved, self.p)
        if not terminated and not truncated:
            stuck = all(enter(moved, self.p) is None for enter, _, _ in self._points[0])
            terminated = not self._loops
            truncated = self._loops and (stuck or self.steps == self._max_steps)
        return self._observe(moved, self.p), reward, terminated, truncated

    def _completed(self, point: int, x: Row) -> Row | None:
        """The state at the end of the step by the first path that leads there."""
        for enter, flow, target in self._points[point]:
            y = enter(x, self.p)
            if y is None:
                continue
            if flow is not None:
                y, _ = self._flows[flow](y, self.p)
            end = y if target == END else self._completed(target, y)
            if end is not None:
                return end
        return None


def _preferred(paths: Paths, point: int) -> list[int]:
    """The paths of a point, best first for a request of zeros: by agreement, `@fallback`, order."""

    def rank(k: int) -> tuple[int, bool]:
        path: Path = paths.paths[k]
        agreed = 0
        while agreed < len(path.met) and path.decisions[path.met[agreed]] == 0:
            agreed += 1
        whole = agreed == len(path.met)
        return -len(paths.decisions) - 1 if whole else -agreed, whole or not path.marks[agreed]

    return sorted((k for k, path in enumerate(paths.paths) if path.point == point), key=rank)
