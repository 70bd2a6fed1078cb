"""Initial states where equalities have no solution by square roots, and where few states have a run.

The auditor evaluates the equality with fractions on both sides of a drawn name; the law is compared with
that of points in a thin shell around the solutions, weighted by the gradient (coarea formula). Neither
shares code with the sampler.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from generators.ir_builder import model
from selection import few_and_many, quick_among, quick_rows

import dl2c
from dl2c.diagnostics import render
from dl2c.ir.model import Model
from dl2c.ir.printer import print_formula
from dl2c.options import Options
from dl2c.paths.enabled import enabling
from dl2c.pipeline import Compilation
from dl2c.sampling.draw import draw_many
from dl2c.sampling.plan import NoSampler, plan_sampling
from dl2c.sampling.tables import SamplingPlan
from dl2c.source import Source

pytestmark = pytest.mark.usefixtures("unoptimised")


@dataclass(frozen=True)
class Curve:
    """An equality as text and as functions of the names in order."""

    text: str
    bounds: dict[str, str]
    value: Callable
    gradient: Callable


CURVES = [
    Curve(
        "x*x*x + y*y*y == 1",
        {"x": "-2:2", "y": "-2:2"},
        lambda x, y: x**3 + y**3 - 1,
        lambda x, y: (3 * x**2, 3 * y**2),
    ),
    Curve(
        "x*x*x*x + y*y*y*y == 1",
        {"x": "-2:2", "y": "-2:2"},
        lambda x, y: x**4 + y**4 - 1,
        lambda x, y: (4 * x**3, 4 * y**3),
    ),
    Curve(
        "y*y == x*x*x - x",
        {"x": "-2:2", "y": "-2:2"},
        lambda x, y: y**2 - x**3 + x,
        lambda x, y: (1 - 3 * x**2, 2 * y),
    ),
    Curve(
        "x**5 - 5*x**3 + 4*x == y**3 - y",
        {"x": "-2:2", "y": "-3:3"},
        lambda x, y: x**5 - 5 * x**3 + 4 * x - y**3 + y,
        lambda x, y: (5 * x**4 - 15 * x**2 + 4, 1 - 3 * y**2),
    ),
    Curve(
        "x*x*x + y*y*y + z*z*z + x*y*z == 1",
        {"x": "-1:1", "y": "-1:3", "z": "-1:1"},
        lambda x, y, z: x**3 + y**3 + z**3 + x * y * z - 1,
        lambda x, y, z: (3 * x**2 + y * z, 3 * y**2 + x * z, 3 * z**2 + x * y),
    ),
    Curve(
        "p*p + x*x + 2*x*x*y - 2*y*y*y/3 + y*y == 0.25",
        {"p": "-1:1", "x": "-1:1", "y": "-1:1"},
        lambda p, x, y: p**2 + x**2 + 2 * x**2 * y - 2 * y**3 / 3 + y**2 - Fraction(1, 4),
        lambda p, x, y: (2 * p, 2 * x + 4 * x * y, 2 * x**2 - 2 * y**2 + 2 * y),
    ),
]


def kyx(precondition: str, program: str, postcondition: str = "true", names: str = "xy") -> str:
    declared = "".join(f"  /* @var: bound=[-2:2] */\n  Real {name};\n" for name in names)
    return (
        f'ArchiveEntry "M"\nProgramVariables\n{declared}  /* @var: bound=[0:0] */\n  Real t;\nEnd.\nProblem\n'
        f"  {precondition} -> [{program}] {postcondition}\nEnd.\nEnd.\n"
    )


def planned(m):
    plan = plan_sampling(m)
    assert isinstance(plan, SamplingPlan), render(plan.diagnostic)
    return plan


def has_solution_near(curve, point, reach):
    """Whether moving one name that far each way changes the sign."""
    exact = [Fraction(v) for v in point]
    for k in range(len(exact)):
        ends = [[v + s * Fraction(reach) * (j == k) for j, v in enumerate(exact)] for s in (-1, 1)]
        if curve.value(*ends[0]) * curve.value(*ends[1]) <= 0:
            return True
    return False


@pytest.mark.parametrize("count", few_and_many(200, 1000))
@pytest.mark.parametrize("curve", quick_among(CURVES, (CURVES[0], CURVES[4])), ids=lambda c: c.text)
def test_every_state_is_next_to_a_solution(count, curve):
    plan = planned(model(curve.text, curve.bounds))
    assert plan.certificate == "witness" and plan.error_bound < 1e-11
    columns = draw_many(plan, np.random.default_rng(1), count)
    for point in zip(*(columns[n].tolist() for n in curve.bounds), strict=True):
        assert has_solution_near(curve, point, plan.error_bound)
        limits = [map(float, b.split(":")) for b in curve.bounds.values()]
        assert all(low <= v <= high for v, (low, high) in zip(point, limits, strict=True))


@pytest.mark.parametrize("curve", quick_among(CURVES, CURVES[2:3]), ids=lambda c: c.text)
def test_law_is_uniform_by_length_or_area(curve):
    """Cells of a grid hold as much of the draws as of a thin shell."""
    plan = planned(model(curve.text, curve.bounds))
    columns = draw_many(plan, np.random.default_rng(2), 20_000)
    drawn = np.array([columns[n] for n in curve.bounds])
    limits = np.array([[float(e) for e in b.split(":")] for b in curve.bounds.values()])
    rng = np.random.default_rng(3)
    tries = limits[:, :1] + rng.random((len(limits), 5_000_000)) * (limits[:, 1:] - limits[:, :1])
    shell = tries[:, np.abs(curve.value(*tries).astype(float)) < 0.01]
    weight = np.sqrt(np.sum(np.square(np.array(curve.gradient(*shell), dtype=float)), axis=0))

    def cells(points):
        place = (points - limits[:, :1]) / (limits[:, 1:] - limits[:, :1])
        at = np.floor(place * 5).clip(0, 4).astype(int)
        return np.ravel_multi_index(tuple(at), (5,) * len(limits))

    count = 5 ** len(limits)
    part = np.bincount(cells(drawn), minlength=count) / drawn.shape[1]
    mass = np.bincount(cells(shell), weight, minlength=count) / weight.sum()
    spread = np.bincount(cells(shell), weight**2, minlength=count) / weight.sum() ** 2
    error = np.sqrt(spread + mass * (1 - mass) / drawn.shape[1])
    assert shell.shape[1] > 5_000
    assert np.all(np.abs(part - mass) < 5 * error + 0.003), (part, mass)


@pytest.mark.parametrize(("text", "value"), [("x*x*x == 8", 2.0), ("x**5 + x == 34", 2.0)])
def test_one_unknown_has_its_root(text, value):
    plan = planned(model(text, {"x": "-10:10", "y": "0:1"}))
    columns = draw_many(plan, np.random.default_rng(4), 50)
    assert np.abs(columns["x"] - value).max() <= plan.error_bound
    assert len(set(columns["y"].tolist())) == 50


def test_compiled_resets_lie_on_the_curve(tmp_path: Path) -> None:
    """The library finds the same roots: energies of the Henon-Heiles system."""
    source = tmp_path / "star.kyx"
    energy = "1/2*(v^2 + w^2 + x^2 + y^2) + x^2*y - 1/3*y^3 = 1/8"
    motion = "{x' = v, y' = w, v' = -x - 2*x*y, w' = -(y + x^2 - y^2)}"
    source.write_text(kyx(energy, motion, energy, "xyvw"), encoding="utf-8")
    env = dl2c.make(str(source))
    for seed in range(200):
        env.reset(seed=seed)
        x, y, v, w = (env.unwrapped.state[n] for n in "xyvw")
        assert abs(0.5 * (v * v + w * w + x * x + y * y) + x * x * y - y**3 / 3 - 0.125) < 1e-11
    env.close()


def test_too_high_degrees_are_refused():
    plan = plan_sampling(model("x**13 + x*x*y*y == y**13 + 1", {"x": "-1:1", "y": "-1:3"}))
    assert isinstance(plan, NoSampler)
    assert "determines no name" in plan.diagnostic.label


# States that have a run -------------------------------------------------------


def drawn(precondition: str, program: str) -> Model:
    return Compilation(Source("m.kyx", kyx(precondition, program)), Options()).lowered.drawn


FEW = [
    ("x <= 1", "{t := 0; {x' = 1, y' = 2*x, t' = 1 & y = x^2 & t <= 0.1}}*"),
    ("x <= 1", "?y = x^2; {t := 0; {x' = 1, y' = 2*x, t' = 1 & t <= 0.1}}*"),
    ("x <= 1", "{{?(y = x^2 & x > 0); y := x^2; ++ ?(y = x^2 & x < 0);} t := 0;}*"),
]


@pytest.mark.parametrize(("precondition", "program"), quick_rows(FEW, FEW[:1]))
def test_where_few_states_have_a_run_these_are_drawn(precondition: str, program: str, tmp_path: Path) -> None:
    source = tmp_path / "m.kyx"
    source.write_text(kyx(precondition, program), encoding="utf-8")
    env = dl2c.make(str(source))
    for seed in range(100):
        _, info = env.reset(seed=seed)
        state = env.unwrapped.state
        assert abs(state["y"] - state["x"] ** 2) < 1e-11
        assert state["x"] <= 1
        assert info.get("action_mask", np.ones(1)).any()
    env.close()


def test_where_many_states_have_a_run_the_plan_stays() -> None:
    """Nothing is added to the precondition where resets may as well draw again."""
    m = drawn("x <= 1", "{?y <= x; x := y; t := 0;}*")
    plan = planned(m)
    assert plan.precondition == m.precondition
    assert enabling(m) != m.precondition


def test_enabling_is_about_the_state_before_anything_changes() -> None:
    program = "{x := 1; ?x <= 0 & y >= 1; {?y <= 2; ++ y := 0; ?y > 5;} ?y > 3;}*"
    m = drawn("true", program)
    assert print_formula(enabling(m)) == "y >= 1"
