"""States of proved policies in the exported C: none asks for what is not admissible.

Slow: `make prove-slow`. DL2C_POLICY_STATES says how many states, DL2C_SEED which. Half of them are within
four units in the last place of faces of leaves, of ties of logits, or of where a guard changes.
"""

import os
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from policy_proof.questions import layers
from policy_proof.test_false_claims import policy
from policy_proof.test_verify_policy import SWITCH, TANK

from dl2c.commands.monitor import unit_of
from dl2c.commands.policy import Asked, policy_for, report_on
from dl2c.emit.monitor.files import monitor_files
from dl2c.native.program import compile_program
from dl2c.policy.network import Layer
from dl2c.policy_proof.tree import BY_BOUNDS, BY_SOLVER, leaves

Doubles = NDArray[np.float64]

STATES = int(os.environ.get("DL2C_POLICY_STATES", "10000000"))
SEED = int(os.environ.get("DL2C_SEED", "0"))
EACH = 500_000
ULPS = 4

INFLOW = TANK.replace("Real l;\n", "Real l;\n  /* @var: bound=[0.125:0.375] */ Real q;\n").replace(
    "0.25", "q"
)

MAIN = """#include "{name}_policy.h"
#include <stdio.h>

int main(void)
{{
  double state[{size}];
  while (fread(state, sizeof(double), {size}, stdin) == {size}) {{
    {name}_state s = {{0}};
    {name}_parameters p = {{0}};
    {name}_input input = {{0}}, asked = {{0}};
    int choices[{upper}_CHOICES] = {{0}};
    double answer;
    {set}
    {name}_policy_asks(s, &p, &input, &asked, choices);
    answer = {answer};
    fwrite(&answer, sizeof(double), 1, stdout);
  }}
  return 0;
}}
"""


@dataclass(frozen=True)
class Subject:
    """A model with its network, what its C answers, and whether that is admissible in states (n, names)."""

    text: str
    name: str
    names: tuple[str, ...]
    answer: str
    network: Callable[[np.random.Generator], tuple[Layer, ...]]
    admissible: Callable[[Doubles, Doubles], bool]
    guards: tuple[float, ...] = ()


def exactly(level: float, outflow: float, inflow: float) -> bool:
    after = Fraction(level) + Fraction(inflow) - Fraction(outflow)
    return 0 <= after <= 5 and 0 <= Fraction(inflow) <= Fraction(6, 10)


def fills(states: Doubles, asked: Doubles) -> bool:
    """In fractions where doubles are close to a limit."""
    outflow = states[:, 1] if states.shape[1] == 2 else np.full(len(states), 0.25)
    after = states[:, 0] + asked - outflow
    close = (after < 1e-9) | (after > 5 - 1e-9) | (asked > 0.6 - 1e-9) | (asked < 1e-9)
    some = (v[close].tolist() for v in (states[:, 0], outflow, asked))
    return all(exactly(*one) for one in zip(*some, strict=True))


def switches(states: Doubles, chosen: Doubles) -> bool:
    x = states[:, 0]
    return bool(np.where(chosen == 0, x <= 1, (chosen == 1) & (x >= -1)).all())


def inflow(size: int) -> Callable[[np.random.Generator], tuple[Layer, ...]]:
    """0.5 - l / 10 and a random part, at most a hundredth."""

    def network(rng: np.random.Generator) -> tuple[Layer, ...]:
        first, second, last = layers(rng, [size, 10, 8, 1], "relu")
        line = np.zeros((1, size))
        line[0, 0] = 1.0
        inner = Layer(np.vstack([first.weight, line]), np.append(first.bias, 0.0), "relu")
        middle = Layer(
            np.block([[second.weight, np.zeros((8, 1))], [np.zeros((1, 10)), np.ones((1, 1))]]),
            np.append(second.bias, 0.0),
            "relu",
        )
        return (
            inner,
            middle,
            Layer(np.append(last.weight[0] / 512, -0.09375)[None], np.array([0.484375]), "identity"),
        )

    return network


def tending(rng: np.random.Generator) -> tuple[Layer, ...]:
    """Towards 0, with several ties of logits between -1 and 1."""
    first, second, last = layers(rng, [1, 12, 8, 2], "relu")
    inner = Layer(np.vstack([first.weight, [[1.0], [-1.0]]]), np.append(first.bias, [0.0, 0.0]), "relu")
    middle = Layer(
        np.block([[second.weight, np.zeros((8, 2))], [np.zeros((2, 12)), np.eye(2)]]),
        np.append(second.bias, [0.0, 0.0]),
        "relu",
    )
    weight = np.hstack([last.weight / 8, [[-0.25, 0.25], [0.25, -0.25]]])
    return inner, middle, Layer(weight, np.zeros(2), "identity")


SUBJECTS = (
    Subject(TANK, "tank", ("l",), "asked.u", inflow(1), fills),
    Subject(INFLOW, "tank", ("l", "q"), "asked.u", inflow(2), fills),
    Subject(SWITCH, "switch", ("x",), "choices[0]", tending, switches, (-1.0, 1.0)),
)


def exported(subject: Subject, model: str, found: Path, folder: Path) -> Callable[[Doubles], Doubles]:
    """What the exported C answers in states."""
    trained, options = policy_for(model, found, {})
    files = monitor_files(unit_of(model, options), trained)
    text = MAIN.format(
        name=subject.name,
        upper=subject.name.upper(),
        size=len(subject.names),
        answer=subject.answer,
        set=" ".join(f"s.{n} = state[{k}];" for k, n in enumerate(subject.names)),
    )
    folder.mkdir()
    program = compile_program({**files, "main.c": text}, folder)

    def answers(states: Doubles) -> Doubles:
        ran = subprocess.run(
            [program], input=np.ascontiguousarray(states).tobytes(), stdout=subprocess.PIPE, check=True
        )
        return np.frombuffer(ran.stdout, np.float64)

    return answers


def beside(values: Doubles, rng: np.random.Generator) -> Doubles:
    """Numbers at most `ULPS` units in the last place away."""
    far = rng.integers(-ULPS, ULPS + 1, values.shape)
    for step in range(1, ULPS + 1):
        values = np.where(np.abs(far) >= step, np.nextafter(values, np.copysign(np.inf, far)), values)
    return values


def ties(answers: Callable[[Doubles], Doubles], states: Doubles) -> Doubles:
    """Numbers, with one name, next to which an answer changes, between neighbours of these."""
    points = np.sort(states[:, 0])
    told = answers(points[:, None])
    low, high, at = points[:-1], points[1:], told[:-1]
    changes = told[:-1] != told[1:]
    low, high, at = low[changes], high[changes], at[changes]
    for _ in range(70):
        middle = low + (high - low) / 2
        same = answers(middle[:, None]) == at if len(middle) else np.empty(0, np.bool_)
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return low


def states_of(
    subject: Subject, boxes: Doubles, answers: Callable[[Doubles], Doubles], rng: np.random.Generator
) -> Iterator[Doubles]:
    """In leaves (n, names, 2): anywhere, and beside faces, ties and guards."""
    first, last = boxes[..., 0].min(axis=0), boxes[..., 1].max(axis=0)
    chosen = boxes[rng.integers(0, len(boxes), EACH)]
    inside = rng.uniform(chosen[..., 0], chosen[..., 1])
    yield inside[: EACH // 2]
    ends = chosen[np.arange(EACH)[:, None], np.arange(boxes.shape[1]), rng.integers(0, 2, inside.shape)]
    at_faces = np.where(rng.random(inside.shape) < 0.7, beside(ends, rng), inside)
    yield np.clip(at_faces, first, last)[: EACH // 4 if subject.guards else EACH // 2]
    if subject.guards:
        known = np.concatenate([ties(answers, inside[:20_000]), subject.guards])
        assert len(known) > len(subject.guards)
        yield np.clip(beside(rng.choice(known, (EACH // 4, 1)), rng), first, last)


def test_the_judges_refuse() -> None:
    assert fills(np.array([[4.9], [0.0]]), np.array([0.25, 0.25]))
    assert not fills(np.array([[4.9]]), np.array([0.5])) and not fills(
        np.array([[0.0, 0.25]]), np.array([0.125])
    )
    assert not fills(np.array([[np.nextafter(5.0, 9), 0.25]]), np.array([0.25]))
    assert switches(np.array([[1.0], [-1.0]]), np.array([0.0, 1.0]))
    assert not switches(np.array([[np.nextafter(1.0, 2)]]), np.array([0.0]))
    assert not switches(np.array([[0.0]]), np.array([2.0]))


@pytest.mark.slow
def test_states_of_proved_policies_ask_for_what_is_admissible(tmp_path: Path) -> None:
    judged = proved = 0
    for number in range(4 * -(-STATES // EACH)):
        if judged >= STATES:
            break
        subject, rng = SUBJECTS[number % len(SUBJECTS)], np.random.default_rng([SEED, number])
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "model.kyx").write_text(subject.text)
        model = str(folder / "model.kyx")
        found = policy(model, [], layers=subject.network(rng))
        report = report_on(model, Asked(found, seconds=20), {})
        if report.answer != "proved":
            continue
        proved += 1
        (question,), (search,) = report.questions, report.found
        assert tuple(s.name for s in question.dimensions) == subject.names
        met = list(leaves(question, search.tree))
        boxes, codes = np.concatenate([b for b, _ in met]), np.concatenate([c for _, c in met])
        boxes = boxes[(codes == BY_BOUNDS) | (codes == BY_SOLVER)]
        answers = exported(subject, model, found, folder / "c")
        for states in states_of(subject, boxes, answers, rng):
            assert subject.admissible(states, answers(states)), (subject.name, number)
            judged += len(states)
    assert judged >= STATES and proved >= min(6, STATES // EACH)
