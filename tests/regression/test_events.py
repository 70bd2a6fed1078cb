"""Ends of flows that were once missed, met too early, or thrown back to the beginning.

The oracle is in tests/oracles: closed forms at forty digits. Random campaigns of the same are in
tests/campaigns/test_narrow_events.py.
"""

from functools import cache
from random import Random
from typing import Any

import pytest
from oracles.motions import INTEGRATOR, LINE, MOTIONS, Motion
from oracles.narrow_events import ATOL, RTOL, Case, Tally, draw_case, judge, narrow_environment, take, told
from oracles.narrow_forms import FORMS, Form, high
from selection import few_and_many

import dl2c

pytestmark = pytest.mark.usefixtures("unoptimised")

KERNELS = ("exact", "linear", "cvodes", "dopri5")
BESIDE = {kernel: MOTIONS[kernel][0] for kernel in KERNELS}
"""x' = v, beside another equation where that decides how the flow is followed."""

TRIED: dict[str, Form] = {form.name: form for form in FORMS if form.name in ("rational", "root")} | {
    form.name: form for form in FORMS if "power" in form.name
}
CENTRES = 24


def theorem(variables: str, problem: str, definitions: str = "") -> str:
    declared = "".join(f" Real {name};" for name in variables.split())
    return (
        f'Theorem "events" Definitions {definitions} End.\n'
        f"ProgramVariables{declared} End.\nProblem {problem} End. End.\n"
    )


# A flow was thrown back to its beginning, in every step ------------------------

OBSTACLE = "{x'=1,t'=1&t<=1& sqrt((x-c)^2+1/10000000000) >= 2/100000}"


@pytest.mark.parametrize("centre", [0.36110127823283333, 0.7658864504340916])
@pytest.mark.parametrize("integrator", ["auto", "cvodes", "dopri5"])
def test_a_flow_is_not_thrown_back(integrator: str, centre: float) -> None:
    text = theorem("x t c", f"x=0&t=0 -> [{{ t:=0; {OBSTACLE} }}*] true")
    env: Any = dl2c.make(text, integrator=integrator, default_bound="-10:10")
    env.reset(options={"state": {"x": 0.0, "t": 0.0, "c": centre}})
    info = env.step(env.action_space.sample())[4]
    right = float(high.mpf(centre) - high.sqrt(high.mpf("3e-10")))
    assert env.state["x"] == pytest.approx(right, abs=1e-12 if integrator == "auto" else 1e-9)
    assert [info["duration"], env.state["t"]] == pytest.approx([env.state["x"]] * 2, abs=1e-12)


def test_a_flow_is_not_thrown_back_from_a_written_centre() -> None:
    problem = OBSTACLE.replace("c", "36110127823283333/100000000000000000", 1)
    env: Any = dl2c.make(theorem("x t", f"x=0&t=0 -> [{{ t:=0; {problem} }}*] true"))
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert env.state["x"] == pytest.approx(0.36108395772475765, abs=1e-12)


# Narrow events of quotients, roots and powers were missed, or met too early ----


@cache
def narrow(kernel: str) -> Any:
    return narrow_environment(kernel, BESIDE[kernel], tuple(TRIED.values()))


def narrow_case(motion: Motion, form: str, width: float, random: Random) -> Case:
    start = motion.draw(random) | {"x": 0.0, "v": 1.0, "e": 1.0, "t": 0.0}
    return Case(list(TRIED).index(form), start | {"c": random.uniform(0.05, 0.95), "w": width})


@pytest.mark.parametrize("count", few_and_many(6, CENTRES))
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("form", TRIED)
def test_no_narrow_event_is_missed_or_met_early(count: int, kernel: str, form: str) -> None:
    """Half widths of 1e-2 to 1e-7 of the path."""
    tally, random, motion = Tally(), Random(f"{kernel} {form}"), BESIDE[kernel]
    forms = tuple(TRIED.values())
    for width in (1e-2, 1e-3, 3e-4, 1e-4, 1e-5, 1e-6, 1e-7):
        for _ in range(count):
            case = narrow_case(motion, form, width, random)
            seen = take(narrow(kernel), case)
            verdict = judge(kernel, motion, case, seen, forms)
            tally.add(verdict, f"half width {width}", told(kernel, motion, case, seen, forms))
    assert not tally.faults(), "\n".join([*map(str, sorted(tally.faulty.items())), *tally.wrong])
    assert tally.counts["ended"] >= 6 * count
    assert tally.counts["ended"] + tally.counts["skipped: below the tolerance"] == 7 * count


@pytest.mark.parametrize(
    ("kernel", "motion", "start"),
    [
        (
            "cvodes",
            "logistic",
            {
                "x": 0.6830972930596173,
                "k": -0.09552276547098612,
                "e": 6.2582778082887,
                "c": 0.5424561470980915,
                "w": 7.852333630506676e-08,
            },
        ),
        (
            "cvodes",
            "line",
            {
                "x": -0.47251793996469815,
                "v": 0.04394032180497619,
                "e": 2.4245707402623635,
                "c": -0.47251787139398815,
                "w": 6.290716505098179e-08,
            },
        ),
        (
            "dopri5",
            "rotation",
            {
                "x": 0.34135996457717815,
                "y": 0.5138659804726927,
                "k": 1.3183065094045194,
                "e": 6.629981001077856,
                "c": 0.6169156827577763,
                "w": 1.5521149792883307e-07,
            },
        ),
    ],
)
def test_a_dip_little_deeper_than_rounding_ends_a_flow(
    kernel: str, motion: str, start: dict[str, float]
) -> None:
    """x^2-2*c*x+c^2 >= w^2 fails by 5e-15 to 3e-14 of terms that are about 1."""
    forms = tuple(form for form in FORMS if form.name == "expanded")
    moved = next(m for m in MOTIONS[kernel] if m.name == motion)
    case = Case(0, start | {"t": 0.0})
    seen = take(narrow_environment(kernel, moved, forms), case)
    assert judge(kernel, moved, case, seen, forms) == "ended", told(kernel, moved, case, seen, forms)


WRITTEN = {
    "1/(1+10000000000*(x-37/100)^2) <= 1/2": 5,
    **{f"(x-37/100)^{d}*{10 ** (d * w)} >= 1": w for d in (2, 4, 6, 8) for w in (4, 5, 7)},
}
"""Conditions with everything written as numbers, and minus the logarithms of their half widths."""


@cache
def written(integrator: str) -> Any:
    flows = " ++ ".join(f"{{x'=1,t'=1&t<=1&{condition}}}" for condition in WRITTEN)
    return dl2c.make(theorem("x t", f"x=0&t=0 -> [{{ t:=0; {{{flows}}} }}*] true"), integrator=integrator)


@pytest.mark.parametrize("integrator", ["exact", "cvodes", "dopri5"])
@pytest.mark.parametrize("condition", WRITTEN)
def test_written_numbers_make_no_difference(integrator: str, condition: str) -> None:
    """x moves at one a second, which solvers follow to a few roundings; so 1e-7 is wide enough for them."""
    env = written(integrator)
    env.reset(seed=0)
    info = env.step(list(WRITTEN).index(condition))[4]
    right = 0.37 - 10.0 ** -WRITTEN[condition]
    assert info["duration"] == pytest.approx(right, abs=1e-9 if integrator == "exact" else 1e-8)


# The same as a violation of @safety on the way -------------------------------


@cache
def watched(kernel: str) -> Any:
    """Form k is watched where n = k."""
    motion = BESIDE[kernel]
    definitions = "\n".join(
        f"/* @safety: penalty=-1, on_failure=terminate:failure */ "
        f"Bool p{k}(Real x, Real c, Real w, Real n) <-> (n = {k} -> {form.text});"
        for k, form in enumerate(TRIED.values())
    )
    safe = " & ".join(f"p{k}(x, c, w, n)" for k in range(len(TRIED)))
    flow = f"{{{motion.equations},t'=1 & t<=e}}"
    text = theorem(
        f"x c w e t n {motion.variables}", f"w != 0 -> [{{ t := 0; {flow} }}*] ({safe})", definitions
    )
    return dl2c.make(
        text, integrator=INTEGRATOR[kernel], default_bound="-1e6:1e6", tolerance=0, rtol=RTOL, atol=ATOL
    )


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("form", TRIED)
def test_narrow_violations_are_seen_along_the_flow(kernel: str, form: str) -> None:
    env, random, motion = watched(kernel), Random(f"{form} {kernel}"), BESIDE[kernel]
    number = list(TRIED).index(form)
    slack = 1e-9 if kernel in ("exact", "linear") else 10 * (RTOL + ATOL)
    for width in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
        for _ in range(CENTRES // 3):
            case = narrow_case(motion, form, width, random)
            c = high.mpf(case.start["c"])
            right = float(TRIED[form].fails(c, high.mpf(width))[0])
            env.reset(options={"state": case.start | {"n": float(number)}})
            _, reward, terminated, _, info = env.step(env.action_space.sample())
            found = (info["cost"], reward, terminated, info["reason"], info["status"])
            assert found == (1, -1, True, f"p{number}", "failure"), (case.start, info)
            assert info["duration"] == pytest.approx(right, abs=slack), case.start


# A double root of `!=` was passed where zeros pad the polynomial ---------------

DOUBLE_ROOTS = {
    "degree 2": "p0+p1*t+p2*t^2",
    "degree 5": "p0+p1*t+p2*t^2+p3*t^3+p4*t^4+p5*t^5",
}


@pytest.mark.parametrize("form", DOUBLE_ROOTS)
def test_a_double_root_stops_a_flow_in_every_form(form: str) -> None:
    """(t - 5/2)^2 is zero in doubles some 1e-8 around its root."""
    flow = f"{{t'=1 & t<=4 & ({DOUBLE_ROOTS[form]}) != 0}}"
    env: Any = dl2c.make(
        theorem("t p0 p1 p2 p3 p4 p5", f"true -> [{{ t := 0; {flow} }}*] true"), default_bound="-10:10"
    )
    coefficients = dict(
        zip(("p0", "p1", "p2", "p3", "p4", "p5"), (6.25, -5.0, 1.0, 0.0, 0.0, 0.0), strict=True)
    )
    env.reset(options={"state": {"t": 0.0} | coefficients})
    info = env.step(env.action_space.sample())[4]
    assert info["duration"] == pytest.approx(2.5, abs=1e-7)
    t = env.state["t"]
    assert sum(c * t**k for k, c in enumerate(coefficients.values())) != 0


def test_drawn_cases_meet_events() -> None:
    """The campaign's own draws: most have an event on their path."""
    random = Random(3)
    cases = [draw_case(LINE, random) for _ in range(200)]
    forms = [FORMS[case.form].fails(high.mpf(case.start["c"]), high.mpf(case.start["w"])) for case in cases]
    assert 120 < sum(bool(LINE.meetings(c.start, f)) for c, f in zip(cases, forms, strict=True)) < 200
