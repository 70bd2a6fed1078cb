"""Files of every format, mutated: readers return, or raise the one error that they document.

`make test-hostile` runs this. DL2C_MUTATIONS says how many mutations of each format are read, DL2C_SEED
which.
"""

import json
import os
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from policy.test_policy_files import made

import dl2c
from dl2c.commands.monitor import unit_of
from dl2c.configuration import configured
from dl2c.diagnostics import CompileError
from dl2c.env.single import Dl2cEnv
from dl2c.native import cache
from dl2c.native.errors import NativeError
from dl2c.native.manifest import Manifest
from dl2c.options import Options
from dl2c.parse.parser import parse_archive
from dl2c.policy.files import read_policy, write_policy
from dl2c.policy.network import PolicyError
from dl2c.report.episode import EpisodeError, Start, play, read_episode, write_episode
from dl2c.report.trace import TraceError, disconnected, questions, rows_of
from dl2c.report.trained import RunError, read_trained
from dl2c.source import Source
from dl2c.training.configured import read_configuration
from dl2c.training.folders import read_run
from dl2c.training.rollout import rollout
from dl2c.training.run import TrainingError

MUTATIONS = int(os.environ.get("DL2C_MUTATIONS", "100"))
SEED = int(os.environ.get("DL2C_SEED", "20240"))
WAYPOINT = "example:waypoint"

SETTINGS = """\
model: example:waypoint
algo: ppo
steps: 2000
normalize: true
hyper: &h {learning_rate: 3e-3, gamma: 0.01, net_arch: [64, 64]}
options: {on_blocked: fallback, blocked_penalty: -1000, constants: {A: 1.5}}
"""
CONFIGURATION = """\
[project]
name = "x"
[tool.dl2c]
dt = 0.25
on_blocked = "terminate"
default_bound = "-10:10"
[tool.dl2c.constants]
A = 1.5
"""
RUN = {
    "model": WAYPOINT,
    "algo": "ppo",
    "seed": 1,
    "options": {"on_blocked": "fallback"},
    "settings": {"steps": 100, "n_envs": 4, "normalize": True, "hyper": {"gamma": 0.9}},
    "steps": 100,
    "seconds": 1.5,
    "interrupted": False,
    "curve": [],
    "evaluations": [],
    "versions": {"dl2c": "0.1.0"},
}
PIECES = [
    *(b"\xff", b"\x00", b"\xef\xbb\xbf", b"NaN", b"-Infinity", b"1e999", b"-1", b"9" * 5000, b"1e400"),
    *(b"[" * 2000, b"{", b"}", b'"', b"null", b"true", b"\n", b",", b":", b"&a ", b"*a", b"!!python/none "),
    *(b"0x1", b"1_0", b"2001-13-45", b"'", b"\\u0000", b"\r\n", b"\t", b"(* ", b"*/", b"End."),
]
ODD: list[Any] = [None, True, -1, 1.5, 2**70, 10**400, "", "text", "nan", [], {}, [[]], [None], {"a": []}]


@dataclass(frozen=True)
class Format:
    """Files of which `name` is mutated, a reader of their folder, and what it may raise."""

    name: str
    files: dict[str, bytes]
    read: Callable[[Path], Any]
    errors: tuple[type[Exception], ...]


def written(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def traced(folder: Path) -> Format:
    unit = unit_of(WAYPOINT, {})
    rows = list(rollout("random", WAYPOINT, 1, 0, True))
    lines = [",".join(rows[0]), *(",".join(map(str, row.values())) for row in rows)]

    def read(place: Path) -> None:
        found = rows_of(place / "t.csv", unit)
        list(questions(unit, found))
        disconnected(found)

    return Format("t.csv", {"t.csv": "\n".join(lines).encode()}, read, (TraceError, OSError))


def recorded(folder: Path) -> Format:
    env = Dl2cEnv(WAYPOINT)
    write_episode(play(env, Start(1), [0, 1, 0]), folder / "e.json")
    return Format(
        "e.json", written(folder), lambda place: read_episode(place / "e.json"), (EpisodeError, OSError)
    )


def built(folder: Path) -> dict[str, bytes]:
    directory = dl2c.build(WAYPOINT).directory
    return {name: (directory / name).read_bytes() for name in ("manifest.json", cache.SEAL)}


def policy(name: str) -> Callable[[Path], Format]:
    def made_here(folder: Path) -> Format:
        write_policy(made(), folder)
        files = written(folder)
        return Format(name, files, lambda p: read_policy(p / "policy.json"), (PolicyError, OSError))

    return made_here


def text(name: str, content: str, read: Callable[[Path], Any], *errors: type[Exception]) -> Any:
    return lambda _: Format(name, {name: content.encode()}, read, (*errors, OSError))


FORMATS: dict[str, Callable[[Path], Format]] = {
    "settings": text("c.yaml", SETTINGS, lambda p: read_configuration(p / "c.yaml"), TrainingError),
    "configuration": text("pyproject.toml", CONFIGURATION, lambda p: configured(Options(), p), CompileError),
    "trace": traced,
    "episode": recorded,
    "policy": policy("policy.json"),
    "arrays": policy("policy.npz"),
    "manifest": lambda f: Format(
        "manifest.json", built(f), lambda p: Manifest.read(p / "manifest.json"), (NativeError,)
    ),
    "seal": lambda f: Format(cache.SEAL, built(f), cache._intact, ()),
    "run": text("run.json", json.dumps(RUN, indent=1), read_run, TrainingError),
    "trained": text("run.json", json.dumps(RUN), lambda p: read_trained(p, WAYPOINT), RunError),
    "model": text(
        "m.kyx",
        Source.read(Path(dl2c.__file__).parent.parent / "examples" / "watertank.kyx").text,
        lambda p: parse_archive(Source.read(p / "m.kyx")),
        CompileError,
    ),
}


def mutated(content: bytes, rng: Random) -> bytes:
    """Bytes cut, doubled, exchanged and put in; of JSON also values of other kinds."""
    if content[:1] == b"{" and rng.random() < 0.5:
        data = json.loads(content)
        for _ in range(rng.randint(1, 2)):
            _exchange(data, rng)
        return json.dumps(data).encode()
    raw = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5))):
        at = rng.randrange(len(raw) + 1)
        match rng.randrange(6):
            case 0:
                del raw[at : at + rng.choice((1, 4, 40, 4000))]
            case 1:
                raw[at:at] = raw[max(0, at - rng.choice((1, 10, 100))) : at]
            case 2 if at < len(raw):
                raw[at] = rng.randrange(256)
            case 3 if at < len(raw):
                raw[at] ^= 1 << rng.randrange(8)
            case 4:
                del raw[at:]
            case _:
                raw[at:at] = rng.choice(PIECES)
    return bytes(raw)


def _exchange(data: Any, rng: Random) -> None:
    """One entry, however deep, is taken away or becomes something odd."""
    places = [data]
    for place in places:
        inner = place.values() if isinstance(place, dict) else place
        places += [part for part in inner if isinstance(part, dict | list) and part]
    place = rng.choice(places)
    keys = list(place) if isinstance(place, dict) else list(range(len(place)))
    if not keys:
        return
    key = rng.choice(keys)
    if rng.random() < 0.3:
        del place[key]
    else:
        place[key] = deepcopy(rng.choice(ODD))


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("count", [MUTATIONS, pytest.param(100_000, marks=pytest.mark.slow)])
def test_readers_raise_their_own_error_alone(name: str, count: int, tmp_path: Path) -> None:
    origin, folder = tmp_path / "origin", tmp_path / "mutated"
    origin.mkdir()
    folder.mkdir()
    form = FORMATS[name](origin)
    for file, content in form.files.items():
        (folder / file).write_bytes(content)
    form.read(folder)
    rng, refused = Random(f"{name} {SEED}"), 0
    for number in range(count):
        content = mutated(form.files[form.name], rng)
        (folder / form.name).write_bytes(content)
        try:
            with np.errstate(all="ignore"):
                form.read(folder)
        except form.errors as problem:
            refused += 1
            assert len(str(problem)) < 20_000
        except Exception as problem:
            raise AssertionError(f"mutation {number} raises {problem!r}: {content[:300]!r}") from problem
    assert refused > 0 or not form.errors or count < 50
