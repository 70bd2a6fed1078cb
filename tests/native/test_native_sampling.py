"""Initial states of compiled models: valid by an audit with fractions, uniform, the same in any batch."""

import time
from fractions import Fraction
from pathlib import Path
from shutil import which

import numpy as np
import pytest
from oracles.initial_states import audited, audited_witness, definitions_of
from sampling.test_uniform import CELLS, circle_and_products, counts, cuts_of, p_value
from selection import few_and_many

from dl2c import make
from dl2c.ir.model import Symbol
from dl2c.lower.problem import lower
from dl2c.options import Options
from dl2c.parse.parser import parse_archive
from dl2c.pipeline import compile_model
from dl2c.resolve.problem import resolve
from dl2c.sampling.plan import plan_sampling
from dl2c.source import Source

WAYPOINT = Source.read(Path(__file__).resolve().parents[2] / "examples" / "waypoint.kyx")

ROBOT = Source(
    "robot.kyx",
    """ArchiveEntry "robot"
ProgramVariables
  // @var: bound=[-1:1]
  Real dx;
  // @var: bound=[-1:1]
  Real dy;
  // @var: bound=[-3:3]
  Real r;
  // @var: bound=[-2:2]
  Real w;
  // @var: bound=[-5:5]
  Real v;
End.
Problem
  dx^2 + dy^2 = 1 & r*w = v & v >= 0 & v <= 2 & abs(r) >= 0.25 ->
  [{ {dx' = -w*dy, dy' = w*dx & true} }*] v >= 0
End.
End.
""",
)


def states(source, count, seed=0, **options):
    """Initial states by name, and the model."""
    library = compile_model(source, Options(**options)).library
    batch = library.batch(min(count, 100_000))
    found = []
    for k in range(-(-count // batch.n)):
        seeds = np.arange(batch.n, dtype=np.uint64) + np.uint64(seed * 10**9 + k * batch.n)
        batch.reset(seeds=seeds)
        found.append([np.concatenate(batch.get_state(i)) for i in range(batch.n)])
    names = [q.name for q in (*library.manifest.variables, *library.manifest.constants)]
    return names, np.concatenate(found)[:count], library.manifest


def audit_all(source, names, rows, manifest):
    model = lower(resolve(parse_archive(source)[0].entries[0]), Options())
    plan = plan_sampling(model)
    symbols = {v.name: Symbol(v.name, "variable") for v in model.variables}
    symbols |= {c.name: Symbol(c.name, "constant") for c in model.constants}
    bounds = {symbols[v.name]: (v.bound.low, v.bound.high) for v in model.variables if v.initial == "sampled"}
    bounds |= {symbols[c.name]: (c.bound.low, c.bound.high) for c in model.constants if c.value is None}
    charts = [[(symbols[n], t) for n, t in d] for d in definitions_of(plan)]
    for row in rows.tolist():
        state = {symbols[n]: Fraction(v) for n, v in zip(names, row, strict=True)}
        if manifest.certificate == "exact":
            assert audited(model.precondition, bounds, state) == "yes"
        else:
            error = manifest.sampler["error_bound"]
            verdicts = [audited_witness(model.precondition, bounds, state, c, error) for c in charts]
            assert "yes" in verdicts


@pytest.mark.parametrize("count", few_and_many(300, 2000))
@pytest.mark.parametrize(("source", "certificate"), [(WAYPOINT, "exact"), (ROBOT, "witness")])
def test_compiled_samples_pass_the_audit(count, source, certificate):
    names, rows, manifest = states(source, count)
    assert manifest.certificate == certificate
    assert manifest.sampler["error_bound"] <= 1e-14
    audit_all(source, names, rows, manifest)


@pytest.mark.slow
def test_a_million_resets_of_the_paper_are_exact():
    names, rows, manifest = states(WAYPOINT, 10**6)
    audit_all(WAYPOINT, names, rows, manifest)


def test_compiled_states_are_uniform_on_a_surface():
    names, rows, _ = states(ROBOT, 20_000, seed=3)
    assert names == ["dx", "dy", "r", "w", "v"]
    expected = circle_and_products(np.random.default_rng(1), 20_000)
    cuts = cuts_of(expected, 5, CELLS // 4)
    assert p_value(counts(expected, cuts), counts(rows, cuts)) > 0.001


def test_a_witness_can_be_set_again():
    env = make(ROBOT.text)
    for seed in range(20):
        env.reset(seed=seed)
        state = env.state
        env.reset(options={"state": state})
        assert env.state == state


def test_a_reset_costs_little_more_than_random_numbers():
    """Filling the same doubles is numpy's; the least of several times each, in one run."""
    library = compile_model(WAYPOINT, Options()).library
    count, width = 20_000, len(library.manifest.variables) + len(library.manifest.constants)
    batch, rng = library.batch(count), np.random.default_rng(0)
    numbers = np.empty((count, width))
    seeds = np.arange(count, dtype=np.uint64)
    resets = min(elapsed(lambda: batch.reset(seeds=seeds)) for _ in range(7))
    fills = min(elapsed(lambda: rng.random(out=numbers)) for _ in range(7))
    print(f"{count / resets:,.0f} resets/s, {resets / fills:.1f} times filling")
    assert resets <= 40 * fills


def elapsed(work):
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


GRID = Source(
    "grid.kyx",
    """ArchiveEntry "grid"
ProgramVariables
  // @var: bound=[0.1:5]
  Real x;
  // @var: bound=[-4:4]
  Real y;
  // @var: bound=[-4:0.3]
  Real z;
End.
Problem
  x = y + 3 & z = 0.5*y - x/4 & y*y + z > 0.2 -> [{ {x' = 1 & true} }*] x >= 0
End.
End.
""",
)


def test_linear_equalities_hold_in_doubles():
    """And as they are written: a state can be set again."""
    names, rows, manifest = states(GRID, 2000)
    assert manifest.certificate == "exact"
    audit_all(GRID, names, rows, manifest)
    env = make(GRID.text)
    for seed in range(20):
        env.reset(seed=seed)
        x, y, z = env.state.values()
        assert (x, z) == (y + 3, 0.5 * y - x / 4)
        env.reset(options={"state": env.state})


@pytest.mark.slow
@pytest.mark.parametrize("distribution", ["uniform", "target"])
@pytest.mark.parametrize("source", [WAYPOINT, ROBOT, GRID], ids=lambda s: s.name)
def test_streams_are_the_same_bits_however_they_are_compiled(source, distribution, monkeypatch):
    found = set()
    for compiler in ("gcc", "clang"):
        if which(compiler) is None:
            continue
        for flags in ("-O0", "-O3", "-O3 -march=native"):
            monkeypatch.setenv("CC", compiler)
            monkeypatch.setenv("CFLAGS", f"{flags} -DDL2C_NO_TARGET_CLONES")
            _, rows, _ = states(source, 3000, initial_distribution=distribution)
            found.add(rows.tobytes())
    assert len(found) == 1


BAND = Source(
    "band.kyx",
    """ArchiveEntry "band"
ProgramVariables
  // @var: bound=[0:1]
  Real x;
  // @var: bound=[0:1]
  Real y;
  // @var: bound=[0:3]
  Real z;
End.
Problem
  x <= y + 0.00001 & x >= y - 0.00001 & x <= z & z <= 3*y & y >= 0.1 -> [{ {x' = 1 & true} }*] x >= 0
End.
End.
""",
)


def test_compiled_names_between_limits_pass_the_audit():
    names, rows, manifest = states(BAND, 2000)
    assert manifest.sampler["acceptance"] > 0.1
    audit_all(BAND, names, rows, manifest)
