"""What makes a sweep over a cluster the same as a run here: shares, episodes that depend on nothing but their
seeds, policies that travel. Needs neither Ray nor a compiler; tests/training/test_ray.py has a real cluster.
"""

import pickle
import sys
from functools import partial
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import pytest
from generators.toy_library import use_toy
from hypothesis import given
from hypothesis import strategies as st

import dl2c.cli
from dl2c.native.errors import MonitorViolated, ResetFailed
from dl2c.native.toolchain import host
from dl2c.policy.files import JSON, NPZ
from dl2c.ray import LARGEST, SweepFailed, _compare, _portable, _unpacked, shares
from dl2c.training.policies import PolicyError
from dl2c.training.rollout import rollout
from dl2c.version import install

MODEL = "a model\nof two lines"


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes every model the toy library, with these decisions."""
    use_toy(monkeypatch)
    return partial(use_toy, monkeypatch)


@given(st.integers(1, 100_000), st.integers(1, 1000))
def test_every_episode_is_in_one_share(episodes: int, cpus: int) -> None:
    parts = list(shares(episodes, cpus))
    assert parts[0].start == 0 and parts[-1].stop == episodes
    assert all(part.stop == following.start for part, following in pairwise(parts))
    assert all(0 < len(part) <= LARGEST for part in parts)
    assert len(parts) >= min(episodes, cpus)


@pytest.mark.parametrize(("counts", "inputs"), [((3,), 0), ((3, 2), 0), ((), 2), ((), 0), ((2, 3), 1)])
@pytest.mark.parametrize("policy", ["random", "first"])
def test_shares_have_the_rows_of_the_whole(toy: Any, counts: Any, inputs: int, policy: str) -> None:
    toy(counts, inputs)
    whole = list(rollout(policy, MODEL, 7, seed=3))
    assert {row["episode"] for row in whole} == set(range(7))
    for cpus in (1, 2):
        parts = (rollout(policy, MODEL, len(s), 3, True, s.start) for s in shares(7, cpus))
        assert list(chain.from_iterable(parts)) == whole


def test_random_episodes_differ(toy: Any) -> None:
    rows = list(rollout("random", MODEL, 3, seed=3))
    actions = [[row["action"] for row in rows if row["episode"] == k] for k in range(3)]
    assert actions[0] != actions[1] != actions[2]


def test_saved_policies_travel_with_their_files(tmp_path: Path) -> None:
    saved, arrived = tmp_path / "saved", tmp_path / "arrived"
    saved.mkdir()
    arrived.mkdir()
    contents = {JSON: b"{}", NPZ: b"arrays", "policy.zip": b"zip"}
    for name, content in contents.items():
        (saved / name).write_bytes(content)
    for given_, names in ((saved, (JSON, NPZ)), (saved / JSON, (JSON, NPZ)), (saved / "policy.zip", ())):
        path = _unpacked(_portable(given_), arrived)
        assert isinstance(path, Path) and path.parent == arrived
        assert all((arrived / name).read_bytes() == contents[name] for name in {path.name, *names})
    assert _unpacked(_portable("random"), arrived) == "random"
    with pytest.raises(FileNotFoundError):
        _portable("nowhere.zip")


def test_nodes_that_differ_are_named() -> None:
    here = host()
    assert set(here) == {"machine", "system", "libc", "cpu", "casadi"}
    _compare(here, host())
    with pytest.raises(SweepFailed, match=r"libc is '.*' and 'musl 1'.*--allow-mixed"):
        _compare(here, here | {"libc": "musl 1"})
    with pytest.raises(SweepFailed, match="solver is None and 'casadi 1'"):
        _compare(here, here | {"solver": "casadi 1"})


def test_failures_travel() -> None:
    failures = (MonitorViolated("said", 3, 7), ResetFailed("none"), PolicyError("not one"))
    for failure in failures:
        arrived = pickle.loads(pickle.dumps(failure))
        assert type(arrived) is type(failure) and str(arrived) == str(failure)
        assert vars(arrived) == vars(failure)


@pytest.mark.parametrize(("module", "flag"), [("ray", "--ray"), ("pyarrow", "--parquet=rows.parquet")])
def test_without_the_extra_there_is_advice(
    toy: Any, monkeypatch: pytest.MonkeyPatch, capsys: Any, tmp_path: Path, module: str, flag: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr(sys, "argv", ["dl2c", "rollout", MODEL, flag])
    with pytest.raises(SystemExit) as end:
        dl2c.cli.main()
    assert end.value.code == 1
    assert install("ray") in capsys.readouterr().err
