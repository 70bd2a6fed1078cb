"""What is taught is admissible, by exact evaluation; boxes are split where that helps the network."""

from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from policy_proof.test_verify_policy import SWITCH, TANK

from dl2c.commands.policy import Asked, blank, verifier
from dl2c.env.interface import interface_of
from dl2c.env.opening import compilation_of
from dl2c.ir.evaluate import truth
from dl2c.native.describe import manifest_of
from dl2c.policy.network import Layer, Network, NetworkPolicy
from dl2c.policy_proof.question import Case, Question
from dl2c.policy_proof.search import _balanced
from dl2c.training.lessons import Teacher
from dl2c.training.states import Doubles

EXAMPLES = Path(__file__).parents[2] / "examples"
MODELS = {
    "tank": (TANK, {}),
    "switch": (SWITCH, {}),
    "watertank": ((EXAMPLES / "watertank.kyx").read_text(), {"U": 0.45}),
    "acc": ((EXAMPLES / "acc.kyx").read_text(), {"b": 4.0, "A": 2.0}),
    "static_safety_line": ((EXAMPLES / "static_safety_line.kyx").read_text(), {"gap": 2.0}),
}


def teacher(folder: Path, name: str, text: str = "") -> Teacher:
    """Of a model, for a policy that asks for the same everywhere."""
    text, constants = (text, {}) if text else MODELS[name]
    (folder / f"{name}.kyx").write_text(text)
    model, options = str(folder / f"{name}.kyx"), {"constants": constants}
    manifest = manifest_of(compilation_of(model, options).planned.build, "", {})
    interface = interface_of(manifest)
    size = interface.outputs, len(interface.observations)
    network = Network((), (Layer(np.zeros(size), np.full(size[0], 0.25), "identity"),))
    small = partial(blank, hidden=(8,), activation="relu")
    verify = verifier(model, Asked(folder, seconds=0.5), options, small)
    report = verify(NetworkPolicy(manifest.name, interface, network, False, manifest.options))
    return Teacher(report.questions[0], np.random.default_rng(0))


def conclusion(question: Question, values: list[float]) -> Case:
    """The case of requests."""
    for case in question.cases:
        for p in case.premises:
            low, high = p.low, p.high
            value = Fraction(values[p.request])
            above = low is None or value > low or (value == low and not p.inside)
            if not above or not (high is None or value < high or (value == high and not p.inside)):
                break
        else:
            return case
    raise AssertionError(values)


def admits(question: Question, state: Doubles, values: list[float]) -> bool:
    env = dict(zip(question.dimensions, map(Fraction, state.tolist()), strict=True))
    env |= {r.symbol: Fraction(v) for r, v in zip(question.requests, values, strict=True)}
    return truth(conclusion(question, values).conclusion, env, exact=True)


def assumed(question: Question, state: Doubles) -> bool:
    env = dict(zip(question.dimensions, map(Fraction, state.tolist()), strict=True))
    inside = all(low <= env[s] <= high for s, (low, high) in zip(env, question.box, strict=True))
    return inside and truth(question.hypothesis, env)


@pytest.mark.parametrize("name", MODELS)
def test_states_are_those_of_the_question(tmp_path: Path, name: str) -> None:
    found = teacher(tmp_path, name)
    middle = np.array([[float(a + b) / 2] * 2 for a, b in found.question.box])
    for states in (found.drawn(300), found.near_guards(100, 0.01), found.around(middle, 100)):
        assert states.shape[1] == len(found.question.dimensions)
        assert all(assumed(found.question, state) for state in states)
    assert len(found.drawn(300)) == 300


@pytest.mark.parametrize("name", ["tank", "watertank", "acc"])
def test_requests_that_are_wanted_are_admissible(tmp_path: Path, name: str) -> None:
    """And so are those from one end to the other of what is fine, of which the nearest is wanted."""
    found = teacher(tmp_path, name)
    states = np.concatenate([found.drawn(150), found.near_guards(150, 0.02)])
    outputs = found.rng.uniform(-1, 1, (len(states), len(found.question.requests)))
    lesson = found.lesson(states, outputs, 0.005)
    low, high = found.ends
    inside = np.clip(lesson.fine, low[:, None], high[:, None])
    wanted = np.clip(lesson.wanted, low[:, None], high[:, None])
    assert (lesson.fine[..., 0] <= lesson.fine[..., 1]).all()
    assert (inside[..., 0] <= wanted[..., 0]).all() and (wanted[..., 1] <= inside[..., 1]).all()
    for state, ends in zip(states, inside, strict=True):
        for share in (0.0, 0.5, 1.0):
            values = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
            rounded = np.where(found.rounded, np.round(values), values)
            assert admits(found.question, state, rounded.tolist()), (state, rounded)


@pytest.mark.parametrize("name", ["switch", "static_safety_line"])
def test_choices_that_are_wanted_are_admissible(tmp_path: Path, name: str) -> None:
    found = teacher(tmp_path, name)
    states = np.concatenate([found.drawn(150), found.near_guards(150, 0.02)])
    outputs = found.rng.uniform(-1, 1, (len(states), found.winners.max() + 1))
    lesson = found.lesson(states, outputs, 0.005)
    for state, wanted, fine in zip(states, lesson.wanted, lesson.fine, strict=True):
        env = dict(zip(found.question.dimensions, map(Fraction, state.tolist()), strict=True))
        true = [truth(case.conclusion, env, exact=True) for case in found.question.cases]
        assert fine[wanted] and all(true[k] for k in np.flatnonzero(fine))


def test_what_is_admissible_is_left_as_it_is(tmp_path: Path) -> None:
    found = teacher(tmp_path, "tank")
    states, outputs = np.array([[2.5]]), np.array([[0.3]])
    lesson = found.lesson(states, outputs, 0.01)
    assert lesson.wanted.tolist() == [[[0.3, 0.3]]] and lesson.weight.tolist() == [1.0]
    low, high = lesson.fine[0, 0]
    assert low == -np.inf and 0.55 < high < 0.6  # the limit is 0.6 in single precision, which is more
    assert len(found.refused(states, outputs, 0.01)) == 0
    empty = np.array([[0.1]])
    assert found.lesson(empty, np.array([[0.0]]), 0.01).wanted[0, 0, 0] > 0.15
    assert found.refused(empty, np.array([[0.0]]), 0.0).tolist() == [[0.1]]


def test_states_near_guards_are_near_guards(tmp_path: Path) -> None:
    """Choices change at -1 and 1 only."""
    found = teacher(tmp_path, "switch")
    states = found.near_guards(200, 0.01)
    assert len(states) == 200
    assert np.abs(np.abs(states) - 1).max() <= 0.01 * 4 + 4 / 2**12


CURVE = TANK.replace("Real l;", "Real l;\n  /* @var: bound=[-1:1] */ Real m;").replace(
    "0 <= l & l <= 5", "{assumed}"
)


@pytest.mark.parametrize(
    "assumed", ["l^2 + m^2 = 1", "m = l / 3 - 0.1", "m^2 = l & l <= 1/2", "exp(m) = 1 + l"]
)
def test_states_satisfy_equations_among_what_is_assumed(tmp_path: Path, assumed: str) -> None:
    """As nearly as doubles do; also those around others, and those that are observed in single precision."""
    found = teacher(tmp_path, "curve", CURVE.replace("{assumed}", assumed))
    (equation,) = found.equations
    states = found.drawn(300)
    middle = np.stack([states[0], states[0]], axis=1)
    rounded = found.states_seen(found.observations(states).astype(np.float32).astype(float))
    assert len(states) == 300 and len(rounded) == 300 and len(found.around(middle, 50)) > 0
    for some in (states, rounded, found.near_guards(50, 0.01), *found._around(states, 0.02)):
        apart = found.value(equation.left, some) - found.value(equation.right, some)
        assert np.abs(apart).max(initial=0.0) < 1e-8


def test_nothing_is_taught_where_no_request_is_found(tmp_path: Path) -> None:
    """A narrow one is found with more values; of several there are too few."""
    wide = "?0 <= l + u - 0.25 & l + u - 0.25 <= 5"
    found = teacher(tmp_path, "narrow", TANK.replace(wide, "?l / 10 <= u & u <= l / 10 + 0.01"))
    states = found.drawn(200)
    lesson = found.lesson(states, np.zeros((200, 1)), 0.0)
    assert len(lesson.wanted) > 190 and np.isfinite(lesson.wanted).any(axis=2).all()
    wanted = np.clip(lesson.wanted[:, 0, 0], 0, 0.6)
    levels = lesson.observations[:, [o.name for o in found.question.observed].index("l")]
    assert ((levels / 10 <= wanted + 1e-9) & (wanted <= levels / 10 + 0.01 + 1e-9)).all()
    exact = teacher(tmp_path, "exact", TANK.replace(wide, "?u = l / 10"))
    assert len(exact.lesson(states, np.zeros((200, 1)), 0.0).wanted) < 20


def test_boxes_do_not_become_much_narrower_in_one_dimension() -> None:
    box = np.array([[[0.0, 1.0], [0.0, 1.0 / 64], [0.0, 1.0]]])
    widths, splits = np.ones(3), np.array([1], np.uint8)
    every, two = np.array([True, True, True]), np.array([False, True, True])
    assert _balanced(box, splits, widths, every).tolist() == [0]
    assert _balanced(box, splits, widths, two).tolist() == [2]
    assert _balanced(box, splits, widths, np.array([False, True, False])).tolist() == [1]
    assert _balanced(box, np.array([2], np.uint8), widths, every).tolist() == [2]
    none = np.empty((1, 0, 2)), np.array([255], np.uint8), np.empty(0), np.empty(0, np.bool_)
    assert _balanced(*none).tolist() == [255]
