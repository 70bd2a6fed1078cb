"""Hostile files, full disks, interruptions: what is written is whole, and what is wrong is one line."""

import json
import os
import signal
import stat
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import shared
from selection import quick_among

import dl2c
from dl2c.diagnostics import CompileError
from dl2c.native import toolchain
from dl2c.native.binding import load_library
from dl2c.native.errors import CompilerFailed, NativeError
from dl2c.native.manifest import Manifest
from dl2c.outputs import output_file, output_folder, write_output
from dl2c.pipeline import check_model
from dl2c.policy.files import read_policy
from dl2c.policy.network import PolicyError
from dl2c.source import Source
from dl2c.training.configured import read_configuration
from dl2c.training.run import TrainingError

ROOT = Path(__file__).resolve().parent.parent.parent
COMMAND = [sys.executable, "-m", "dl2c"]


def ran(*words: str | Path, **options: Any) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *map(str, words)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command, capture_output=True, text=True, timeout=300, check=False, env=environment, **options
    )


def refused(done: subprocess.CompletedProcess[str], *words: str) -> None:
    """One line of the user's, no bug."""
    assert done.returncode == 1, (done.returncode, done.stderr)
    assert "internal error" not in done.stderr and "Traceback" not in done.stderr
    assert all(word in done.stderr for word in words), done.stderr


# Outputs -----------------------------------------------------------------------

LOADED = """
import sys, time
import numpy as np
import dl2c
library = dl2c.load(sys.argv[1])
batch = library.batch(8)
batch.reset(seeds=np.arange(8, dtype=np.uint64))
print("ready", flush=True)
sys.stdin.readline()
for _ in range(1000):
    batch.step()
print(batch.obs.sum())
"""


def test_a_build_leaves_the_library_of_a_live_process_alone(tmp_path: Path) -> None:
    """It was truncated in place, and the process crashed."""
    folder = tmp_path / "Waypoint"
    assert ran("build", "example:waypoint", "-o", tmp_path).returncode == 0
    command = [sys.executable, "-c", LOADED, str(folder)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, cwd=ROOT) as process:
        assert process.stdout is not None and process.stdin is not None
        assert process.stdout.readline() == "ready\n"
        inode = next(folder.glob("*.so")).stat().st_ino
        assert ran("build", "example:waypoint", "-o", tmp_path, "--set", "A=2.5").returncode == 0
        assert next(folder.glob("*.so")).stat().st_ino != inode
        process.stdin.write("\n")
        process.stdin.flush()
        assert np.isfinite(float(process.stdout.readline()))
    assert process.returncode == 0
    load_library(folder)


def test_what_fails_on_the_way_leaves_nothing(tmp_path: Path) -> None:
    old = tmp_path / "old.csv"
    old.write_text("whole", encoding="utf-8")
    old.chmod(0o640)
    with pytest.raises(KeyError), output_file(old) as fresh:
        fresh.write_text("half", encoding="utf-8")
        raise KeyError
    with pytest.raises(KeyError), output_folder(tmp_path / "deep" / "new") as folder:
        (folder / "half").write_text("half", encoding="utf-8")
        raise KeyError
    assert [p.name for p in tmp_path.iterdir()] == ["old.csv"] and old.read_text(encoding="utf-8") == "whole"
    write_output(old, "new")
    assert old.read_text(encoding="utf-8") == "new" and stat.S_IMODE(old.stat().st_mode) == 0o640


def test_folders_keep_what_is_not_written(tmp_path: Path) -> None:
    (tmp_path / "a" / "sub").mkdir(parents=True)
    (tmp_path / "a" / "own").write_text("mine", encoding="utf-8")
    (tmp_path / "a" / "sub" / "other").write_text("mine", encoding="utf-8")
    with output_folder(tmp_path / "a") as folder:
        (folder / "sub").mkdir()
        (folder / "sub" / "new").write_text("new", encoding="utf-8")
    assert sorted(p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()) == [
        "a/own",
        "a/sub/new",
        "a/sub/other",
    ]


LIMIT = """
import resource, runpy, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (%d, %d))
sys.argv = ["dl2c", *sys.argv[1:]]
runpy.run_module("dl2c", run_name="__main__")
"""


WRITING = [
    ("sample", "example:waypoint", "--csv", "{out}/a.csv"),
    ("sample", "example:waypoint", "-n", "50", "--plot", "{out}/a.png"),
    ("rollout", "example:waypoint", "--episodes", "30", "--csv", "{out}/a.csv"),
    ("build", "example:waypoint", "-o", "{out}"),
    ("monitor", "example:waypoint", "-o", "{out}/monitor"),
    ("annotate", "example:waypoint", "-o", "{out}/a.kyx"),
]


@pytest.mark.parametrize("words", quick_among(WRITING, WRITING[::3]), ids=lambda words: words[0])
def test_a_full_disk_is_one_line_and_leaves_nothing(words: tuple[str, ...], tmp_path: Path) -> None:
    """The limit is one of the size of files."""
    assert ran("build", "example:waypoint", "-o", tmp_path / "before").returncode == 0
    out = tmp_path / "out"
    most = 3000
    given = [w.format(out=out) for w in words]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", LIMIT % (most, most), *given],
        capture_output=True, text=True, timeout=300, check=False, env=environment,
    )  # fmt: skip
    refused(done, "File too large", str(out))
    assert not out.exists()


def test_an_unwritable_place_is_one_line() -> None:
    refused(ran("build", "example:waypoint", "-o", "/proc/nowhere"), "/proc/nowhere")
    refused(ran("sample", "example:waypoint", "--csv", "/dev/full"), "No space left", "/dev/full")
    with Path("/dev/full").open("w") as full:
        command = [*COMMAND, "info", "example:waypoint"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, cwd=ROOT)
    assert done.returncode == 1 and "No space left" in done.stderr and "Exception" not in done.stderr


HEEDING = """
import runpy, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
runpy.run_module("dl2c", run_name="__main__", alter_sys=True)
"""
"""Processes in the background of a shell ignore interruptions."""


@pytest.mark.parametrize("delay", [0.02, 0.3, 1.0, 4.0])
def test_an_interruption_is_one_line(delay: float, tmp_path: Path) -> None:
    """Also while most modules are imported; before that Python itself tells, in its own words."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DL2C_CACHE_DIR": str(tmp_path / "cache")}
    count = "1000000" if delay >= 0.3 else "1000"  # an interruption before all else has begun may be lost
    words = ["sample", "example:waypoint", "-n", count, "--csv", str(tmp_path / "a.csv")]
    command = [sys.executable, "-c", HEEDING, *words]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stderr=pipe, stdout=pipe, text=True, env=environment)
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert "dl2c/cli.py" not in said and "dl2c/commands" not in said, said
    if delay >= 4 or process.returncode == 130:
        assert (process.returncode, said.splitlines()[-1:]) == (130, ["interrupted"]), said
    assert process.returncode == 0 or not (tmp_path / "a.csv").exists()
    assert not list(tmp_path.glob(".dl2c*"))


# The budget --------------------------------------------------------------------


@pytest.mark.parametrize("size", [12, 14, 16])
def test_coupled_linear_equalities_are_eliminated(size: int) -> None:
    """Substituted terms grew exponentially: 16 of them took more than two minutes."""
    source = Source.read(shared("findings") / "models" / f"eqlin{size}.kyx")
    began = time.process_time()
    try:
        check_model(source, dl2c.pipeline.resolve_options({"default_bound": "-10:10"}))
    except CompileError as problem:
        assert {d.code for d in problem.diagnostics} == {"unsatisfiable-precondition"}
    assert time.process_time() - began < 20


def test_what_takes_too_much_work_is_told_with_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dl2c.work.SECONDS", 0.0)
    monkeypatch.setattr("dl2c.work.CALLS", 0)
    with pytest.raises(CompileError) as problem:
        dl2c.build("example:passive_safety", max_episode_steps=77)
    (found,) = problem.value.diagnostics
    assert found.code == "too-much-work" and found.span.source.text


def test_many_mistakes_are_told_quickly(tmp_path: Path) -> None:
    """8000 unknown attributes took a minute."""
    path = tmp_path / "m.kyx"
    attributes = ", ".join(f"a{i}=1" for i in range(8000))
    path.write_text(
        f'Theorem "a" ProgramVariables\n /* @var: {attributes} */ Real x; End. '
        "Problem x>=0 -> [x:=1;]x>=0 End. End.\n",
        encoding="utf-8",
    )
    began = os.times().children_user
    done = ran("check", path)
    assert done.returncode == 1 and "... and 7900 more" in done.stderr
    assert os.times().children_user - began < 15


# Readers -----------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    ["algo: 2001-13-45", "steps: " + "9" * 5000, "hyper: " + "[" * 3000, "\ufeff: : :", "algo: \x00"],
    ids=["no date", "many digits", "deep", "mark", "zero"],
)
def test_settings_that_are_none_raise_one_error(text: str, tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TrainingError) as problem:
        read_configuration(path)
    assert len(str(problem.value)) < 1000


def test_settings_have_few_aliases(tmp_path: Path) -> None:
    """Aliases of aliases filled a gigabyte."""
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    lines += [f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
    path = tmp_path / "c.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(TrainingError, match="aliases"):
        read_configuration(path)
    path.write_text(yaml.dump({"hyper": {"gamma": 0.5}}), encoding="utf-8")
    assert read_configuration(path) == {"hyper": {"gamma": 0.5}}


def test_wide_networks_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("hyper: {net_arch: [1000000000]}", encoding="utf-8")
    done = ran("train", "example:waypoint", "--config", path, "--steps", "100", "-o", tmp_path / "run")
    refused(done, "net_arch")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("text", ["dt = 2001-13-45", "dt = " + "9" * 5000, "dt = " + "[" * 3000])
def test_a_configuration_that_is_no_toml_is_told(text: str, tmp_path: Path) -> None:
    (tmp_path / "pyproject.toml").write_text(f"[tool.dl2c]\n{text}\n", encoding="utf-8")
    refused(ran("check", "example:waypoint", cwd=tmp_path), "pyproject.toml")


def test_odd_members_of_an_archive_are_no_arrays(tmp_path: Path) -> None:
    (tmp_path / "policy.json").write_text("{}", encoding="utf-8")
    member = b"\x93NUMPY\x01\x00\x46\x00{'descr': '<f8', 'fortran_order': False, 'shape': (True,), }".ljust(
        80
    )
    for name, content in {"weight_0": b"text", "weight_0.npy": member}.items():
        with zipfile.ZipFile(tmp_path / "policy.npz", "w") as archive:
            archive.writestr(name, content)
        with pytest.raises(PolicyError):
            read_policy(tmp_path / "policy.json")
    raw = bytearray((tmp_path / "policy.npz").read_bytes())
    raw[raw.index(b"PK\x01\x02") + 6] = 99
    (tmp_path / "policy.npz").write_bytes(raw)
    with pytest.raises(PolicyError):
        read_policy(tmp_path / "policy.json")


def test_a_manifest_without_options_is_none(tmp_path: Path) -> None:
    compiled = dl2c.build("example:waypoint")
    data = json.loads((compiled.directory / "manifest.json").read_text(encoding="utf-8"))
    del data["options"]["on_blocked"]
    (tmp_path / "manifest.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(NativeError, match="lack on_blocked"):
        Manifest.read(tmp_path / "manifest.json")


def test_a_pipe_is_no_model(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "m.kyx")
    refused(ran("check", tmp_path / "m.kyx"), "Not a regular file")


def test_a_compiler_that_sleeps_is_given_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(toolchain, "COMPILER_SECONDS", 1)
    began = time.monotonic()
    with pytest.raises(CompilerFailed, match="did not end"):
        toolchain.run(("sh", "-c", "sleep 300 & sleep 300"), tmp_path)
    assert time.monotonic() - began < 60


def test_a_home_of_nobody_is_told() -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DL2C_CACHE_DIR": "~nosuchuser/x"}
    done = subprocess.run(
        [*COMMAND, "build", "example:waypoint"],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip
    refused(done, "nosuchuser")


def test_odd_formats_and_counts_are_told(tmp_path: Path) -> None:
    refused(ran("sample", "example:waypoint", "-n", "50", "--plot", tmp_path / "x.xyz"), "x.xyz")
    refused(ran("sample", "example:waypoint", "-n", str(10**13)), "memory")
    (tmp_path / "long.csv").write_text("episode\n" + "x" * 200_000 + "\n", encoding="utf-8")
    refused(ran("monitor", "example:waypoint", "--check", tmp_path / "long.csv"), "long.csv")
    (tmp_path / "bad.csv").write_bytes(b"\xff\xfe")
    refused(ran("monitor", "example:waypoint", "--check", tmp_path / "bad.csv"), "bad.csv", "UTF-8")


def test_steps_are_checked_only_from_the_row_before(tmp_path: Path) -> None:
    """The first row of a trace was compared with the last one."""
    path = tmp_path / "t.csv"
    assert ran("rollout", "example:waypoint", "--csv", path, "--episodes", "2").returncode == 0
    rows = path.read_text(encoding="utf-8").splitlines()
    for kept in (rows[:1] + rows[2:], rows[:3] + rows[4:]):
        path.write_text("\ufeff" + "\n".join(kept) + "\n", encoding="utf-8")
        done = ran("monitor", "example:waypoint", "--check", path)
        assert done.returncode == 0, done.stdout
        assert "lacks the row before them: 1" in done.stdout
