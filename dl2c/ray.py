"""Rollouts over a cluster of Ray: the rows of `dl2c.training.rollout`, whatever the number of workers.

Goes in: a policy, a model and options as there. Comes out: Arrow tables, in the order of episodes. Needs
the extra `dl2c[ray]`, here and on every node. An episode depends on nothing but its seed, so a task runs
some of them, a lost task is run again, and its rows are the same. Ray and pyarrow are imported when called.
"""

import importlib
import json
import socket
import tempfile
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from dl2c.env.actions import flat_format
from dl2c.env.opening import Model, open_library, source_of
from dl2c.policy.files import JSON, NPZ
from dl2c.source import Source
from dl2c.training.policies import Policy
from dl2c.training.rollout import rollout as here
from dl2c.training.tables import MANIFEST, Table, arrow, schema, tables
from dl2c.version import install

LARGEST = 1000
"""Episodes of one task at most: what is run again if its worker is lost, and in memory at once."""

TASKS_PER_CPU = 4
"""Where there are few episodes, tasks are so small that each processor gets this many."""

ATTEMPTS = 6
"""How often a task is tried before the sweep gives up: its worker may be what it kills."""


REACH_SECONDS = 10.0
"""How long connecting to an address may take."""


class SweepFailed(Exception):
    """The cluster cannot be reached, its nodes compute differently, or it lost some episodes for good."""


@dataclass(frozen=True, slots=True)
class Files:
    """A saved policy: the name and content of each of its files, of the main one first."""

    contents: tuple[tuple[str, bytes], ...]


Portable: TypeAlias = str | Files | Policy
"""A policy that does not depend on files of one machine."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """What every task of a sweep needs; it is sent to each node once."""

    policy: Portable
    source: Source
    options: dict[str, Any]
    seed: int
    masked: bool


def rollout(
    policy: str | Path | Policy,
    model: Model,
    episodes: int = 1,
    seed: int = 0,
    masked: bool = True,
    *,
    address: str | None = None,
    allow_mixed: bool = False,
    note: Callable[[int], None] = lambda _: None,
    **options: Any,
) -> Iterator[Table]:
    """Run episodes on a cluster; tables with the rows of the local `rollout`, in the same order.

    `address` is that of a cluster, as `ray.init` takes it: by default one that runs here already, or else
    this machine alone. A connection that there is already is used and kept. `note` is told how many
    episodes are done. Raises `SweepFailed`, with nodes on which floating-point arithmetic may round
    differently too, unless `allow_mixed`; what the local `rollout` raises; `ModuleNotFoundError`.
    """
    source = source_of(model)
    manifest = open_library(source, options).manifest
    flat = manifest.options | {"action_format": flat_format(manifest)}
    sweep = Sweep(_portable(policy), source, flat, seed, masked)
    with _connected(address) as ray:
        first: dict[str, str] = {}
        for done, table in _run(ray, sweep, episodes):
            first = first or _identity(table)
            if not allow_mixed:
                _compare(first, _identity(table))
            note(done)
            yield table


def shares(episodes: int, cpus: int) -> Iterator[range]:
    """The episodes of each task: consecutive, and every episode once."""
    size = min(LARGEST, max(1, -(-episodes // (TASKS_PER_CPU * cpus))))
    for first in range(0, episodes, size):
        yield range(first, min(first + size, episodes))


def _run(ray: Any, sweep: Sweep, episodes: int) -> Iterator[tuple[int, Table]]:
    """How many episodes are done, and the table of the last of them. Only some tasks wait at a time, so
    that results do not pile up.
    """
    task = ray.remote(_task).options(max_retries=ATTEMPTS - 1, scheduling_strategy="SPREAD")
    given, waiting = ray.put(sweep), shares(episodes, _cpus(ray))
    running: deque[tuple[range, Any]] = deque()
    try:
        while True:
            while len(running) < 2 * _cpus(ray) and (share := next(waiting, None)) is not None:
                running.append((share, task.remote(given, share)))
            if not running:
                return
            share, reference = running[0]
            table = _result(ray, share, reference)
            running.popleft()
            yield share.stop, table
    finally:
        for _, reference in running:
            ray.cancel(reference, force=True)


def _task(sweep: Sweep, share: range) -> Table:
    """Some episodes of a sweep, on a worker."""
    with tempfile.TemporaryDirectory() as folder:
        policy = _unpacked(sweep.policy, Path(folder))
        shape = schema(open_library(sweep.source, sweep.options).manifest)
        steps = here(policy, sweep.source, len(share), sweep.seed, sweep.masked, share.start, **sweep.options)
        return arrow().concat_tables(tables(steps, shape)).combine_chunks()


def _result(ray: Any, share: range, reference: Any) -> Table:
    try:
        return ray.get(reference)
    except ray.exceptions.RayTaskError as failure:
        raise failure.cause from None
    except ray.exceptions.RayError as failure:
        which = f"episodes {share.start} to {share.stop - 1} could not be run in {ATTEMPTS} attempts"
        raise SweepFailed(f"{which}: {str(failure).strip().splitlines()[0]}") from None


def _cpus(ray: Any) -> int:
    return max(1, int(ray.cluster_resources().get("CPU", 0)))


@contextmanager
def _connected(address: str | None) -> Generator[Any]:
    """The module `ray`, connected to a cluster."""
    try:
        ray: Any = importlib.import_module("ray")
    except ModuleNotFoundError as missing:
        advice = f"install it with `{install('ray')}`"
        raise ModuleNotFoundError(f"{missing}; {advice}", name=missing.name) from None
    arrow()
    if ray.is_initialized():
        yield ray
        return
    try:
        if address is not None and ":" in address:
            _reach(address)
        ray.init(address=address, log_to_driver=False, logging_level="ERROR")
    except (OSError, RuntimeError, ValueError) as failure:
        at = "" if address is None else f" at {address}"
        raise SweepFailed(f"cannot reach a Ray cluster{at}: {failure}") from None
    try:
        yield ray
    finally:
        ray.shutdown()


def _reach(address: str) -> None:
    """Ray itself tries for many minutes before it says so. Raises `OSError` where nothing listens."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    socket.create_connection((host.strip("[]"), int(port)), REACH_SECONDS).close()


# What goes to the workers, and what comes back ---------------------------------


def _portable(policy: str | Path | Policy) -> Portable:
    """Reads the files of a saved policy. Raises `OSError`."""
    if callable(policy):
        return policy
    if policy in ("random", "first"):
        return str(policy)
    path = Path(policy, JSON) if Path(policy).is_dir() else Path(policy)
    files = (path, path.with_name(NPZ)) if path.suffix == ".json" else (path,)
    return Files(tuple((file.name, file.read_bytes()) for file in files))


def _unpacked(policy: Portable, folder: Path) -> str | Path | Policy:
    """The policy as `rollout` takes it; files are written to the folder."""
    if not isinstance(policy, Files):
        return policy
    for name, content in policy.contents:
        (folder / name).write_bytes(content)
    return folder / policy.contents[0][0]


def _identity(table: Table) -> dict[str, str]:
    """What rounding may depend on where a table was made, and by which dl2c."""
    manifest = json.loads(table.schema.metadata[MANIFEST])
    versions = {name: str(manifest[name]) for name in ("dl2c_version", "stream_version")}
    return versions | manifest["platform"]


def _compare(one: dict[str, str], other: dict[str, str]) -> None:
    """Raises `SweepFailed` where tables were made on machines that may round differently."""
    differ = sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))
    if differ:
        said = ", ".join(f"{name} is {one.get(name)!r} and {other.get(name)!r}" for name in differ)
        raise SweepFailed(
            f"nodes of the cluster differ, so results may differ in their last bits: {said}; "
            "allow it with --allow-mixed, or in Python with allow_mixed=True"
        )
