"""How many public models get a sampler, and an audit of what it draws: `make sampling-report`.

Reads every model of `../shared/corpus` that can be lowered, with the default bound [-10:10], each
precondition once. Prints a line for each that is satisfiable and gets no sampler, with the reason, and
totals. Fails if less than 97 % of the satisfiable ones are sampled, if fewer than 100000 states are
audited, or if one fails.
"""

import sys
import time
from collections import Counter
from dataclasses import replace
from fractions import Fraction

import numpy as np
from corpus_table import CORPUS, OPTIONS, files
from oracles.initial_states import audited, audited_witness, definitions_of

from dl2c.diagnostics import CompileError
from dl2c.ir.model import Model, Symbol
from dl2c.ir.printer import print_formula
from dl2c.parse.parser import parse_archive
from dl2c.pipeline import Compilation
from dl2c.sampling.draw import draw_many
from dl2c.sampling.plan import plan_sampling
from dl2c.sampling.tables import SamplingPlan
from dl2c.smt.precondition import Satisfiable, decide
from dl2c.source import Source

REQUIRED = 0.97
REQUIRED_STATES = 100_000
STATES = 300
RAREST = 1e-4
"""Of models with less acceptance fewer states are drawn."""


def models():
    """Name and model of each precondition."""
    seen = set()
    for path in files():
        try:
            archive, _ = parse_archive(Source.read(path))
        except CompileError:
            continue
        for number, entry in enumerate(archive.entries, 1):
            found = lowered(entry)
            if found is None:
                continue
            key = print_formula(found.precondition), repr((found.variables, found.constants))
            if key not in seen:
                seen.add(key)
                yield f"{path.relative_to(CORPUS)}:{number}", found


def lowered(entry) -> Model | None:
    for options in (OPTIONS, replace(OPTIONS, loop=1)):
        try:
            return Compilation(entry, options).lowered.drawn
        except CompileError:
            continue
    return None


def failures(model: Model, plan: SamplingPlan, count: int) -> int:
    """How many of `count` states do not pass the audit."""
    items = {Symbol(v.name, "variable"): v.bound for v in model.variables if v.initial == "sampled"}
    items |= {Symbol(c.name, "constant"): c.bound for c in model.constants if c.value is None}
    fixed = {Symbol(c.name, "constant"): c.value for c in model.constants if c.value is not None}
    bounds = {s: (b.low, b.high) for s, b in items.items()}
    by_name = {s.name: s for s in items}
    definitions = [[(by_name[n], t) for n, t in d] for d in definitions_of(plan)]
    columns = draw_many(plan, np.random.default_rng(1), count)
    failed = 0
    for row in zip(*(columns[n].tolist() for n in plan.names), strict=True):
        state = fixed | {by_name[n]: Fraction(v) for n, v in zip(plan.names, row, strict=True)}
        if plan.certificate == "exact":
            failed += audited(model.precondition, bounds, state) != "yes"
        else:
            verdicts = (
                audited_witness(model.precondition, bounds, state, d, plan.error_bound) for d in definitions
            )
            failed += "yes" not in verdicts
    return failed


def main() -> int:
    totals: Counter[str] = Counter()
    certificates: Counter[str] = Counter()
    slowest = planning = 0.0
    for name, model in models():
        totals["models"] += 1
        decision = decide(model)
        if not isinstance(decision, Satisfiable):
            continue
        totals["satisfiable"] += 1
        begun = time.process_time()
        plan = plan_sampling(model, decision=decision)
        planning += time.process_time() - begun
        slowest = max(slowest, time.process_time() - begun)
        if not isinstance(plan, SamplingPlan):
            print(f"{name}: {plan.diagnostic.label}", flush=True)
            continue
        totals["sampled"] += 1
        certificates[plan.certificate] += 1
        count = STATES if plan.estimated_acceptance >= RAREST else 3
        totals["states"] += count
        if failed := failures(model, plan, count):
            print(f"{name}: {failed} of {count} states fail the audit", flush=True)
        totals["failed"] += failed
    share = totals["sampled"] / max(1, totals["satisfiable"])
    print(dict(totals), dict(certificates), f"sampled {share:.1%}")
    print(f"planned in {planning:.0f} s of CPU, the longest in {slowest:.1f} s")
    enough = share >= REQUIRED and totals["states"] >= REQUIRED_STATES
    return 0 if enough and not totals["failed"] else 1


if __name__ == "__main__":
    sys.exit(main())
