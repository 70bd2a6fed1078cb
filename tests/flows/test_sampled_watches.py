"""Watches that are no polynomials of time along a flow that is: compiled search and sampling reference."""

import pytest
from both_forms import quick_builds, theorem

import dl2c
from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError
from dl2c.env.opening import source_of
from dl2c.flows.kernel import FlowPlan, plan_flow
from dl2c.flows.watch import watches_of
from dl2c.interp.follow import follow
from dl2c.ir.model import Symbol
from dl2c.pipeline import check_model, step_model

START = {"x": 0.0, "v": 1.0, "a": -2.0, "t": 0.0}
"""x = t - t^2, which is 3/16 at t = 1/4 and t = 3/4 and at most 1/4; v = 1 - 2 t."""

CONDITIONS: list[tuple[str, float | None]] = [
    ("sin(x) <= 1/4", None),
    ("sin(x) <= sin(3/16)", 0.25),
    ("sin(x) <= sin(3/16) | v <= 0", 0.25),
    ("sin(x) <= sin(3/16) | v >= 0", 0.5),
    ("exp(x) < exp(1/4)", 0.5),
    ("cos(v) <= cos(1/2)", 0.25),
    ("cos(v) >= cos(1/2)", 0),
    ("sqrt(x) <= 1", None),
    ("sqrt(3/16 - x) >= 0", 0.25),
    ("1 / cos(x) <= 2 & sqrt(1 - 2*t) > -1", 0.5),
]


@pytest.mark.parametrize(("condition", "cut"), CONDITIONS)
def test_both_forms_find_where_a_condition_is_first_violated(condition: str, cut: float | None) -> None:
    definitions = (
        f"/* @safety: on_failure=terminate:failure */ Bool good(Real x, Real v, Real t) <-> ({condition});"
    )
    text = theorem(definitions, "t := 0; {x' = v, v' = a, t' = 1 & t <= 1}")
    model, _ = step_model(source_of(text), resolve_options({"tolerance": 0}))
    plan = plan_flow(model.flows[0], watches_of(model))
    assert isinstance(plan, FlowPlan) and (plan.kernel, plan.curves) == ("exact", None)
    motion = follow(plan, {Symbol(x, "variable"): v for x, v in START.items()}, waiting=(0,))
    with quick_builds():
        env = dl2c.make(text, tolerance=0)
    env.reset(options={"state": START})
    _, _, terminated, _, info = env.step(0)
    assert terminated == bool(motion.failed) == (cut is not None)
    for duration in (motion.duration, info["duration"]):
        assert duration == pytest.approx(1 if cut is None else cut, abs=1e-7)


@pytest.mark.parametrize(
    "domain",
    [
        " + ".join(f"abs(x - {k})" for k in range(14)) + " <= 900",
        " | ".join(f"max(abs(x - {k}), abs(v)) * x = abs(v - {k})" for k in range(30)),
    ],
)
def test_conditions_of_too_many_cases_are_refused_where_they_are(domain: str) -> None:
    text = theorem("", "t := 0; {x' = v, v' = a, t' = 1 & t <= 1 & (" + domain + ")}")
    with pytest.raises(CompileError) as refused:
        check_model(source_of(text), resolve_options({}))
    (found,) = refused.value.diagnostics
    assert "too many cases of abs, min and max" in found.label and "fewer" in found.help
    assert found.span.text.startswith("{x' = v")
