"""States inside a step: they are those of its motion, and looking at them changes nothing."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dl2c.env.opening import batch_options, compilation_of, open_library, source_of
from dl2c.interp.follow import follow
from dl2c.interp.step import Interpreter
from dl2c.interp.transition import Request, Settings, Start
from dl2c.native.binding import Batch
from dl2c.native.inspect import motion, scene_values, violations

PARTS = (0.125, 0.5, 0.875)

SEVERAL_FLOWS = """
Theorem "Two flows and a jump"
ProgramVariables
  /* @var: bound=[0:1] */
  Real x;
  Real t;
End.
Problem
  x >= 0 -> [{
    t := 0; {x' = 2, t' = 1 & t <= 1};
    x := x + 10;
    t := 0; {x' = -1, t' = 1 & t <= 3};
    x := x - 100; x := x + 100;
  }*] x >= 0
End.
End.
"""


@pytest.fixture(autouse=True)
def compiled_quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bits do not depend on it."""
    monkeypatch.setenv("CFLAGS", "-O0 -DDL2C_NO_TARGET_CLONES")


def begun(model: Any, inspect: bool = True, seed: int = 0, n: int = 1, **options: Any) -> Batch:
    library = open_library(source_of(model), options, inspect=inspect)
    batch = library.batch(n, **batch_options(library.manifest) | {"autoreset": "next_step"})
    batch.reset(seeds=np.arange(seed, seed + n, dtype=np.uint64))
    return batch


def act(rng: np.random.Generator, *batches: Batch) -> None:
    choices, inputs = (
        rng.integers(0, 3, batches[0].choices.shape),
        rng.uniform(-2, 2, batches[0].inputs.shape),
    )
    for batch in batches:
        batch.choices[:], batch.inputs[:] = choices, inputs
        batch.step()


@pytest.mark.parametrize("name", ["static_safety_line", "bouncing_ball", "watertank"])
def test_states_inside_a_step_are_those_of_the_interpreter(name: str) -> None:
    """To the last bit where motion has a closed form: the interpreter follows a part of each flow."""
    compilation = compilation_of(f"example:{name}", {})
    model, flows, inputs = compilation.lowered.model, compilation.flows, compilation.paths.inputs
    batch, rng, moved = begun(f"example:{name}"), np.random.default_rng(0), 0
    settings = Settings(limits={i.key: (i.low, i.high) for i in inputs})
    for _ in range(60):
        x, p = (dict(zip(names, row, strict=True)) for names, row in named(batch))
        act(rng, batch)
        if batch.began[0] or batch.duration[0] == 0.0:
            continue
        moved += 1
        found = motion(batch, 0, (0.0, *PARTS, 1.0))
        assert np.array_equal(found[-1], batch.get_state(0)[0])
        choices = {
            c.key: int(k) for c, k in zip(batch.library.manifest.choices, batch.choices[0], strict=True)
        }
        request = Request(choices, {i.key: float(v) for i, v in zip(inputs, batch.inputs[0], strict=True)})
        for part, row in zip(PARTS, found[1:-1], strict=True):
            interpreter = Interpreter(
                model,
                p,
                lambda k, env, exact, _, waiting, part=part: follow(flows[k], env, exact, part, waiting),
                settings=settings,
            )
            judged = interpreter.step(Start(x), request).judged
            assert row.tolist() == [judged[v.name] for v in model.variables]
    assert moved >= 30


def named(batch: Batch) -> list[tuple[list[str], list[float]]]:
    manifest = batch.library.manifest
    kept = zip((manifest.variables, manifest.constants), batch.get_state(0), strict=True)
    return [([q.name for q in items], row.tolist()) for items, row in kept]


def test_motion_of_power_series_is_on_its_circle() -> None:
    """A car that turns drives on an arc, far from its chord."""
    batch, rng, bends = begun("example:dubins"), np.random.default_rng(1), []
    for _ in range(40):
        act(rng, batch)
        found = motion(batch, 0, np.linspace(0.0, 1.0, 9))
        x, y, dx, dy, v = found[:, :5].T
        rate = found[0, 7]
        turned = np.arctan2(dy[0], dx[0]) + rate * np.linspace(0.0, 0.2, 9)
        assert np.allclose(np.stack([dx, dy]), np.stack([np.cos(turned), np.sin(turned)]), atol=1e-12)
        centre = np.stack([x * rate - v * dy, y * rate + v * dx])
        assert np.allclose(centre, centre[:, :1], atol=1e-11)
        middle = found[4, :2] - found[[0, 8], :2].mean(axis=0)
        bends.append(float(np.hypot(*middle)))
    assert max(bends) > 0.01


@pytest.mark.parametrize("integrator", ["cvodes", "dopri5"])
def test_followed_motion_is_where_a_shorter_step_ends(integrator: str) -> None:
    """Within the tolerances: steps of the method differ."""
    batch, rng = begun("example:pendulum", integrator=integrator), np.random.default_rng(2)
    shorter = begun("example:pendulum", inspect=False, duration="agent", integrator=integrator)
    assert [f.kernel for f in batch.library.manifest.flows] == [integrator]
    for _ in range(15):
        before = batch.get_state(0)
        act(rng, batch)
        if batch.began[0]:
            continue
        for part, row in zip(PARTS, motion(batch, 0, PARTS), strict=True):
            shorter.reset()
            shorter.set_state(0, *before)
            shorter.choices[:] = batch.executed_choices
            shorter.inputs[0] = [*batch.executed_inputs[0], part]
            shorter.step()
            assert np.allclose(row, shorter.get_state(0)[0], rtol=0, atol=2e-6)


def test_fractions_may_come_in_any_order() -> None:
    """Also where tracks are followed anew."""
    for name in ("dubins", "pendulum"):
        batch = begun(f"example:{name}")
        act(np.random.default_rng(3), batch)
        fractions = np.array([0.9, 0.1, 0.0, 0.5, 1.0, 0.3])
        alone = [motion(batch, 0, [f])[0] for f in fractions]
        assert np.array_equal(motion(batch, 0, fractions), alone)


def test_flows_are_passed_one_after_the_other() -> None:
    batch = begun(SEVERAL_FLOWS)
    first = batch.get_state(0)[0][0]
    batch.step()
    found = motion(batch, 0, [0.0, 0.125, 0.25, 0.5, 1.0])[:, 0] - first
    assert found == pytest.approx([0.0, 1.0, 2.0, 11.0, 9.0])


@pytest.mark.parametrize("name", ["dubins", "etcs"])
def test_a_library_to_inspect_steps_to_the_same_bits(name: str) -> None:
    """A batch of many moves in lanes without it; either goes on from snapshots of the other."""
    one, other = (begun(f"example:{name}", inspect=inspect, n=70) for inspect in (True, False))
    rng = np.random.default_rng(4)
    for k in range(40):
        act(rng, one, other)
        motion(one, 3, PARTS)
        for a, b in zip(one.arrays(), other.arrays(), strict=True):
            assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        if k == 20:
            kept = [(one.save(i), other.save(i)) for i in range(70)]
            for i, (first, second) in enumerate(kept):
                one.restore(i, second)
                other.restore(i, first)
    assert one.library.manifest == other.library.manifest
    with pytest.raises(other.library.ffi.error, match="dl2c_inspect_motion"):
        motion(other, 3, PARTS)


def test_nothing_is_remembered_beyond_a_reset() -> None:
    batch = begun("example:dubins")
    act(np.random.default_rng(5), batch)
    moved = motion(batch, 0, [0.5])
    kept = batch.save(0)
    for change in (
        batch.reset,
        lambda: batch.set_state(0, *batch.get_state(0)),
        lambda: batch.restore(0, kept),
    ):
        change()
        found = motion(batch, 0, [0.0, 0.5, 1.0])
        assert np.array_equal(found, [batch.get_state(0)[0]] * 3) and not np.array_equal(found[1], moved[0])
        act(np.random.default_rng(5), batch)


def test_wrong_questions_are_refused() -> None:
    batch = begun("example:dubins")
    with pytest.raises(ValueError, match="from 0 to 1"):
        motion(batch, 0, [1.5])
    with pytest.raises(ValueError, match="from 0 to 1"):
        motion(batch, 0, [float("nan")])
    with pytest.raises(IndexError):
        motion(batch, 1, [0.5])
    with pytest.raises(ValueError, match="states of 9 values"):
        violations(batch.library, np.zeros((2, 3)), np.zeros(0))


def test_violations_are_counted_in_any_state() -> None:
    batch = begun("example:dubins")
    x, p = batch.get_state(0)
    states: NDArray[np.float64] = np.tile(x, (3, 1))
    states[1, 0], states[2, 1] = 11.0, -10.5
    assert violations(batch.library, states, p).tolist() == [0, 1, 1]


def test_scene_values_are_the_terms_of_the_scene(tmp_path: Path) -> None:
    text = SEVERAL_FLOWS.replace(
        "Problem",
        '/* @scene: disk(2 * x, x^2 + 1, radius=1/3, heading=(x, -t)), text(x / t, name="q") */\nProblem',
    )
    library = open_library(source_of(text), {})
    out = np.empty(library.sizes.nscene)
    scene_values(library, np.array([3.0, 0.0]), np.zeros(0), out)
    disk, ratio = library.manifest.scene.shapes
    read = {name: [out[k] for k in places] for name, places in disk.arguments.items()}
    assert read == {"x": [6.0], "y": [10.0], "radius": [float(Fraction(1, 3))], "heading": [3.0, 0.0]}
    assert not np.isfinite(out[ratio.arguments["value"][0]])
