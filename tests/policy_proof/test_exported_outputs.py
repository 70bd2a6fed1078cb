"""Exact evaluation in doubles is what the exported C computes, bit for bit."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from dl2c.commands.monitor import unit_of
from dl2c.commands.policy import policy_for
from dl2c.emit.monitor.files import monitor_files
from dl2c.env.opening import compilation_of
from dl2c.ir.model import TRUE
from dl2c.lower.invariant import invariant
from dl2c.native.program import answers, compile_program
from dl2c.policy.files import write_policy
from dl2c.policy.network import Activation, Interface, Layer, Network, NetworkPolicy, Scaling
from dl2c.policy_proof.acting import acting
from dl2c.policy_proof.build import Claim, questions
from dl2c.policy_proof.exact import outputs_at

MODEL = "example:watertank"

NAMES = ("l", "goal", "u", "U", "q")
LOW, HIGH = (0.0, 0.5, 0.0, 0.3, 0.05), (5.0, 4.5, 0.6, 0.6, 0.25)

MAIN = """#include "Water_tank_policy.h"
#include <stdio.h>

int main(void)
{
  Water_tank_state s = {0};
  Water_tank_parameters p = {0};
  Water_tank_input input = {0};
  while (scanf("%la %la %la %la %la", &s.l, &s.goal, &s.u, &p.U, &p.q) == 5) {
    double observation[WATER_TANK_OBSERVATIONS], output[WATER_TANK_OUTPUTS];
    Water_tank_policy_observe(s, &p, &input, observation);
    Water_tank_policy_outputs(observation, output);
    printf("%a\\n", output[0]);
  }
  return 0;
}
"""


@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_outputs_are_those_of_the_exported_c(tmp_path: Path, activation: Activation) -> None:
    rng = np.random.default_rng(1)
    inner = Layer(rng.normal(size=(16, 5)), rng.normal(size=16), activation)
    layers = (inner, Layer(rng.normal(size=(1, 16)), rng.normal(size=1), "identity"))
    scaling = Scaling(rng.normal(size=5), rng.uniform(0.5, 2, 5), 3.0)
    low, high = (np.float32(v).tolist() for v in (LOW, HIGH))
    limits = tuple(
        (
            n,
            float(np.nextafter(np.float32(a), np.float32(0)) if float(np.float32(a)) > a else np.float32(a)),
            b,
        )
        for n, a, b in zip(NAMES, LOW, high, strict=True)
    )
    interface = Interface(limits, "float32", "box", inputs=("assign_u",), low=(low[2],), high=(high[2],))
    policy = NetworkPolicy("Water tank", interface, Network((scaling,), layers), False, {})
    path = write_policy(policy, tmp_path)
    trained, options = policy_for(MODEL, path, {})
    files = monitor_files(unit_of(MODEL, options), trained)
    (tmp_path / "c").mkdir()
    program = compile_program({**files, "main.c": MAIN}, tmp_path / "c")
    found = compilation_of(MODEL, options)
    proved = invariant(found.resolved.problem) or TRUE
    (asked,) = questions(
        Claim(found.unbounded, proved, TRUE, {}, "double"), acting(trained.interface, trained.network)
    )
    points = rng.uniform(LOW, HIGH, (300, 5))
    printed = answers(program, [" ".join(v.hex() for v in p.tolist()) for p in points])
    for point, text in zip(points.tolist(), printed, strict=True):
        values = dict(zip(NAMES, map(Fraction, point), strict=True))
        outputs = outputs_at(asked, {s: values[s.name] for s in asked.dimensions})
        assert outputs == [Fraction(float.fromhex(text))]
