"""Compiled models under sanitizers: no hostile caller makes them read or write where they must not."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from differential import environment_of
from generators.random_models import random_model

import dl2c
from dl2c.configuration import resolve_options
from dl2c.emit.names import file_stem
from dl2c.emit.simulator.model_c import model_sources
from dl2c.native import cgen_dir
from dl2c.native.toolchain import EXACT_FLAGS
from dl2c.pipeline import Compilation
from dl2c.source import Source

HERE = Path(__file__).resolve().parents[1]
HARNESS = HERE / "sanitized" / "hostile_steps.c"
MODELS = [HERE.parent / "examples" / "waypoint.kyx", *sorted((HERE / "good").glob("*.kyx"))][:3]
RANDOM = [m for seed in range(200, 260) if environment_of(m := random_model(seed)) is not None][:5]

SANITIZERS = {"address": "address,undefined", "thread": "thread"}
FLAGS = ("-std=c11", "-g", "-fno-trapping-math", "-fno-math-errno", "-fno-sanitize-recover=all")


def sources(folder: Path) -> list[Path]:
    """The generated C of all models, each in one file."""
    made: list[Path] = []
    given = [Compilation(Source.read(model), resolve_options({})).planned.build for model in MODELS]
    for build in (*given, *map(environment_of, RANDOM)):
        assert build is not None
        for name, text in model_sources(build).items():
            (folder / name).write_text(text, encoding="utf-8")
        made.append(folder / f"{file_stem(build.model.name)}.c")
    return made


def sanitized(compiler: str, sanitizer: str, source: Path, folder: Path, level: str) -> Path:
    """The harness around one model; skips where the compiler lacks the sanitizer."""
    program = folder / f"{source.stem}-{sanitizer}"
    includes = [f"-I{cgen_dir() / 'include'}", f"-I{cgen_dir() / 'runtime'}", f"-I{folder}"]
    defined = [f'-DMODEL="{source.name}"', "-DDL2C_NO_TARGET_CLONES"]
    command = [
        compiler,
        level,
        *FLAGS,
        *EXACT_FLAGS,
        f"-fsanitize={SANITIZERS[sanitizer]}",
        *includes,
        *defined,
    ]
    command += [str(HARNESS), "-o", str(program), "-lm", "-pthread"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if re.search(r"cannot find.*[atu]+san|unsupported option.*sanitize|libclang_rt", done.stderr):
        pytest.skip(f"{compiler} lacks the {sanitizer} sanitizer")
    assert done.returncode == 0, done.stderr[:3000]
    return program


def run(program: Path, how: str) -> None:
    done = subprocess.run([str(program), how], capture_output=True, text=True, check=False, timeout=500)
    if "unexpected memory mapping" in done.stderr or "ptrace" in done.stderr:
        pytest.skip(f"the sanitizer does not work on this system: {done.stderr.splitlines()[0]}")
    assert done.returncode == 0, f"{program.name}: {done.stderr[:3000]}"


@pytest.mark.parametrize(("sanitizer", "how"), [("address", "short"), ("thread", "threads")])
def test_hostile_callers_do_no_harm(sanitizer: str, how: str, tmp_path: Path) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    for source in [s for s in sources(tmp_path) if s.stem in ("waypoint", "tank", RANDOM[0].name)]:
        run(sanitized("gcc", sanitizer, source, tmp_path, "-O0"), how)


@pytest.mark.slow
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize(("sanitizer", "how"), [("address", "long"), ("thread", "threads")])
def test_many_hostile_callers_do_no_harm(compiler: str, sanitizer: str, how: str, tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    for source in sources(tmp_path):
        run(sanitized(compiler, sanitizer, source, tmp_path, "-O1"), how)


@pytest.mark.usefixtures("unoptimised")
def test_inputs_that_are_no_numbers_mean_an_end() -> None:
    """NaN means the lowest admissible value, anything beyond an end that end."""
    library = dl2c.load(dl2c.build(HERE / "good" / "tank.kyx").directory)
    batch = library.batch(5)
    batch.reset(seeds=np.full(5, 3, np.uint64))
    batch.inputs[:, 0] = [np.nan, -np.inf, -1e308, np.inf, 1e308]
    batch.step()
    low, high = batch.executed_inputs[0, 0], batch.executed_inputs[3, 0]
    assert np.isfinite(batch.obs).all() and low < high
    assert batch.executed_inputs[:, 0].tolist() == [low, low, low, high, high]
    assert not batch.blocked.any()


def test_choices_that_do_not_exist_block() -> None:
    """A choice out of range requests a run that does not exist: another one is taken, and it is said."""
    library = dl2c.load(dl2c.build(MODELS[0]).directory)
    odd = np.array([-1, 127, 128, 255, 65536, 2**31 - 1, -(2**31)], np.int32)
    batch = library.batch(len(odd))
    batch.reset(seeds=np.full(len(odd), 3, np.uint64))
    batch.choices[:, 0] = odd
    batch.step()
    assert batch.blocked.all() and len({tuple(row) for row in batch.obs.tolist()}) == 1
    alternatives = len(library.manifest.choices[0].alternatives)
    assert ((batch.executed_choices >= 0) & (batch.executed_choices < alternatives)).all()
