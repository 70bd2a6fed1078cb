"""What was proved of a policy with `dl2c train --provable`, as a section of the report."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from dl2c.diagnostics import CompileError
from dl2c.env.opening import compilation_of
from dl2c.inputs import checked_input, read_json
from dl2c.ir.model import Model
from dl2c.picture.boxes import proof_figure
from dl2c.picture.figure import data_uri
from dl2c.policy.files import JSON, read_policy
from dl2c.policy.network import PolicyError
from dl2c.policy_proof.acting import acting
from dl2c.policy_proof.build import claim_of, questions
from dl2c.policy_proof.certificate import FORMAT, digest, read_trees
from dl2c.policy_proof.onward import subject
from dl2c.policy_proof.plane import free_names
from dl2c.policy_proof.question import Question
from dl2c.policy_proof.search import Before, Found, Limits, search
from dl2c.policy_proof.verdict import decimal, percent
from dl2c.report.markup import Markup, image, section, table, tag
from dl2c.report.trained import Trained
from dl2c.training.run import CERTIFICATE, MOST_BYTES, PROOF
from dl2c.work import budgeted

CLAIMS = {
    "admissible": "every request is admissible",
    "kept": "every step ends within the bounds",
    "for ever": "requests stay admissible",
}


FOLLOWING = {"kept", "for ever"}
"""Claims about all of a step, of which questions about requests say nothing."""


@dataclass(frozen=True, slots=True)
class _Counterexample:
    """A request that is not admissible, with numbers as they are shown."""

    environment: Mapping[str, str]
    state: Mapping[str, str]
    requests: Mapping[str, str]
    choices: str


@dataclass(frozen=True, slots=True)
class _Proof:
    """The report in `proof.json`. `seconds_of` are those after each level, of each question."""

    answer: str
    claims: Mapping[str, str]
    covers: Sequence[str]
    arithmetic: str
    boxes: int
    by_solver: int
    decided: float
    seconds: float
    rounds: int
    reasons: Sequence[str]
    warnings: Sequence[str]
    counterexample: _Counterexample | None
    questions: Sequence[str]
    theorem: str
    seconds_of: Sequence[Sequence[float]]


def proof_section(trained: Trained) -> Iterator[Markup]:
    """The section, if there is a report of a proof in the folder. Where that is about something else, or
    cannot be read, it says so.
    """
    if not (trained.folder / PROOF).is_file():
        return
    try:
        parts = list(_parts(trained))
    except (PolicyError, CompileError, OSError) as problem:
        parts = [tag("p", f"Nothing is shown: {_said(problem, trained.folder)}.")]
    yield section("Proof of the policy", *parts)


def _said(problem: Exception, folder: Path) -> str:
    """A failure in a line, with paths in the folder."""
    match problem:
        case CompileError(diagnostics=[first, *_]):
            text = f"{first.title}: {first.label}"
        case OSError():
            text = f"{problem.strerror or problem}: {problem.filename}"
        case _:
            text = str(problem)
    return text.replace(f"{folder}/", "")


def _parts(trained: Trained) -> Iterator[Markup]:
    """Raises `PolicyError`, `CompileError`, `OSError`."""
    proof = _read(trained.folder / PROOF)
    model, theorem, asked = _questions(trained)
    if list(proof.questions) != [digest(q) for q in asked]:
        raise PolicyError(f"{PROOF} is about another model, policy or claim")
    if proof.answer == "proved":
        found = _proved(trained.folder / CERTIFICATE, asked, proof)
        if any(map(free_names, asked)):
            yield image(data_uri(proof_figure(model, asked, found)), "what is proved, over two names")
    claims = dict(proof.claims)
    if not theorem or proof.theorem != theorem:
        claims |= dict.fromkeys(claims.keys() & FOLLOWING, "not checked")
    yield table(("claim", "", "answer"), [(n, CLAIMS.get(n, ""), said) for n, said in claims.items()])
    yield tag("p", _sentence(proof), class_="note")
    yield from (tag("p", f"warning: {warning}") for warning in proof.warnings)
    if (found := proof.counterexample) is not None:
        yield tag("h3", "Where it asks for what is not admissible")
        asks = [(name, f"asks for {value}") for name, value in found.requests.items()]
        asks += [("choices", found.choices)] if found.choices else []
        yield table(("name", "value"), [*found.environment.items(), *found.state.items(), *asks])
    yield tag("h3", "What is assumed")
    yield from (tag("p", covers) for covers in proof.covers)


def _sentence(proof: _Proof) -> str:
    by = f", {proof.by_solver:,} of them by Z3" if proof.by_solver else ""
    parts = [
        f"{proof.boxes:,} boxes{by}",
        f"{proof.seconds:.3g} s",
        f"numbers of the policy: {proof.arithmetic}",
    ]
    parts.append(f"taught in {proof.rounds} round{'' if proof.rounds == 1 else 's'}")
    if proof.answer != "proved":
        parts += [f"{percent(proof.decided)} of the volume decided", *proof.reasons]
    return "; ".join(parts) + "."


def _read(path: Path) -> _Proof:
    """Raises `PolicyError`, `OSError`."""
    with checked_input(PolicyError, f"{PROOF} is not of `dl2c train --provable`"):
        data: dict[str, Any] = read_json(path, MOST_BYTES)
        found = data["counterexample"]
        return _Proof(
            answer=str(data["answer"]),
            claims={str(k): str(v) for k, v in data["claims"].items()},
            covers=[str(v) for v in data["covers"]],
            arithmetic=str(data["arithmetic"]),
            boxes=int(data["boxes"]),
            by_solver=int(data["boxes_by_z3"]),
            decided=float(data["decided"]),
            seconds=float(data["seconds"]),
            rounds=int(data["rounds"]),
            reasons=[str(v) for v in data["reasons"]],
            warnings=[str(v) for v in data["warnings"]],
            counterexample=None if found is None else _counterexample(found),
            questions=[str(v) for v in data["questions"]],
            theorem=str(data.get("theorem", "")),
            seconds_of=[[float(p["seconds"]) for p in records] for records in data["progress"]],
        )


def _counterexample(data: Mapping[str, Any]) -> _Counterexample:
    """Raises what is `MALFORMED`."""
    kinds = ("environment", "state", "requests")
    first, state, asks = ({str(k): decimal(Fraction(v)) for k, v in data[n].items()} for n in kinds)
    return _Counterexample(first, state, asks, str(data["choices"]))


@budgeted()
def _questions(trained: Trained) -> tuple[Model, str, tuple[Question, ...]]:
    """The model, the digest of its theorem, and what was asked of the policy in the folder. Raises
    `PolicyError`, `CompileError`, `OSError`.
    """
    compiled = compilation_of(trained.source, trained.options)
    claim = claim_of(compiled.resolved.problem, compiled.unbounded)
    policy = read_policy(trained.folder / JSON)
    theorem = subject(compiled.parsed.entry, claim.model, claim.values)
    return claim.model, theorem, questions(claim, acting(policy.interface, policy.network))


def _proved(path: Path, asked: Sequence[Question], proof: _Proof) -> list[Found]:
    """The searches of a certificate, nothing being searched again. Raises `CertificateError`, `OSError`."""
    trees = [b.tree for b in read_trees(path, asked, FORMAT)]
    if [len(t) for t in trees] != [len(s) for s in proof.seconds_of]:
        raise PolicyError(f"{PROOF} and {CERTIFICATE} do not fit each other")
    levels = [Before(t, tuple(s)) for t, s in zip(trees, proof.seconds_of, strict=True)]
    found = [search(q, Limits(0.0), before) for q, before in zip(asked, levels, strict=True)]
    if any(f.answer != "proved" for f in found):
        raise PolicyError(f"{CERTIFICATE} leaves boxes open")
    return found
