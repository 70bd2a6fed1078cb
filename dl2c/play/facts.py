"""What a page knows of its model besides the WebAssembly: names, decisions, paths, conditions, as JSON."""

import math
import re
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from dl2c.emit.simulator.conditions import span_data
from dl2c.env.infos import STATUS, reason_names
from dl2c.ir.logic import atoms
from dl2c.native.manifest import AxisSpec, Manifest, Quantity
from dl2c.paths.path import Path
from dl2c.play.build import Playable
from dl2c.policy.network import NetworkPolicy
from dl2c.source import Span, text_hash

BRANCH = re.compile(r"[{\s]*(if|while)\b")

ON_BLOCKED = ("fallback", "truncate", "terminate")
ACTION_MAPS = ("project", "squash")
"""By their codes in dl2c.h."""


def facts_of(made: Playable) -> dict[str, Any]:
    """Everything; infinite limits are None."""
    manifest, paths = made.manifest, made.build.paths
    return {
        "name": manifest.name,
        "version": manifest.dl2c_version,
        "source": {"name": manifest.source, "sha256": text_hash(made.source.text), "text": made.source.text},
        "options": manifest.options,
        "batch": _batch(manifest),
        "theorem": asdict(manifest.theorem),
        "notes": [*made.notes, *manifest.notes],
        "approximate": made.approximate,
        "variables": [_quantity(q) for q in manifest.variables],
        "constants": [_quantity(q) for q in manifest.constants],
        "observations": [q.name for q in manifest.observations],
        "choices": [asdict(c) for c in manifest.choices],
        "inputs": [asdict(i) for i in manifest.inputs],
        "drawn": [c.key for c in manifest.drawn_choices] + [i.key for i in manifest.drawn_inputs],
        "predicates": [asdict(p) for p in manifest.predicates],
        "flows": [{"kernel": f.kernel, "span": span_data(f.flow.span)} for f in made.build.flows],
        "reasons": reason_names(manifest),
        "statuses": STATUS,
        "drawable": made.build.sampling is not None,
        "scene": _scene(manifest),
        "policy": None if made.policy is None else _policy(made.policy),
        "all_inputs": [i.key for i in paths.inputs],
        "paths": [_path(p) for p in paths.paths],
        **made.conditions.as_data(),
    }


def _policy(policy: NetworkPolicy) -> dict[str, Any]:
    """How its outputs become an action."""
    io = policy.interface
    fields = ("kind", "counts", "runs", "inputs", "low", "high", "squash", "outputs")
    facts = {name: getattr(io, name) for name in fields}
    return facts | {"masked": policy.masked, "bounded": policy.network.bounded}


def _batch(manifest: Manifest) -> dict[str, Any]:
    """The options of the only environment, as dl2c.h has them."""
    options = manifest.options
    return {
        "max_steps": options["max_episode_steps"],
        "stall_limit": options["stall_limit"],
        "blocked_penalty": options["blocked_penalty"],
        "on_blocked": ON_BLOCKED.index(options["on_blocked"]),
        "action_map": ACTION_MAPS.index(options["action_map"]),
    }


def _quantity(q: Quantity) -> dict[str, Any]:
    return asdict(q) | _limits(q)


def _scene(manifest: Manifest) -> dict[str, Any]:
    axes = {name: asdict(axis) | _limits(axis) for name, axis in manifest.scene.axes.items()}
    return asdict(manifest.scene) | {"axes": axes}


def _limits(item: Quantity | AxisSpec) -> dict[str, float | None]:
    ends = {"low": item.low, "high": item.high}
    return {name: end if math.isfinite(end) else None for name, end in ends.items()}


def _path(path: Path) -> dict[str, Any]:
    return {
        "point": path.point,
        "decisions": path.decisions,
        "marks": dict(zip(path.met, path.marks, strict=True)),
        "inputs": [a.input for a in path.admissions],
        "flow": path.flow,
        "statements": [span_data(s) for s in _places(path)],
    }


def _places(path: Path) -> Iterator[Span]:
    """Where the text says what a path executes; of `if` and `while` that is their condition."""
    tests = [path.guard, *(a.tests for a in path.admissions)]
    conditions = [atom.span for test in tests for atom in atoms(test)]
    for span in path.statements:
        if BRANCH.match(span.text):
            yield from (c for c in conditions if span.start <= c.start and c.end <= span.end)
        else:
            executed = span.text.partition("@invariant")[0]
            yield Span(span.source, span.start, span.start + len(executed))
