"""What is known of a theorem: the answer for each obligation and for the whole."""

import importlib.metadata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, Literal, TypeAlias

from dl2c.parse import tree
from dl2c.source import Span
from dl2c.verify.execution import Kind

Answer: TypeAlias = Literal["proved", "proved-if-defined", "refuted", "unknown", "not checked"]

Invariants: TypeAlias = Mapping[Span, tuple[tree.Formula, ...]]
"""The conjuncts of each loop's invariant, by its place."""

ORDER: tuple[Answer, ...] = ("proved", "proved-if-defined", "not checked", "unknown", "refuted")
"""From best to worst."""


Decisions: TypeAlias = tuple[tuple[str, Fraction], ...]


@dataclass(frozen=True, slots=True)
class Step:
    """An iteration of an outermost loop; without one the whole run. `state` is where it comes; None where the
    run ends some moment after an equation begins.
    """

    decisions: Decisions
    state: Mapping[str, Fraction] | None


@dataclass(frozen=True, slots=True)
class Counterexample:
    """An exact run: the first state, its decisions in order, what is false at its end, and its steps."""

    state: Mapping[str, Fraction]
    decisions: Decisions
    violated: str
    steps: tuple[Step, ...] = ()


@dataclass(frozen=True, slots=True)
class Obligation:
    """`rules` and `solvers` are what proved it; `reason` says why it is not proved. `predicate` is the
    name of the safety predicate that it is about."""

    kind: Kind
    loop: int
    place: Span
    answer: Answer
    seconds: float = 0.0
    rules: tuple[str, ...] = ()
    solvers: tuple[str, ...] = ()
    reason: str = ""
    counterexample: Counterexample | None = None
    predicate: str = ""

    @property
    def wrong_invariant(self) -> bool:
        """Whether a state and a run from it show that a loop's invariant is wrong."""
        return self.answer == "refuted" and self.kind in ("initially", "step", "finally")

    @property
    def title(self) -> str:
        """What it is, for a reader."""
        where = f" (loop {self.loop})" if self.loop else ""
        return f"{f'{self.kind} {self.predicate}'.strip()}{where}"


@dataclass(slots=True)
class Attempt:
    """What came of one choice of invariants and effort. `loops` are in the order of their numbers. `lost` are
    the conjuncts of invariants that are not proved, by the loop's place and their number.
    """

    invariants: Invariants
    obligations: list[Obligation]
    loops: Sequence[tree.Loop] = ()
    invented: bool = False
    lost: set[tuple[Span, int]] = field(default_factory=set[tuple[Span, int]])
    warnings: tuple[str, ...] = ()

    @property
    def answer(self) -> Answer:
        """For the theorem: safety obligations are beside it, and where an invariant is wrong another one may
        be right.
        """
        counted = (o for o in self.obligations if o.kind != "safety")
        return worst(["unknown" if o.wrong_invariant else o.answer for o in counted])

    @property
    def counterexample(self) -> Counterexample | None:
        """A run that refutes the theorem."""
        runs = (o.counterexample for o in self.obligations if o.kind == "program")
        return next((run for run in runs if run is not None), None)


def joined(one: Obligation, other: Obligation) -> Obligation:
    """Two parts of one obligation."""
    bad = other if worst([one.answer, other.answer]) == other.answer != one.answer else one
    return replace(
        bad,
        seconds=one.seconds + other.seconds,
        solvers=tuple(dict.fromkeys((*one.solvers, *other.solvers))),
    )


def safe_with(known: Obligation | None, left: bool) -> bool:
    """Whether a safety predicate need not be looked at where a step ends: it is not proved where steps
    begin, or it is, for all states of the loop's invariant, which this step has not `left`.
    """
    return known is not None and (known.answer != "proved" or not left)


def better(one: Attempt, other: Attempt) -> bool:
    """Definite answers count most, then invariants that are known to be wrong, then how much is proved, then
    how much is refuted, then what the text itself gives.
    """

    def score(a: Attempt) -> tuple[bool, bool, float, int]:
        proved = sum(o.answer == "proved" for o in a.obligations)
        refuted = sum(o.answer == "refuted" for o in a.obligations)
        wrong = any(o.wrong_invariant for o in a.obligations)
        return a.answer in ("proved", "refuted"), wrong, proved / len(a.obligations), refuted

    return score(one) > score(other)


@dataclass(frozen=True, slots=True)
class Report:
    """`answer` is for the theorem as written, `within_bounds` where names begin inside their bounds.

    `invariants` are those of the loops, as text; `invented` where the model does not give them.
    `interrupted` by Ctrl-C, it says what was known by then.
    """

    theorem: str
    answer: Answer
    within_bounds: Answer
    obligations: tuple[Obligation, ...]
    invariants: tuple[str, ...]
    invented: bool
    seconds: float
    queries: int
    solvers: Sequence[str]
    versions: Mapping[str, str] = field(default_factory=dict[str, str])
    counterexample: Counterexample | None = None
    warnings: tuple[str, ...] = ()
    interrupted: bool = False

    @property
    def basis(self) -> str:
        """What a proof rests on, in a line."""
        if not self.answer.startswith("proved"):
            return "by dl2c verify" if self.answer == "refuted" else ""
        names = " and ".join(f"{name} {version}" for name, version in self.versions.items())
        invented = ", with invariants that it found" if self.invented else ""
        return f"by dl2c verify with {names}{invented}" if names else "by dl2c verify"

    def to_json(self) -> dict[str, Any]:
        """The report as data."""
        return {
            "theorem": self.theorem,
            "answer": self.answer,
            "within_bounds": self.within_bounds,
            "invariants": list(self.invariants),
            "invariants_invented": self.invented,
            "seconds": round(self.seconds, 3),
            "queries": self.queries,
            "solvers": list(self.solvers),
            "basis": self.basis,
            "obligations": [_as_data(o) for o in self.obligations],
            "counterexample": _run_as_data(self.counterexample),
            "warnings": list(self.warnings),
            "interrupted": self.interrupted,
        }


def worst(answers: Sequence[Answer]) -> Answer:
    """The answer for a whole from those of its parts."""
    return ORDER[max((ORDER.index(a) for a in answers), default=0)]


def _as_data(o: Obligation) -> dict[str, Any]:
    data: dict[str, Any] = {
        "obligation": o.kind,
        "loop": o.loop or None,
        "place": o.place.place,
        "answer": o.answer,
        "seconds": round(o.seconds, 3),
    }
    if o.predicate:
        data["predicate"] = o.predicate
    if o.rules:
        data["rules"] = list(o.rules)
    if o.solvers:
        data["solvers"] = list(o.solvers)
    if o.reason:
        data["reason"] = o.reason
    if o.counterexample is not None:
        data["counterexample"] = _run_as_data(o.counterexample)
    return data


def _run_as_data(run: Counterexample | None) -> dict[str, Any] | None:
    if run is None:
        return None
    return {
        "state": {name: str(value) for name, value in run.state.items()},
        "decisions": [[name, str(value)] for name, value in run.decisions],
        "violated": run.violated,
    }


def versions(solvers: Iterable[str]) -> dict[str, str]:
    """The versions of the libraries to which solvers belong."""
    libraries = {"z3": "z3-solver", "cvc5": "cvc5"}
    used = sorted({s.split("-")[0].split()[0] for s in solvers if s})
    return {name: importlib.metadata.version(libraries[name]) for name in used}
