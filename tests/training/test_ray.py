"""Sweeps over a real cluster of two nodes, each with a cache of its own, one of which is lost meanwhile.

`make test-ray` runs this, in an environment that has Ray.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from policy.test_policy_files import made

import dl2c.ray
from dl2c.native.errors import ResetFailed
from dl2c.policy.files import write_policy
from dl2c.ray import ATTEMPTS, SweepFailed
from dl2c.training.rollout import rollout

pytestmark = pytest.mark.slow
ray = pytest.importorskip("ray")
Cluster: Any = pytest.importorskip("ray.cluster_utils").Cluster
pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

WAYPOINT = "example:waypoint"
ROOT = Path(__file__).resolve().parents[2]
SEED = 11

UNSAMPLED = """
ArchiveEntry "Unsampled"
ProgramVariables Real x; End.
Problem x = cos(x) -> [{x := x/2;}*] x >= 0 End.
End.
"""

Acting = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass
class Nodes:
    """A cluster, its second node, and the folder of each node's cache."""

    cluster: Any
    second: Any
    caches: dict[str, Path]

    def builds(self, node: str) -> int:
        """How many builds of the model the cache of a node holds."""
        sealed = self.caches[node].glob("builds/*/sealed.json")
        manifests = [json.loads((s.parent / "manifest.json").read_text(encoding="utf-8")) for s in sealed]
        return sum(manifest["name"] == "Waypoint" for manifest in manifests)


@contextmanager
def started(folder: Path) -> Iterator[Nodes]:
    """Two nodes with one and two workers."""
    caches = {name: folder / name for name in ("head", "second")}
    own = {name: {"DL2C_CACHE_DIR": str(path)} for name, path in caches.items()}
    cluster = Cluster()
    cluster.add_node(num_cpus=1, env_vars=own["head"], include_dashboard=False)
    second = cluster.add_node(num_cpus=2, env_vars=own["second"])
    cluster.wait_for_nodes()
    yield Nodes(cluster, second, caches)
    ray.shutdown()
    cluster.shutdown()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A cluster that stays whole."""
    with started(tmp_path_factory.mktemp("whole")) as nodes:
        yield nodes.cluster.address


def local(policy: Any, episodes: int, **options: Any) -> list[dict[str, Any]]:
    """The rows of a run here, with null where Arrow has null."""
    rows = rollout(policy, WAYPOINT, episodes, SEED, **options)
    return [row | {"action": None} if row["action"] == "" else row for row in rows]


def stopping(after: int, cache: Path, log: Path, running: Path) -> Acting:
    """The first enabled alternative. The node with this cache stops for good after so many decisions, which
    `running` then shows; the log has a byte for each.
    """

    def act(observations: np.ndarray, masks: np.ndarray) -> np.ndarray:
        if os.environ["DL2C_CACHE_DIR"] == str(cache):
            with log.open("ab") as file:
                file.write(b".")
                if file.tell() > after:
                    running.touch()
                    time.sleep(3600)
        return masks.argmax(axis=1)

    return act


def test_a_lost_node_loses_and_doubles_nothing(tmp_path: Path) -> None:
    """It is lost while it works on a task, with results that nobody has fetched yet."""
    episodes = 480
    expected = local("first", episodes)
    log, running = tmp_path / "log", tmp_path / "running"
    with started(tmp_path) as nodes:

        def kill() -> None:
            while not running.exists():
                time.sleep(0.1)
            nodes.cluster.remove_node(nodes.second, allow_graceful=False)

        killer = threading.Thread(target=kill, daemon=True)
        killer.start()
        act = stopping(len(expected) // 5, nodes.caches["second"], log, running)
        tables = list(dl2c.ray.rollout(act, WAYPOINT, episodes, SEED, address=nodes.cluster.address))
        killer.join(60)
        assert not killer.is_alive()
        assert max(table.nbytes for table in tables) > 100_000, "small results are not kept on their node"
        assert pa.concat_tables(tables).to_pylist() == expected
        assert (nodes.builds("head"), nodes.builds("second")) == (1, 1)


def test_a_lost_worker_loses_and_doubles_nothing(address: str, tmp_path: Path) -> None:
    marker = tmp_path / "marker"

    def act(observations: np.ndarray, masks: np.ndarray) -> np.ndarray:
        try:
            marker.touch(exist_ok=False)
            os.kill(os.getpid(), signal.SIGKILL)
        except FileExistsError:
            pass
        return masks.argmax(axis=1)

    tables = dl2c.ray.rollout(act, WAYPOINT, 20, SEED, address=address)
    assert pa.concat_tables(tables).to_pylist() == local("first", 20)
    assert marker.exists()


def test_a_task_that_always_kills_its_worker_ends_the_sweep(address: str) -> None:
    def act(observations: np.ndarray, masks: np.ndarray) -> np.ndarray:
        os.kill(os.getpid(), signal.SIGKILL)
        return masks.argmax(axis=1)

    with pytest.raises(SweepFailed, match=f"episodes 0 to 0 could not be run in {ATTEMPTS} attempts"):
        list(dl2c.ray.rollout(act, WAYPOINT, 1, SEED, address=address))


def test_failures_of_episodes_are_those_of_a_run_here(address: str) -> None:
    with pytest.raises(ResetFailed):
        list(rollout("first", UNSAMPLED))
    with pytest.raises(ResetFailed):
        list(dl2c.ray.rollout("first", UNSAMPLED, address=address))


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `dl2c rollout` on the waypoint as a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "dl2c", "rollout", WAYPOINT, "--seed", str(SEED), *arguments],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("options", [(), ("--action-format", "box", "--action-map", "squash")])
def test_the_command_writes_the_same_files(address: str, tmp_path: Path, options: tuple[str, ...]) -> None:
    """Of a policy in files, and of a random one with actions of several numbers."""
    if not options:
        write_policy(made(), tmp_path)
        options = ("--policy", str(tmp_path))
    names = [tmp_path / name for name in ("here.csv", "there.csv", "there.parquet", "here.parquet")]
    common = ("--episodes", "40", *options)
    here = command(*common, "--csv", str(names[0]))
    files = ("--csv", str(names[1]), "--parquet", str(names[2]))
    there = command(*common, *files, "--address", address)
    assert (here.returncode, there.returncode) == (0, 0), here.stderr + there.stderr
    assert there.stdout == here.stdout
    assert names[0].read_bytes() == names[1].read_bytes()
    command(*common, "--parquet", str(names[3]))
    one, other = map(parquet.read_table, names[2:])
    assert one.equals(other) and one.num_rows == len(names[0].read_text().splitlines()) - 1
    assert b"platform" in one.schema.metadata[b"dl2c"]


def test_an_address_where_nothing_listens_is_an_error() -> None:
    done = command("--address", "127.0.0.1:1")
    assert done.returncode == 1
    assert done.stderr.startswith("error: cannot reach a Ray cluster at 127.0.0.1:1")
