"""Policies in files: nothing in them is executed, and what is wrong with them is said in one line."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY

from dl2c import cli
from dl2c.policy.files import JSON, NPZ, read_policy, write_policy
from dl2c.policy.network import Interface, Layer, Network, NetworkPolicy, PolicyError, Scaling

WAYPOINT = ("xr", "vr", "ar", "xg", "t", "T", "ep", "b", "A", "GDelta", "Vmax")
LIMITS = {
    "xr": (0, 100), "vr": (0, 20), "ar": (-10, 10), "xg": (0, 100), "t": (0, 1), "T": (0, 1000),
    "ep": (float(np.nextafter(np.float32(0.1), np.float32(0))), 0.5), "b": (0.5, 5), "A": (1, 10),
    "GDelta": (1, 10), "Vmax": (5, 30),
}  # fmt: skip


def made(model: str = "Waypoint", seed: int = 0) -> NetworkPolicy:
    """A policy of the waypoint example with random weights."""
    rng = np.random.default_rng(seed)
    observations = tuple((n, float(LIMITS[n][0]), float(LIMITS[n][1])) for n in WAYPOINT)
    layers = (
        Layer(rng.normal(size=(5, 11)), rng.normal(size=5), "tanh"),
        Layer(rng.normal(size=(4, 5)), rng.normal(size=4), "identity"),
    )
    scaling = Scaling(rng.normal(size=11), rng.uniform(1, 10, 11), 5.0)
    interface = Interface(observations, "float32", "choice", (4,))
    return NetworkPolicy(model, interface, Network((scaling,), layers), True, {})


def test_read_inverts_write(tmp_path: Path) -> None:
    policy = made()
    found = read_policy(write_policy(policy, tmp_path))
    rng = np.random.default_rng(3)
    observations, masks = rng.normal(size=(50, 11)), rng.random((50, 4)) < 0.5
    assert found.interface == policy.interface
    assert (found.network.outputs(observations) == policy.network.outputs(observations)).all()
    assert (found.act(observations, masks) == policy.act(observations, masks)).all()
    open_rows = masks.any(axis=1)
    assert masks[open_rows, found.act(observations, masks)[open_rows]].all()


Change = Callable[[dict[str, Any]], Any]

WRONG: dict[str, tuple[Change, str]] = {
    "no version": (lambda d: d.pop("version"), "not of version 1"),
    "another version": (lambda d: d.update(version=9), "not of version 1"),
    "no layers": (lambda d: d.pop("layers"), "lacks 'layers'"),
    "layers of another kind": (lambda d: d.update(layers={}), "not a list"),
    "a layer of another kind": (lambda d: d.update(layers=["weight_0"]), "not an object"),
    "one layer too few": (lambda d: d["layers"].pop(), "gives 5 numbers"),
    "layers in the wrong order": (lambda d: d["layers"].reverse(), "layer 0 has weights"),
    "an unknown activation": (lambda d: d["layers"][0].update(activation="sin"), "no activation 'sin'"),
    "an unknown array": (lambda d: d["layers"][0].update(bias="bias_7"), "no array 'bias_7'"),
    "a bias for weights": (lambda d: d["layers"][0].update(weight="bias_0"), "layer 0 has weights"),
    "a scaling by nothing": (lambda d: d["scalings"][0].update(clip=0), "not positive"),
    "an infinite number": (lambda d: d["scalings"][0].update(clip=float("inf")), "is not a number"),
    "a large number": (lambda d: d["scalings"][0].update(clip=10**400), "is not a number"),
    "another interface": (lambda d: d["interface"].update(kind="all"), "no actions 'all'"),
    "no interface": (lambda d: d.update(interface=[]), "not an object"),
    "no alternatives": (lambda d: d["interface"].update(counts=[0]), "no range"),
    "half of an observation": (lambda d: d["interface"]["observations"].append(["x", 0]), "two limits"),
    "an observation too many": (lambda d: d["interface"]["observations"].append(["x", 0, 1]), "not fit 12"),
    "unknown options": (lambda d: d.update(options={"speed": 3}), "no option `speed`"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_policy_is_refused(name: str, tmp_path: Path) -> None:
    change, words = WRONG[name]
    path = write_policy(made(), tmp_path)
    data = json.loads(path.read_text(encoding="utf-8"))
    change(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(PolicyError, match=words):
        read_policy(path)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"weight_0": np.array([object()], dtype=object)}, "holds no arrays"),
        ({"weight_0": np.zeros((5, 11), np.int64)}, "not a vector or matrix of floats"),
        ({"weight_0": np.zeros((5, 11, 1))}, "not a vector or matrix of floats"),
        ({"weight_0": np.full((5, 11), np.nan)}, "not finite"),
        ({"weight_0": np.zeros((5, 10))}, "layer 0 has weights"),
        ({"scale_0": np.zeros(11)}, "not positive"),
    ],
    ids=["objects", "whole numbers", "three axes", "not numbers", "too narrow", "no scale"],
)
def test_arrays_that_are_none_of_a_network_are_refused(
    arrays: dict[str, Any], words: str, tmp_path: Path
) -> None:
    path = write_policy(made(), tmp_path)
    with np.load(tmp_path / NPZ) as file:
        all_arrays = {name: file[name] for name in file.files} | arrays
    np.savez(tmp_path / NPZ, **all_arrays)
    with pytest.raises(PolicyError, match=words):
        read_policy(path)


@pytest.mark.parametrize("content", [b"", b"PK\x05\x06" + b"\0" * 18, b"\x93NUMPY", b"PK\x03\x04 broken"])
def test_files_that_are_none_are_refused(content: bytes, tmp_path: Path) -> None:
    path = write_policy(made(), tmp_path)
    (tmp_path / NPZ).write_bytes(content)
    with pytest.raises(PolicyError):
        read_policy(path)
    path.write_bytes(content)
    with pytest.raises(PolicyError):
        read_policy(path)


def test_encrypted_arrays_are_refused(tmp_path: Path) -> None:
    path = write_policy(made(), tmp_path)
    content = bytearray((tmp_path / NPZ).read_bytes())
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = content.find(mark)
        while place >= 0:
            content[place + offset] |= 1
            place = content.find(mark, place + 1)
    (tmp_path / NPZ).write_bytes(content)
    with pytest.raises(PolicyError, match="encrypted"):
        read_policy(path)


# The command ---------------------------------------------------------------------------------------


def run(capsys: Any, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> tuple[int, str, str]:
    monkeypatch.setattr("sys.argv", ["dl2c", *arguments])
    try:
        cli.main()
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    said = capsys.readouterr()
    return code, said.out, said.err


def test_a_policy_is_exported_without_torch(tmp_path: Path) -> None:
    """Nor Stable-Baselines3: the policy is data."""
    write_policy(made(), tmp_path)
    blocked = "import sys; sys.modules.update(dict.fromkeys(['torch', 'stable_baselines3', 'sb3_contrib']))"
    argv = ["dl2c", "monitor", "example:waypoint", "--policy", str(tmp_path), "-o", str(tmp_path / "out")]
    code = f"{blocked}; sys.argv = {argv!r}; from dl2c.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert {"Waypoint_monitor.c", "Waypoint_policy.c", "Waypoint_policy.h", "main.c"} <= names
    text = (tmp_path / "out" / "Waypoint_policy.c").read_text(encoding="utf-8")
    assert "malloc" not in text
    tables = [line for line in text.splitlines() if "] = {" in line and not line.startswith(" ")]
    assert len(tables) == 8 and all(line.startswith("static const ") for line in tables)


@pytest.mark.parametrize(
    ("model", "policy", "words"),
    [
        ("example:dubins", made(), "was trained on 'Waypoint', not on 'Dubins car'"),
        ("example:dubins", made("Dubins car"), "the policy observes xr, vr"),
        ("example:waypoint", None, "holds no policies"),
    ],
)
def test_policies_of_something_else_are_refused(
    model: str, policy: NetworkPolicy | None, words: str, capsys: Any, monkeypatch: Any, tmp_path: Path
) -> None:
    if policy is not None:
        write_policy(policy, tmp_path)
    arguments = ["monitor", model, "--policy", str(tmp_path), "-o", str(tmp_path / "out")]
    code, _, err = run(capsys, monkeypatch, *arguments)
    assert code == 1 and words in err and "internal" not in err and not (tmp_path / "out").exists()


def test_a_policy_needs_its_constants_as_they_were(capsys: Any, monkeypatch: Any, tmp_path: Path) -> None:
    write_policy(made(), tmp_path)
    arguments = ["monitor", "example:waypoint", "--policy", str(tmp_path / JSON), "-o", str(tmp_path / "out")]
    code, _, err = run(capsys, monkeypatch, *arguments, "--set", "b=3")
    assert code == 1 and "the model shows xr, vr, ar, xg, t, T, ep, A, GDelta, Vmax" in err
    code, _, err = run(capsys, monkeypatch, *arguments, "--kind", "safety")
    assert code == 1 and "--policy needs -o, and the controller's check" in err


def zipped(folder: Path, policy: str, space: Any) -> Path:
    """An untrained policy of Stable-Baselines3 for observations of its own."""
    sb3 = pytest.importorskip("stable_baselines3")
    import gymnasium

    class Other(gymnasium.Env[Any, Any]):
        observation_space, action_space = space, gymnasium.spaces.Discrete(4)

        def reset(self, **_: Any) -> Any:
            return self.observation_space.sample(), {}

    sb3.PPO(policy, Other(), device="cpu").save(folder / "policy.zip")
    return folder / "policy.zip"


def test_zip_files_of_something_else_are_refused(capsys: Any, monkeypatch: Any, tmp_path: Path) -> None:
    from gymnasium.spaces import Box

    box = Box(-1, 1, (3,), np.float32)
    arguments = ["monitor", "example:waypoint", "-o", str(tmp_path / "out"), "--policy"]
    code, _, err = run(capsys, monkeypatch, *arguments, str(zipped(tmp_path, "MlpPolicy", box)))
    assert code == 1 and "observes numbers of shape (3,); the model shows 11" in err
    assert "warning: loading policy.zip executes code" in err
    image = Box(0, 255, (36, 36, 3), np.uint8)
    code, _, err = run(capsys, monkeypatch, *arguments, str(zipped(tmp_path, "CnnPolicy", image)))
    assert code == 1 and "observes numbers of shape (3, 36, 36)" in err and "internal" not in err
    (tmp_path / "policy.zip").write_bytes(b"PK no zip")
    code, _, err = run(capsys, monkeypatch, *arguments, str(tmp_path / "policy.zip"))
    assert code == 1 and "is not a policy that Stable-Baselines3 saved" in err


def test_training_writes_the_policy_as_data(capsys: Any, monkeypatch: Any, tmp_path: Path) -> None:
    """The same actions as the zip file, in the same episode."""
    pytest.importorskip("stable_baselines3")
    from dl2c.training.learning import train
    from dl2c.training.rollout import rollout
    from dl2c.training.run import Settings

    settings = Settings(steps=64, n_envs=4, hyper={"n_steps": 16, "batch_size": 16, "net_arch": [8, 8]})
    train("example:watertank", directory=tmp_path, settings=settings, action_map="squash")
    runs = [
        list(rollout(str(path), "example:watertank", seed=4, max_episode_steps=40, action_map="squash"))
        for path in (tmp_path / "policy.zip", tmp_path)
    ]
    levels = [[row["l"] for row in rows] for rows in runs]
    assert len(levels[0]) == 41 and np.allclose(*levels, atol=1e-5)
    out = str(tmp_path / "out")
    code, _, err = run(
        capsys, monkeypatch, "monitor", "example:watertank", "--policy", str(tmp_path), "-o", out
    )
    assert (code, err) == (0, "")
    assert "-1 to 1" in (tmp_path / "out" / "Water_tank_monitor.h").read_text(encoding="utf-8")
