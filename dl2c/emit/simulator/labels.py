"""What the margins and atoms of a flow are called in C, and the dL text that each stands for."""

from collections.abc import Iterator
from dataclasses import dataclass

from dl2c.emit.cfile import comment, place
from dl2c.emit.plan import BuildPlan
from dl2c.flows.kernel import FlowPlan
from dl2c.ir.logic import atoms
from dl2c.ir.model import Compare, Formula
from dl2c.ir.printer import print_formula
from dl2c.source import NOWHERE


@dataclass(frozen=True, slots=True)
class Label:
    """`owner` is the predicate or the flow whose atom it is, `number` that of its first margin."""

    owner: str
    number: int
    text: str

    @property
    def margin(self) -> str:
        return f"{self.owner}_margin{self.number}"

    @property
    def remark(self) -> list[str]:
        """The lines of a comment that quotes it."""
        return comment(self.text).split("\n")


def margin_labels(build: BuildPlan, k: int) -> tuple[Label, ...]:
    """A label for each margin of a flow, of the first atom that it belongs to."""
    plan = build.flows[k]
    found: dict[int, Label] = {}
    for owner, formula in _owned(build, k, plan):
        for atom in atoms(formula):
            number = plan.margins.index(atom.left)
            found.setdefault(number, Label(owner, number, _text(atom)))
    return tuple(found[j] for j in range(len(plan.margins)))


def atom_name(labels: tuple[Label, ...], owner: str, atom: Compare, taken: list[str]) -> str:
    """What the truth of an atom is called: by the first margin of the same text, else by its owner. No name
    is given twice.
    """
    text = _text(atom)
    known = next((label for label in labels if label.text == text), Label(owner, len(labels), text))
    count = known.number
    while (name := f"{known.owner}_holds{count}") in taken:
        count += 1
    taken.append(name)
    return name


def owners(build: BuildPlan, plan: FlowPlan) -> tuple[str, ...]:
    """The names of the predicates that are watched, watch by watch."""
    return tuple(build.model.predicates[w.predicate].name for w in plan.watches)


def quoted(atom: Compare) -> list[str]:
    """The lines of a comment that quotes an atom."""
    return comment(_text(atom)).split("\n")


def _owned(build: BuildPlan, k: int, plan: FlowPlan) -> Iterator[tuple[str, Formula]]:
    several = len(build.flows) > 1
    yield f"flow{k}", plan.domain
    for watch, name in zip(plan.watches, owners(build, plan), strict=True):
        owner = f"flow{k}_{name}" if several else name
        yield from ((owner, f) for f in (watch.stays, watch.due, watch.goal))


def _text(atom: Compare) -> str:
    """Where the atom stands, and as it is written there."""
    if atom.span == NOWHERE:
        return print_formula(atom)
    return f"{place(atom.span)}  {' '.join(atom.span.text.split())}"
