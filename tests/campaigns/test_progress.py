"""No flow is frozen: from a state away from every boundary, time goes on.

`make test-events` runs this. DL2C_FLOWS says how many flows per kernel are followed, ten times as many as in
the other campaign; DL2C_SEED which.
"""

import os
from collections import Counter
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from oracles.motions import INTEGRATOR
from oracles.narrow_forms import FORMS

import dl2c

FLOWS = 10 * int(os.environ.get("DL2C_FLOWS", "10000"))
SEED = int(os.environ.get("DL2C_SEED", "20240"))
BATCH = 500
NAMES = ("x", "v", "a", "e", "f", "u", "q", "c", "w", "t")
WRONG = ("frozen", "blocked within its domain")

EQUATIONS = {
    "exact": ("x'=v,v'=a", "x+f*(v*e+a*e^2/2)"),
    "linear": ("x'=v,v'=a,q'=-q", "x+f*(v*e+a*e^2/2)"),
    "cvodes": ("x'=v,v'=a,q'=q*(1-q)", "x+f*(v*e+a*e^2/2)"),
    "dopri5": ("x'=v,v'=a,q'=q*(1-q)", "x+f*(v*e+a*e^2/2)"),
}
"""Motion, and where in it (for f in [0, 1]) the narrow event is."""
BOUNDS = (
    "0<=x&x<=1 & -2<=v&v<=2 & v!=0 & -2<=a&a<=2 & 1/4<=e&e<=4 & 0<=f&f<=1 & 1/10<=u&u<=1"
    " & q=1/2 & c=0 & w=0 & t=0"
)


def progress_model(kernel: str) -> str:
    """Half widths are from 1e-7 to 1e-1 of the time; every episode is one flow."""
    motion, centre = EQUATIONS[kernel]
    names = "".join(f" Real {name};" for name in NAMES)
    flows = " ++\n  ".join(f"{{{motion},t'=1 & t<=e & {form.text}}}" for form in FORMS)
    return (
        f'Theorem "progress"\nProgramVariables{names} End.\nProblem\n  {BOUNDS}\n  -> [{{ c := {centre}; '
        f"w := u^6/10*e; t := 0;\n  {{{flows}}}\n}}*] true\nEnd.\nEnd.\n"
    )


def judge_progress(start: dict[str, float], form: int, duration: float, reason: str, blocked: bool) -> str:
    """Where the condition surely holds at the start, time goes on."""
    if duration > 0 and not blocked:
        return "went on"
    if reason not in ("", "time_limit", "blocked"):
        return f"ended, reason {reason}"
    x, v, a, e, f, u = (start[name] for name in "xvaefu")
    c, w = x + f * (v * e + a * e * e / 2), u**6 / 10 * e
    if FORMS[form].surely(x, c, w, 1e-13) is not True:
        return "began on a boundary or outside"
    return "blocked within its domain" if blocked else "frozen"


@pytest.mark.slow
@pytest.mark.parametrize("kernel", EQUATIONS)
def test_no_flow_is_frozen(kernel: str) -> None:
    envs: Any = dl2c.make_vec(
        progress_model(kernel),
        BATCH,
        autoreset_mode=AutoresetMode.SAME_STEP,
        integrator=INTEGRATOR[kernel],
        on_blocked="terminate",
        obs_dtype="float64",
        max_episode_steps=1,
    )
    random = np.random.default_rng(SEED)
    counts, wrong = Counter[str](), list[str]()
    starts, _ = envs.reset(seed=SEED)
    for _ in range(-(-FLOWS // BATCH)):
        actions = random.integers(len(FORMS), size=BATCH)
        following, _, terminated, truncated, infos = envs.step(actions)
        assert (terminated | truncated).all()
        final = infos["final_info"]
        for i in range(BATCH):
            start = dict(zip(NAMES, map(float, starts[i]), strict=True))
            reason = envs.reason_names[final["reason"][i]]
            duration, blocked = final["duration"][i], bool(final["blocked"][i])
            verdict = judge_progress(start, actions[i], duration, reason, blocked)
            counts[verdict] += 1
            if verdict in WRONG and len(wrong) < 5:
                wrong.append(f"{verdict}: {FORMS[actions[i]].text} from {start}")
        starts = following
    print(f"\nseed {SEED}, {kernel}, {FLOWS} flows: {dict(counts)}")
    assert not wrong, "\n".join([str(dict(counts)), *wrong])
