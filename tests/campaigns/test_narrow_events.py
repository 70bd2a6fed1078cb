"""Narrow events are met where they are, by every kernel: random flows against closed forms.

`make test-events` runs these. DL2C_FLOWS says how many flows per kernel, DL2C_SEED which.
"""

import os
from itertools import pairwise
from random import Random

import pytest
from both_forms import Both
from oracles.motions import CURVE, LINE, MOTIONS, Motion
from oracles.narrow_events import Tally, begins_outside, campaign, draw_case, narrow_model
from oracles.narrow_forms import FORMS, Form, high
from selection import few_and_many

FLOWS = int(os.environ.get("DL2C_FLOWS", "10000"))
SEED = int(os.environ.get("DL2C_SEED", "20240"))


@pytest.mark.slow
@pytest.mark.parametrize("kernel", MOTIONS)
def test_narrow_events(kernel: str) -> None:
    """The thinnest of a solver's events are ten times its tolerance and wider; the others are skipped."""
    tally = Tally()
    random = Random(f"{SEED} {kernel}")
    for motion in MOTIONS[kernel]:
        campaign(kernel, motion, -(-FLOWS // len(MOTIONS[kernel])), random, tally)
    print(f"\nseed {SEED}, {kernel}, {FLOWS} flows: {dict(tally.counts)}")
    assert not tally.faults(), "\n".join(
        [str(tally.faults()), *tally.wrong, *map(str, tally.faulty.most_common(12))]
    )
    assert tally.counts["ended"] > FLOWS // 4


@pytest.mark.parametrize("count", few_and_many(50, 200))
@pytest.mark.parametrize("motion", (LINE, pytest.param(CURVE, marks=pytest.mark.slow)), ids=lambda m: m.name)
def test_both_forms_meet_them_alike(count: int, motion: Motion) -> None:
    """To the last bit; with widths that rounding hides."""
    random = Random(f"{SEED} both {motion.name}")
    both = Both(narrow_model(motion), default_bound="-1e6:1e6", on_blocked="terminate")
    for _ in range(count):
        case = draw_case(motion, random, thin=-11)
        if not begins_outside("exact", motion, case, FORMS[case.form]):
            continue
        both.begin(**case.start)
        both.step(case.form)


@pytest.mark.parametrize("form", FORMS, ids=[form.name for form in FORMS])
def test_forms_fail_where_they_are_said_to(form: Form) -> None:
    """The oracle itself: closed forms against the conditions as written, at forty digits and in doubles."""
    random = Random(1)
    for _ in range(50):
        c, w = random.uniform(-3, 3), 10 ** random.uniform(-4, -1)
        low, up = form.fails(high.mpf(c), high.mpf(w))
        for share, inside in ((-1e-3, False), (1e-3, True), (0.5, True), (0.999, True), (1.001, False)):
            x = low + (up - low) * share
            assert (form.margin(x, high.mpf(c), high.mpf(w)) < 0) == inside
            assert form.surely(x, c, w, 1e-12) in (None, not inside)
            assert form.surely(x, c, w, 1e-15) is (not inside)


@pytest.mark.parametrize(
    "motion", dict.fromkeys(m for group in MOTIONS.values() for m in group), ids=lambda m: m.name
)
def test_motions_meet_what_they_are_said_to(motion: Motion) -> None:
    """The oracle itself: a motion is at its meetings, and in between on one side."""
    random = Random(2)
    for _ in range(50):
        start = motion.draw(random)
        e = start["e"]
        value = motion.x(start, e * random.random())
        meetings = motion.meetings(start, (value, value))[::2]
        assert meetings
        for time in meetings:
            assert abs(motion.x(start, time) - value) < 1e-20
        times = [high.mpf(0), *meetings, high.mpf(e)]
        for before, after in pairwise(times):
            signs = {motion.x(start, before + (after - before) * k / 9) > value for k in range(1, 9)}
            assert len(signs) == 1
