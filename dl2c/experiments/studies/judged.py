"""What `dl2c verify --policy` says of a study's policy, whose requests nothing corrects there."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import nan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dl2c.commands.policy import Asked, report_on
from dl2c.experiments.studies.catalogue import Study
from dl2c.interval.arithmetic import enclosure
from dl2c.native.boxes import PROVED, SUSPECT, Judge
from dl2c.policy.files import JSON
from dl2c.policy_proof.question import NotCovered, Question
from dl2c.policy_proof.tables import box_of, tables_of
from dl2c.policy_proof.verdict import PolicyReport, decimal
from dl2c.training.evaluation import rate
from dl2c.training.run import Estimate
from dl2c.training.states import States

SECONDS = 60.0

DRAWN = 100_000
"""States for each alternative of the environment."""

THREADS = 2


@dataclass(frozen=True, slots=True)
class Judgement:
    """The answer to each claim, none where the policy is not covered: `reason` says why. `decided` is the
    share of the volume that the search decided; `admissible` the share of states, drawn within the bounds, in
    which the request is admissible. `state`, with what the environment takes, is one where `request` is not.
    With `shares` of what is admissible, requests are alternatives.
    """

    claims: Mapping[str, str] = field(default_factory=dict[str, str])
    decided: float = nan
    admissible: Estimate = Estimate(nan, nan, nan)
    state: Mapping[str, str] = field(default_factory=dict[str, str])
    request: Mapping[str, str] = field(default_factory=dict[str, str])
    reason: str = ""
    shares: bool = False


def judged(policy: Path, study: Study, seconds: float = SECONDS, states: int = DRAWN) -> Judgement:
    """Ask for a proof, and look at requests in states that are drawn."""
    asked = Asked(policy.with_name(JSON), seconds=seconds, threads=THREADS)
    try:
        report = report_on(f"example:{study.example}", asked, study.options)
    except NotCovered as problem:
        return Judgement(reason=problem.diagnostics[0].label)
    drawn = [are_admissible(question, states) for question in report.questions]
    admissible = rate(np.concatenate(drawn))
    shares = any(question.shares for question in report.questions)
    return Judgement(report.claims, report.share, admissible, *_example(report), shares=shares)


def are_admissible(question: Question, count: int) -> NDArray[np.bool_]:
    """Whether the request is admissible, as far as doubles tell, in those states of the hypothesis that are
    among so many drawn uniformly within the bounds, and moved to where equations hold.
    """
    box = box_of(question)
    low = np.array([enclosure(low).high for low, _ in question.box])
    high = np.array([enclosure(high).low for _, high in question.box])
    states = States(question, np.random.default_rng(0))
    points = states.settled(states.rng.uniform(low, np.maximum(low, high), (count, len(box))))
    points = points[states.is_assumed(points)] if states.equations else points
    boxes = np.stack([points, points], axis=2)
    inner = len(box) - len(question.computed)
    boxes[:, inner:] = box[inner:]
    judge = Judge(tables_of(replace(question, hypothesis=states.other_assumptions)))
    verdicts, _ = judge.verdicts(boxes, THREADS)
    return verdicts[(verdicts == PROVED) | (verdicts == SUSPECT)] == PROVED


def _example(report: PolicyReport) -> tuple[Mapping[str, str], Mapping[str, str]]:
    """The state of a violation with what the environment takes in it, and what is asked for."""
    if report.violated is None:
        return {}, {}
    question, found = report.violated
    state = {name: decimal(value) for name, value in found.state.items()}
    state |= {str(key): str(alternative) for key, alternative in question.lead}
    shown = () if question.shares else tuple(filter(str.isidentifier, found.requests))
    request = {name: decimal(found.requests[name]) for name in shown}
    decided = [pair.partition("=") for pair in found.about.split(", ") if pair]
    return state, request | {key: alternative for key, _, alternative in decided}
