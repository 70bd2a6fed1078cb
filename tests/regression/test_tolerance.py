"""How much a predicate may be missed by: slack grows with terms, and is frozen where a flow begins."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from both_forms import Both, theorem
from conftest import shared
from generators.ir_builder import formula

import dl2c
from dl2c.configuration import resolve_options
from dl2c.flows.watch import watches_of
from dl2c.ir.evaluate import truth
from dl2c.ir.logic import symbols
from dl2c.ir.model import Compare, Symbol
from dl2c.ir.printer import print_term
from dl2c.ir.slack import relaxed, terms_of
from dl2c.pipeline import emit, step_model
from dl2c.source import Source

pytestmark = pytest.mark.usefixtures("unoptimised")


def safe(condition: str, parameters: str = "Real x", on_failure: str = "terminate:failure") -> str:
    return f"/* @safety: penalty=-1, on_failure={on_failure} */ Bool below({parameters}) <-> ({condition});"


def unannotated(variables: str, problem: str) -> str:
    declared = " ".join(f"Real {name};" for name in variables.split())
    return f'Theorem "m" ProgramVariables {declared} End.\nProblem {problem} End. End.\n'


# Terms of a comparison ---------------------------------------------------------


@pytest.mark.parametrize(
    ("atom", "terms"),
    [
        ("x + y - 3 <= 0", ["x", "y", "3"]),
        ("-(x - 2 * y) >= z", ["x", "2 * y", "z"]),
        ("2 * (x - y) == z**2 + x / y", ["2 * (x - y)", "z^2", "x / y"]),
        ("abs(x - y) < 0", ["abs(x - y)"]),
    ],
)
def test_slack_grows_with_the_additive_terms_of_both_sides(atom: str, terms: list[str]) -> None:
    found = formula(atom)
    assert isinstance(found, Compare)
    assert [print_term(t) for t in terms_of(found)] == terms


def test_terms_that_cancel_leave_their_size() -> None:
    """A difference of numbers near 1e9 may be off by 1e-9 of them, not of their difference."""
    env = dict.fromkeys(symbols(formula("x + y == 0")), 0.0)
    near = env | {Symbol("x", "variable"): 1e9, Symbol("y", "variable"): -1e9 + 1.5}
    atom = relaxed(formula("x + y == 0"), resolve_options({}).tolerance)
    assert truth(atom, near)
    assert not truth(atom, near | {Symbol("y", "variable"): -1e9 + 2.5})


def test_a_state_after_a_step_is_judged_with_its_own_slack() -> None:
    model = Both(theorem(safe("x - 90 = 0"), "x := a; t := 0;"), tolerance="0.001")
    assert model.first(x=90, a=90.15).cost == 0
    assert model.first(x=90, a=90.25).cost == 1


def test_differences_stay_strict_about_being_different() -> None:
    model = Both(theorem(safe("x != 0"), "x := a; t := 0;"), tolerance=1)
    assert (model.first(x=1, a=1e-12).cost, model.first(x=1, a=0).cost) == (0, 1)


# Along flows -------------------------------------------------------------------

FORWARD = "t := 0; {x' = v, t' = 1 & t <= 9}"


def test_slack_along_a_flow_is_that_of_its_beginning() -> None:
    """From x = 0 with tolerance 1/2: x <= 1 + 1/2*(1 + 0 + 1). With its own slack x could go to 4."""
    seen = Both(theorem(safe("x <= 1"), FORWARD), tolerance="0.5").first(x=0, v=1)
    assert (seen.duration, seen.state["x"], seen.cost) == (2, 2, 1)
    assert seen.ending == ("terminated", "failure", "below")


def test_slack_of_a_later_flow_is_that_of_its_own_beginning() -> None:
    body = "t := 0; {x' = v, t' = 1 & t <= 1}"
    model = Both(theorem(safe("x <= 1"), body), tolerance="0.5")
    first = model.first(x=1, v=0.25)
    assert (first.duration, first.state["x"], first.cost) == (1, 1.25, 0)
    model.begin(x=2, v=1)
    seen = model.step()
    assert (seen.duration, seen.state["x"]) == (1, 3), "1/2*(1 + 2 + 1) from x = 2 on"


def test_obligations_use_the_slack_of_the_beginning() -> None:
    definitions = """/* @progress: reward=1, on_failure=terminate:failure */ Bool below(Real x) <-> x >= 4;"""
    text = theorem(definitions, FORWARD, "(t >= 3 -> below(x))")
    model = Both(text, tolerance="0.25")
    assert model.first(x=0, v=1).ending == ("", "none", ""), "met at x = 4 - (1 + 4)/4 = 2.75, before t = 3"
    assert model.first(x=0, v=0.5).ending == ("terminated", "failure", "below")


def test_a_slack_without_a_value_relaxes_nothing() -> None:
    """1/x has no value where the flow begins; the predicate still holds where it does exactly."""
    body = "t := 0; {x' = 1, y' = -1, t' = 1 & t <= 1.5}"
    condition = "y >= 0 | 1/x >= 1/2"
    text = theorem(safe(condition, "Real x, Real y"), body, "below(x, y)", variables="y")
    seen = Both(text).first(x=0, y=1)
    assert (seen.duration, seen.cost, seen.ended) == (1.5, 0, False)


def test_slacks_add_no_cases_to_what_is_watched() -> None:
    definitions = safe("x + a * v <= 1 & v - a >= x", "Real x, Real v, Real a")
    text = theorem(definitions, "t := 0; {x' = v, v' = a, t' = 1 & t <= 9}", "below(x, v, a)")
    model, _ = step_model(Source("m.kyx", text), resolve_options({}))
    (watch,) = watches_of(model)
    kinds = {s.kind for s in symbols(watch.stays)}
    assert "start" in kinds and "abs" not in str(watch.stays)


# What a flow conserves ---------------------------------------------------------

CROSSING = unannotated("x y c", "x^2+x^3-y^2-c=0 -> [{x' = -2*y, y' = -2*x - 3*x^2}] x^2+x^3-y^2-c=0")


def reasons(env: Any, episodes: int) -> set[str]:
    found: set[str] = set()
    for seed in range(episodes):
        env.reset(seed=seed)
        found.add(env.step(env.action_space.sample())[4]["reason"])
    return found


def states(text: str, steps: int, **options: Any) -> Iterator[dict[str, float]]:
    """Those after each step of an episode in which nothing fails."""
    env: Any = dl2c.make(text, **options)
    env.reset(seed=0)
    for _ in range(steps):
        _, _, terminated, _, info = env.step(0)
        assert not terminated and info["cost"] == 0
        yield env.state


@pytest.mark.parametrize("integrator", ["cvodes", "dopri5"])
def test_drift_fails_no_conserved_equality(integrator: str) -> None:
    env = dl2c.make(CROSSING, default_bound="-10:10", integrator=integrator)
    assert "postcondition" not in reasons(env, 50)


@pytest.mark.slow
def test_published_models_with_conserved_equalities_do_not_fail() -> None:
    path = shared("corpus") / "LS-Lab__KeYmaeraX-projects" / "lfcps" / "lfcps.kyx"
    for entry in ("10: Self-crossing invariant", "10: Simple rotational dynamics"):
        env = dl2c.make(path, entry=f"LFCPS Textbook/{entry}", default_bound="-10:10")
        assert reasons(env, 50) == {"end"}


@pytest.mark.parametrize("integrator", ["cvodes", "dopri5"])
def test_several_conserved_equalities_are_kept_together(integrator: str) -> None:
    """A rigid body keeps energy and momentum; without projection they drift by 1e-8 in 500 steps."""
    text = unannotated(
        "x y z t",
        "x=1&y=1&z=1&t=0 -> [{t := 0; {x'=y*z, y'=-2*x*z, z'=x*y, t'=1 & t<=1}}*] (2*x^2+y^2=3 & x^2-z^2=0)",
    )
    for s in states(text, 500, integrator=integrator):
        assert abs(2 * s["x"] ** 2 + s["y"] ** 2 - 3) < 1e-13 and abs(s["x"] ** 2 - s["z"] ** 2) < 1e-13


@pytest.mark.parametrize("integrator", ["cvodes", "dopri5"])
def test_quotients_and_roots_are_kept(integrator: str) -> None:
    """The energy of a planet that comes near its sun drifts by 1e-8 in 200 steps without projection."""
    text = unannotated(
        "x y v w t",
        "x=1/2&y=0&v=0&w=17/10&t=0 -> [{t := 0; {x'=v, y'=w, v'=-x/(x^2+y^2)^(3/2), w'=-y/(x^2+y^2)^(3/2), "
        "t'=1 & t<=1}}*] (v^2+w^2)/2 - 1/(x^2+y^2)^(1/2) = -111/200",
    )
    for s in states(text, 200, integrator=integrator):
        assert abs((s["v"] ** 2 + s["w"] ** 2) / 2 - 1 / np.hypot(s["x"], s["y"]) + 111 / 200) < 1e-13


@pytest.mark.parametrize("integrator", ["cvodes", "dopri5"])
def test_equalities_hold_together_where_a_bound_ends_the_flow(integrator: str) -> None:
    """That a bead stays on its hoop follows from where its velocity points to; a bound ends the flow."""
    text = unannotated(
        "x y v c s r g",
        "r>=1&r<=3&g>=1&g<=10&v=2&x=0&y=-r&c=-y/r&s=x/r -> "
        "[{x'=v*c, y'=v*s, v'=-g*s, c'=-s*v/r, s'=c*v/r & y <= -r/2 & x <= r/3}]"
        "(c=-y/r & s=x/r & x^2+y^2=r^2 & v^2+2*g*y=4-2*g*r)",
    )
    env: Any = dl2c.make(text, integrator=integrator, safety_check="step", default_bound="-10:10")
    for seed in range(40):
        env.reset(seed=seed)
        constants = env.unwrapped.state
        assert env.step(0)[4]["reason"] == "end"
        after = env.state
        r, g = constants["r"], constants["g"]
        assert abs(after["x"] ** 2 + after["y"] ** 2 - r**2) < 1e-13 * (1 + r**2)
        assert abs(after["c"] + after["y"] / r) < 1e-13 and abs(after["s"] - after["x"] / r) < 1e-13
        assert abs(after["v"] ** 2 + 2 * g * after["y"] - 4 + 2 * g * r) < 1e-12 * (1 + g * r)


def test_an_equality_that_did_not_hold_is_not_made_to_hold() -> None:
    text = unannotated("x y t", "x=2&y=0&t=0 -> [{t := 0; {x'=y*x, y'=-x^2, t'=1 & t<=1}}*] x^2+y^2=1")
    env: Any = dl2c.make(text, safety_check="step", integrator="cvodes")
    env.reset(seed=0)
    assert env.step(0)[4]["reason"] == "postcondition"
    assert env.state["x"] ** 2 + env.state["y"] ** 2 == pytest.approx(4, abs=1e-7)


# Plain Python ------------------------------------------------------------------


def module_of(text: str, folder: Path, **options: Any) -> Any:
    made = emit(Source("m.kyx", text), "gym", resolve_options(options), True)
    module = ModuleType("plain_m")
    sys.modules[module.__name__] = module
    exec(compile(made, str(folder / "plain_m.py"), "exec"), vars(module))
    return next(v for k, v in vars(module).items() if k.endswith("Env"))


@pytest.mark.parametrize("condition", ["x <= 1", "x + a * v <= 1 | x >= 70", "!(x > 1 & v > -9)"])
def test_plain_python_freezes_slack_too(condition: str, tmp_path: Path) -> None:
    definitions = safe(condition, "Real x, Real v, Real a")
    text = theorem(definitions, FORWARD, "below(x, v, a)")
    plain = module_of(text, tmp_path, tolerance="0.5")()
    built: Any = dl2c.make(text, tolerance="0.5")
    start = {"x": 0.0, "v": 1.0, "a": 0.0, "t": 0.0}
    outcomes: list[tuple[Any, ...]] = []
    for env in (plain, built):
        env.reset(options={"state": start})
        observation, reward, terminated, _, info = env.step(0)
        outcomes.append((np.asarray(observation).tolist(), reward, terminated, info["cost"]))
        assert info["duration"] == pytest.approx(2)
    assert outcomes[0] == outcomes[1]
