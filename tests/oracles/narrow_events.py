"""Random flows with one narrow event, their models, and judgement of when a flow ended.

A flow must end where x first enters the interval on which its condition fails. For exact and linear kernels
that is known to the rounding of the condition as written; a flow that a solver follows may be off by its
tolerance, so it must end between the entries into a slightly wider and a slightly narrower interval.
"""

from collections import Counter
from dataclasses import dataclass, field
from random import Random
from typing import Any

from mpmath import mpf
from oracles.motions import INTEGRATOR, Motion, log_uniform
from oracles.narrow_forms import FORMS, Form, Interval, high

import dl2c

SHARE = 1e-9
"""Of the time of a flow, by which its end may be off."""
RTOL, ATOL = 1e-9, 1e-11
ROUNDINGS = 2.0**-49


def narrow_model(motion: Motion, forms: tuple[Form, ...] = FORMS) -> str:
    """Each form ends an alternative of its own; everything else is the same."""
    names = "".join(f" Real {name};" for name in f"x c w e t {motion.variables}".split())
    alternatives = " ++\n  ".join(f"{{{motion.equations},t'=1 & t<=e & {form.text}}}" for form in forms)
    return (
        f'Theorem "narrow"\nProgramVariables{names} End.\nProblem\n  w != 0 -> [{{ t := 0;\n  '
        f"{{{alternatives}}}\n}}*] true\nEnd.\nEnd.\n"
    )


def narrow_environment(kernel: str, motion: Motion, forms: tuple[Form, ...] = FORMS) -> Any:
    return dl2c.make(
        narrow_model(motion, forms),
        default_bound="-1e6:1e6",
        integrator=INTEGRATOR[kernel],
        on_blocked="terminate",
        rtol=RTOL,
        atol=ATOL,
    )


@dataclass(frozen=True)
class Case:
    form: int
    start: dict[str, float]


def draw_case(motion: Motion, random: Random, thin: float = -7, forms: int = len(FORMS)) -> Case:
    """Half widths are 1e-2 to 10^thin of the path, by their logarithms."""
    start = motion.draw(random)
    end = start["e"]
    times = [k * end / 16 for k in range(17)] + [t for t in motion.turns(start) if 0 < t < end]
    places = [float(motion.x(start, t)) for t in times]
    low, up = min(places), max(places)
    half = (up - low) * log_uniform(random, thin, -2)
    match random.choices(("within", "turn", "beyond"), (7, 2, 1))[0]:
        case "within":
            centre = float(motion.x(start, end * random.uniform(0.01, 0.99)))
        case "turn":
            centre = random.choice((low, up)) + half * random.uniform(-2, 2)
        case _:
            centre = random.choice((low - (up - low) * random.random(), up + (up - low) * random.random()))
    return Case(random.randrange(forms), start | {"c": centre, "w": half, "t": 0.0})


@dataclass
class Tally:
    """How flows were judged; `wrong` has the first few that were not right, `faulty` how often which are."""

    counts: Counter[str] = field(default_factory=Counter[str])
    faulty: Counter[str] = field(default_factory=Counter[str])
    wrong: list[str] = field(default_factory=list[str])

    def add(self, verdict: str, what: str, told: str) -> None:
        self.counts[verdict] += 1
        if verdict not in FINE:
            self.faulty[f"{verdict}, {what}"] += 1
            if sum(line.startswith(verdict) for line in self.wrong) < 3:
                self.wrong.append(f"{verdict}: {told}")

    def faults(self) -> dict[str, int]:
        return {verdict: n for verdict, n in self.counts.items() if verdict not in FINE}


FINE = ("ended", "passed", "skipped: begins inside", "skipped: grazes", "skipped: below the tolerance")


@dataclass(frozen=True)
class Seen:
    """What a step from a case did."""

    duration: float
    x: float
    reason: str
    blocked: bool


def take(env: Any, case: Case) -> Seen:
    env.reset(options={"state": case.start})
    info = env.step(case.form)[4]
    return Seen(info["duration"], env.state["x"], info["reason"], info["blocked"])


def entry(motion: Motion, case: Case, interval: Interval) -> tuple[mpf, mpf] | None:
    """When x enters the interval and when it is next at an end of it; None where it does not before `e`."""
    end = high.mpf(case.start["e"])
    meetings = motion.meetings(case.start, interval)
    return (meetings[0], meetings[1] if len(meetings) > 1 else end) if meetings else None


def size(motion: Motion, case: Case) -> float:
    """How large the numbers are that x is made of."""
    return max(abs(case.start["x"]), abs(float(motion.x(case.start, case.start["e"]))), abs(case.start["c"]))


def slack_of(kernel: str, motion: Motion, case: Case) -> float:
    """By how much the x that a solver follows may be off; 0 for what is followed exactly."""
    solved = INTEGRATOR[kernel] in ("cvodes", "dopri5")
    return 10 * (RTOL * size(motion, case) + ATOL) if solved else 0.0


def fails(form: Form, case: Case) -> Interval:
    return form.fails(high.mpf(case.start["c"]), high.mpf(case.start["w"]))


def begins_outside(kernel: str, motion: Motion, case: Case, form: Form) -> bool:
    """Whether the condition surely holds at the start."""
    (low, up), slack = fails(form, case), slack_of(kernel, motion, case)
    x, c, w = (case.start[name] for name in "xcw")
    return (low - slack > x or up + slack < x) and form.surely(x, c, w) is True


def judge(kernel: str, motion: Motion, case: Case, seen: Seen, forms: tuple[Form, ...] = FORMS) -> str:
    form, c, w = forms[case.form], case.start["c"], case.start["w"]
    interval, slack = fails(form, case), slack_of(kernel, motion, case)
    if seen.blocked or seen.reason:
        return f"ended as {seen.reason or 'blocked'}"
    far = abs(high.mpf(seen.x) - motion.x(case.start, seen.duration))
    if far > max(slack, 1e3 * ROUNDINGS * size(motion, case)):
        return "elsewhere"
    if form.surely(seen.x, c, w) is False:
        return "outside its domain"
    if slack:
        return judge_followed(motion, case, seen, interval, slack)
    return judge_exactly(motion, case, seen, form, entry(motion, case, interval))


def judge_followed(motion: Motion, case: Case, seen: Seen, interval: Interval, slack: float) -> str:
    """Between the entries into the wider and the narrower interval."""
    low, up = interval
    end = case.start["e"]
    near = end * SHARE
    first = entry(motion, case, (low - slack, up + slack))
    if seen.duration < (first[0] if first else end) - near:
        return "early"
    if up - low < 20 * slack:
        return "skipped: below the tolerance"
    last = entry(motion, case, (low + slack, up - slack))
    if last is None:
        return "passed" if first is None else "skipped: grazes"
    if seen.duration > last[0] + near:
        return "missed" if seen.duration >= last[1] else "late"
    return "ended"


def judge_exactly(motion: Motion, case: Case, seen: Seen, form: Form, found: tuple[mpf, mpf] | None) -> str:
    c, w, end = (case.start[name] for name in ("c", "w", "e"))
    near = end * SHARE

    def surely(time: Any) -> bool | None:
        x = motion.x(case.start, time)
        return form.surely(x, c, w, ROUNDINGS * max(abs(case.start["x"]), abs(float(x))))

    if found:
        inside = min(found[0] + near, (found[0] + found[1]) / 2)
        if surely(inside) is not False:
            return "skipped: grazes"
        if seen.duration > found[0] + near:
            return "missed" if seen.duration >= found[1] else "late"
    if seen.duration < (found[0] if found else end) - near:
        sure = {surely(seen.duration + near * share) for share in (0, 0.5, 1)}
        return "early" if sure == {True} else "skipped: grazes"
    return "ended" if found else "passed"


def told(kernel: str, motion: Motion, case: Case, seen: Seen, forms: tuple[Form, ...] = FORMS) -> str:
    """A line that says all about a case."""
    form = forms[case.form]
    found = entry(motion, case, fails(form, case))
    right = found[0] if found else case.start["e"]
    return f"{kernel}, {motion.name}, {form.text}, {case.start}: {seen}, right is {high.nstr(right, 17)}"


def campaign(kernel: str, motion: Motion, count: int, random: Random, tally: Tally, thin: float = -7) -> None:
    """Runs `count` flows of one motion under one kernel."""
    env = narrow_environment(kernel, motion)
    for _ in range(count):
        case = draw_case(motion, random, thin)
        if not begins_outside(kernel, motion, case, FORMS[case.form]):
            tally.add("skipped: begins inside", "", "")
            continue
        seen = take(env, case)
        verdict = judge(kernel, motion, case, seen)
        line = "" if verdict in FINE else told(kernel, motion, case, seen)
        tally.add(verdict, f"{motion.name}: {FORMS[case.form].text}", line)
    env.close()
