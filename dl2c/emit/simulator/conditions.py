"""The conditions of a model that a page shows, as data: what each is of, and its comparisons by number."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, assert_never

from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.judge_c import checked_precondition
from dl2c.ir.logic import atoms
from dl2c.ir.model import And, Compare, Formula, Or, Truth
from dl2c.ir.printer import print_formula
from dl2c.source import NOWHERE, Span

Kind: TypeAlias = Literal["assumption", "safety", "progress", "stability", "domain", "guard", "admission"]


@dataclass(frozen=True, slots=True)
class Condition:
    """A formula of a model. `name` is that of a predicate, else the number of the flow or path that it is of,
    for an admission with the place of the input.
    """

    kind: Kind
    name: str
    formula: Formula


@dataclass(frozen=True, slots=True)
class Conditions:
    """All of them, and the comparisons that they are made of, each once for every place in the text."""

    listed: tuple[Condition, ...]
    atoms: tuple[Compare, ...]

    def as_data(self) -> dict[str, Any]:
        """For JSON: formulas as ["and", ...], ["or", ...], truths, numbers of comparisons."""
        number = {_key(atom): k for k, atom in enumerate(self.atoms)}
        return {
            "atoms": [
                {"text": _text(a), "full": print_formula(a), "op": a.op, "span": span_data(a.span)}
                for a in self.atoms
            ],
            "conditions": [
                {"kind": c.kind, "name": c.name, "tree": _tree(c.formula, number)} for c in self.listed
            ],
        }


def span_data(span: Span) -> list[int] | None:
    """Where something begins and ends in the model's text; None where it is not in it."""
    return None if span == NOWHERE else [span.start, span.end]


def conditions_of(build: BuildPlan) -> Conditions:
    """The precondition as given states must satisfy it, predicates as written, domains without the bounds of
    clocks, and of every path what no input decides, and what each of its inputs decides.
    """
    listed = tuple(_listed(build))
    found = {_key(atom): atom for c in listed for atom in atoms(c.formula)}
    return Conditions(listed, tuple(found.values()))


def _listed(build: BuildPlan) -> Iterator[Condition]:
    model = build.model
    yield Condition("assumption", "", checked_precondition(build))
    for predicate in model.predicates:
        yield Condition(predicate.category, predicate.name, predicate.formula)
    for k, flow in enumerate(model.flows):
        yield Condition("domain", str(k), flow.watched)
    for k, path in enumerate(build.paths.paths):
        yield Condition("guard", str(k), path.guard)
        for j, admission in enumerate(path.admissions):
            yield Condition("admission", f"{k} {j}", admission.tests)


def _text(atom: Compare) -> str:
    """As the model writes it, on one line."""
    written = " ".join(atom.span.text.split()) if atom.span != NOWHERE else ""
    return written or print_formula(atom)


def _key(atom: Compare) -> tuple[Compare, int, int]:
    return atom, atom.span.start, atom.span.end


def _tree(formula: Formula, number: dict[tuple[Compare, int, int], int]) -> Any:
    match formula:
        case Truth(value):
            return value
        case Compare():
            return number[_key(formula)]
        case And(children) | Or(children):
            word = "and" if isinstance(formula, And) else "or"
            return [word, *(_tree(c, number) for c in children)]
        case _:
            assert_never(formula)
