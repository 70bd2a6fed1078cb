"""`initial_distribution`: "target", states near random targets, and "z3", the nearest that Z3 finds."""

from pathlib import Path

import numpy as np
import pytest
from generators.ir_builder import model
from native.test_native_sampling import ROBOT, audit_all
from oracles.streams import Stream
from sampling.test_sampling import planned
from selection import few_and_many

from dl2c import make, make_vec
from dl2c.emit.simulator.sampler_c import alias_table
from dl2c.options import Options, UnknownOption
from dl2c.pipeline import Compilation, compile_model
from dl2c.sampling.arrays import holds
from dl2c.smt.target import nearest
from dl2c.source import Source

SQUARE = """ArchiveEntry "square"
ProgramVariables
  // @var: bound=[0:4]
  Real x;
  // @var: bound=[0:4]
  Real y;
End.
Problem
  x + y >= 6 -> [{x' = 1 & true}] x >= 0
End.
End.
"""


def test_the_nearest_state_is_on_the_boundary():
    m = model("x + y >= 6", {"x": "0:4", "y": "0:4"})
    found = nearest(m, {"x": 2.0, "y": 2.0}, {"x": 4.0, "y": 4.0}, 20.0)
    assert found.status == "sat"
    assert found.state == {"x": 3.0, "y": 3.0}


def test_what_is_impossible_is_said():
    assert nearest(model("x > 5", {"x": "0:4"}), {"x": 1.0}, {"x": 4.0}, 20.0).status == "unsat"


def test_resets_say_how_they_went():
    env = make(SQUARE, initial_distribution="z3")
    for seed in range(3):
        _, info = env.reset(seed=seed)
        assert info["initial_state_target"] in ("nearest", "invalid", "unknown")
        assert env.state["x"] + env.state["y"] >= 6
        state = env.state
        assert env.reset(seed=seed)[1] == info
        assert env.state == state


def test_vectors_refuse_it():
    with pytest.raises(UnknownOption, match="single"):
        make_vec(SQUARE, 2, initial_distribution="z3")


# Targets in C -----------------------------------------------------------------

WAYPOINT = Source.read(Path(__file__).resolve().parents[2] / "examples" / "waypoint.kyx")

LIMITS = {
    SQUARE: [lambda s: s["x"] + s["y"] - 6],
    WAYPOINT.text: [
        lambda s: s["Vmax"] - 2 * s["A"] * s["ep"],
        lambda s: s["GDelta"] - s["Vmax"] * s["ep"] - s["Vmax"] ** 2 / (2 * s["b"]),
        lambda s: s["xg"] - s["GDelta"] - s["xr"],
        lambda s: (
            s["T"]
            - (2 * s["ep"] + (s["xg"] - s["xr"] - s["GDelta"]) / (s["A"] * s["ep"]) + s["Vmax"] / s["b"])
        ),
    ],
}
"""What is not negative in initial states."""


def targeted(text, count):
    """States of so many seeds, and their names."""
    library = compile_model(Source("m.kyx", text), Options(initial_distribution="target")).library
    batch = library.batch(count)
    batch.reset(seeds=np.arange(count, dtype=np.uint64))
    names = [q.name for q in (*library.manifest.variables, *library.manifest.constants)]
    return names, np.array([np.concatenate(batch.get_state(i)) for i in range(count)]), library.manifest


def drawn(stream, block):
    """A state of a block without density, as sampler.h draws it."""
    share, alias = alias_table([b.weight for b in block.boxes])
    names = block.charts[0].free
    while True:
        k = 0
        if len(block.boxes) > 1:
            place = stream.unit() * len(block.boxes)
            k = int(place) if place - int(place) < share[int(place)] else alias[int(place)]
        box = block.boxes[k]
        state = [min(a + (b - a) * stream.unit(), b) for a, b in zip(box.low, box.high, strict=True)]
        columns = {n: np.array([v]) for n, v in zip(names, state, strict=True)}
        if holds(block.charts[0].acceptance, columns, 1)[0]:
            return np.array(state)


def nearest_distance(target, width, names, limits, starts):
    """By sequential quadratic programming from several states."""
    minimize = pytest.importorskip("scipy.optimize").minimize

    def squared(z):
        return float(np.sum(((z - target) / width) ** 2))

    def feasible(z):
        return all(limit(dict(zip(names, z, strict=True))) >= -1e-9 for limit in limits)

    rules = [{"type": "ineq", "fun": lambda z, f=f: f(dict(zip(names, z, strict=True)))} for f in limits]
    found = [minimize(squared, s, method="SLSQP", constraints=rules).x for s in starts]
    return min((squared(z) ** 0.5 for z in found if feasible(z)), default=np.inf)


@pytest.mark.parametrize("count", few_and_many(20, 60))
@pytest.mark.parametrize("text", LIMITS, ids=["square", "waypoint"])
def test_states_are_almost_as_near_as_can_be(count, text):
    """To the targets of the stream, within a tenth on average; admissible targets are met."""
    names, rows, _ = targeted(text, count)
    blocks = planned(Compilation(Source("m.kyx", text), Options()).lowered.drawn).blocks
    ratios = []
    for seed in range(count):
        stream = Stream.of(seed, 0)
        for block in blocks:
            low = np.min([b.low for b in block.boxes], axis=0)
            high = np.max([b.high for b in block.boxes], axis=0)
            start, free = drawn(stream, block), block.charts[0].free
            target = low + (high - low) * [stream.unit() for _ in free]
        state = rows[seed][[names.index(n) for n in free]]
        distance = np.sum(((state - target) / (high - low)) ** 2) ** 0.5
        least = nearest_distance(target, high - low, free, LIMITS[text], (state, start))
        if distance > 1e-12 and np.isfinite(least):
            ratios.append(distance / least)
    assert len(ratios) > count / 4
    assert np.mean(ratios) < 1.1


def test_states_near_targets_pass_the_audit():
    for source in (WAYPOINT, ROBOT):
        audit_all(source, *targeted(source.text, 500))


def test_a_target_is_a_function_of_seed_and_episode():
    env = make(SQUARE, initial_distribution="target")
    several = make_vec(SQUARE, 3, initial_distribution="target")
    several.reset(seed=5)
    for k in range(3):
        env.reset(seed=5 + k)
        assert env.state == several.state(k)
    states = []
    for seed in (5, None, 5, None):
        env.reset(seed=seed)
        states.append(env.state)
    assert states[:2] == states[2:]
    assert states[0] != states[1]


def test_info_says_that_states_lie_near_targets():
    assert any("near random targets" in n for n in make(SQUARE, initial_distribution="target").manifest.notes)
