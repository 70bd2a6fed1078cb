"""The answers for a policy: whether every request is admissible, and what follows, with what was done."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from dl2c.ir.printer import print_formula, print_number
from dl2c.paths.enumerate import control_drafts
from dl2c.paths.path import END
from dl2c.policy_proof.build import Claim
from dl2c.policy_proof.certificate import begun as searched_before
from dl2c.policy_proof.certificate import certificate, digest, unfinished
from dl2c.policy_proof.confirm import Confirmation
from dl2c.policy_proof.exact import Violation
from dl2c.policy_proof.onward import Onward
from dl2c.policy_proof.question import Question
from dl2c.policy_proof.search import Answer, Before, Found, Limits, Progress, search


@dataclass(frozen=True, slots=True)
class PolicyReport:
    """`found` has what came out of each question. `covers` says in words what the claim is about."""

    model: str
    policy: str
    covers: tuple[str, ...]
    arithmetic: str
    found: tuple[Found, ...]
    warnings: tuple[str, ...]
    seconds: float
    questions: tuple[Question, ...] = ()
    onward: Onward = Onward()
    confirmation: Confirmation | None = None
    """Of the violation, if there is one."""

    @property
    def certificate(self) -> str:
        """The text of the certificate of a proof."""
        assert self.answer == "proved"
        return certificate(self.questions, [f.tree for f in self.found])

    @property
    def unfinished(self) -> str:
        """The text of the search as far as it is, to go on later."""
        times = (tuple(p.seconds for p in f.progress[: len(f.tree)]) for f in self.found)
        return unfinished(self.questions, list(map(Before, (f.tree for f in self.found), times)))

    @property
    def interrupted(self) -> bool:
        return self.onward.interrupted or any(f.interrupted for f in self.found)

    @property
    def answer(self) -> Answer:
        """The worst answer."""
        answers = {f.answer for f in self.found}
        return "refuted" if "refuted" in answers else "unknown" if "unknown" in answers else "proved"

    @property
    def claims(self) -> dict[str, str]:
        """The answer to each claim, by name."""
        return {"admissible": self.answer, "kept": self.onward.kept, "for ever": self.onward.lasting}

    @property
    def violation(self) -> Violation | None:
        return None if self.violated is None else self.violated[1]

    @property
    def violated(self) -> tuple[Question, Violation] | None:
        """The violation with the question that it answers."""
        pairs = zip(self.questions, self.found, strict=False)
        return next(((q, f.violation) for q, f in pairs if f.violation is not None), None)

    @property
    def share(self) -> float:
        """The share of the volume that is decided, averaged over questions."""
        return sum(f.share for f in self.found) / len(self.found)

    def to_json(self) -> dict[str, Any]:
        """The report as data."""
        return {
            "model": self.model,
            "policy": self.policy,
            "arithmetic": self.arithmetic,
            "covers": list(self.covers),
            "answer": self.answer,
            "claims": self.claims,
            "boxes": sum(f.boxes for f in self.found),
            "boxes_by_z3": sum(f.by_solver for f in self.found),
            "decided": self.share,
            "seconds": round(self.seconds, 3),
            "questions": [digest(q) for q in self.questions],
            "theorem": self.onward.about,
            "progress": [[_as_record(p) for p in f.progress] for f in self.found],
            "reasons": [f.reason for f in self.found if f.reason],
            "open": [{n: list(ends) for n, ends in box.items()} for f in self.found for box in f.open_boxes],
            "counterexample": None if self.violated is None else _as_data(*self.violated),
            "confirmation": None if self.confirmation is None else self.confirmation.to_json(),
            "warnings": list(self.warnings),
        }


def _as_record(progress: Progress) -> dict[str, Any]:
    return asdict(progress) | {"seconds": round(progress.seconds, 3)}


def _as_data(question: Question, found: Violation) -> dict[str, Any]:
    return {
        "environment": dict(question.lead),
        "state": {name: str(value) for name, value in found.state.items()},
        "outputs": [float(v) for v in found.outputs],
        "requests": {name: str(value) for name, value in found.requests.items()},
        "choices": found.about,
        "violated": print_formula(found.violated),
    }


def verified(
    claim: Claim,
    asked: tuple[Question, ...],
    limits: Limits,
    names: tuple[str, str],
    resume: Path | None = None,
) -> PolicyReport:
    """Ask the questions of a claim, within the time for all; go on with the search in `resume` if that file
    is there. `names` are those of model and policy.

    Raises `NotCovered`, `CertificateError`, `OSError`, `NativeError`.
    """
    begun = time.monotonic()
    before = [Before()] * len(asked) if resume is None else searched_before(resume, asked)
    found: list[Found] = []
    for question, levels in zip(asked, before, strict=True):
        interrupted = any(f.interrupted for f in found)
        left = 0.0 if interrupted else limits.seconds - (time.monotonic() - begun)
        found.append(search(question, replace(limits, seconds=max(left, 0.0)), levels))
        if found[-1].answer == "refuted":
            break
    hypotheses = tuple(map(_states, asked))
    seconds = time.monotonic() - begun
    warnings = tuple(_warnings(claim, asked, found))
    return PolicyReport(*names, hypotheses, claim.arithmetic, tuple(found), warnings, seconds, asked)


def _states(question: Question) -> str:
    """What is assumed, in words: limits and the hypothesis."""
    limits = [
        f"{decimal(low)} <= {s.name} <= {decimal(high)}"
        for s, (low, high) in zip(question.dimensions, question.box, strict=True)
    ]
    limits += [f"{name} = {decimal(value)}" for name, value in question.fixed.items()]
    return f"{', '.join(limits)}; {print_formula(question.hypothesis)}"


def _warnings(claim: Claim, asked: Sequence[Question], found: Sequence[Found]) -> list[str]:
    said: list[str] = []
    if all(f.answer == "proved" and not f.states for f in found):
        said.append("no state satisfies what is assumed: the proof says nothing")
    if any(question.shares for question in asked):
        said.append("values are shares of what is admissible; the claim is that some real numbers are")
    if _goes_on(claim):
        said.append("tests and domains after the first motion of a step are not part of the claim")
    return said


def _goes_on(claim: Claim) -> bool:
    """Whether something may be executed after the first flow of a step."""
    drafts = control_drafts(claim.model, claim.model.body)
    return any(draft.flow is not None and draft.target != END for draft in drafts)


def decimal(value: Fraction) -> str:
    """A number for readers: exact where that is short, or where doubles have nothing near it."""
    exact, nearest = print_number(value), float(value)
    return exact if len(exact) <= 12 or (value and not nearest) else f"{nearest!r}"


def percent(share: float) -> str:
    """A share for readers: none but 1 is shown as 100 %."""
    return "100 %" if share == 1 else f"{min(100 * share, 99.99):.4g} %"
