"""What an installed dl2c consists of: the wheel, the way over an sdist, and a checkout."""

import json
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

from dl2c.version import __version__

ROOT = Path(__file__).resolve().parent.parent

SHIPPED = {
    "cgen": {".c", ".h", ".md"},
    "examples": {".kyx", ".py", ".md"},
}
"""Folders of the checkout that the wheel holds inside the package, and what of them counts."""


def run(*command: str | Path, cwd: Path) -> str:
    result = subprocess.run(
        [sys.executable, *map(str, command)], cwd=cwd, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout.strip()


def wheel_of(source: Path, directory: Path) -> Path:
    options = ("--no-build-isolation", "--no-deps", "--no-index", "-q")
    run("-m", "pip", "wheel", *options, "-w", directory, source, cwd=directory)
    return next(directory.glob("dl2c-*.whl"))


def names(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def expected() -> set[str]:
    """Every source file that has to be in a wheel, as the wheel names it."""
    suffixes = {".py", ".lark", ".cdef", ".typed", ".html", ".css", ".js"}
    package = [p for p in (ROOT / "dl2c").rglob("*") if p.suffix in suffixes]
    found = {p.relative_to(ROOT).as_posix() for p in package}
    for folder, wanted in SHIPPED.items():
        files = [p for p in (ROOT / folder).rglob("*") if p.suffix in wanted]
        found |= {f"dl2c/{p.relative_to(ROOT).as_posix()}" for p in files}
    return found


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return wheel_of(ROOT, tmp_path_factory.mktemp("wheel"))


def test_wheel_holds_everything_and_nothing_else(wheel: Path) -> None:
    inside = {name for name in names(wheel) if ".dist-info/" not in name}
    assert expected() <= inside | {"dl2c/py.typed"} and "dl2c/py.typed" in inside
    assert not [name for name in inside if not name.startswith("dl2c/") or "__pycache__" in name]
    for needed in ("dl2c/cgen/include/dl2c.h", "dl2c/parse/grammar.lark", "dl2c/native/dl2c.cdef"):
        assert needed in inside


def test_wheel_names_its_command_and_licence(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        texts = {
            name.split("/", 1)[1]: archive.read(name).decode()
            for name in names(wheel)
            if ".dist-info/" in name
        }
    assert "dl2c = dl2c.__main__:main" in texts["entry_points.txt"]
    assert "License-Expression: MIT AND MIT-0" in texts["METADATA"]
    assert "MIT License" in texts["licenses/LICENSE"] and "licenses/THIRD_PARTY.md" in texts
    assert "MIT No Attribution" in texts["licenses/cgen/LICENSE"]


def test_wheel_of_the_sdist_is_the_same(wheel: Path, tmp_path: Path) -> None:
    run("-m", "hatchling", "build", "-t", "sdist", "-d", tmp_path, cwd=ROOT)
    again = wheel_of(next(tmp_path.glob("dl2c-*.tar.gz")), tmp_path)
    assert names(again) == names(wheel)


def test_hand_written_c_is_found_from_anywhere(wheel: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    code = "import sys; sys.path.insert(0, sys.argv[1]); from dl2c.native import cgen_dir; print(cgen_dir())"
    for installed, where in ((tmp_path / "site", "dl2c/cgen"), (ROOT, "cgen")):
        found = Path(run("-c", code, installed, cwd=tmp_path))
        assert found == installed / where and (found / "include" / "dl2c.h").is_file()


def test_an_installed_wheel_builds_its_examples(wheel: Path, tmp_path: Path) -> None:
    """What `pip install .` and `pipx install .` give: the command, the examples, the runtime in C.

    The libraries dl2c needs come from this interpreter, so that nothing is fetched.
    """
    venv.create(tmp_path / "venv")
    python = tmp_path / "venv" / "bin" / "python"
    run("-m", "pip", "--python", python, "install", "-q", "--no-deps", "--no-index", wheel, cwd=tmp_path)
    (site,) = (tmp_path / "venv").glob("lib/python*/site-packages")
    (site / "others.pth").write_text(f"{sysconfig.get_path('purelib')}\n")

    def dl2c(*arguments: str) -> str:
        environment = os.environ | {"DL2C_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": ""}
        command = [tmp_path / "venv" / "bin" / "dl2c", *arguments]
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert dl2c("--version") == f"dl2c {__version__}\n"
    ends = json.loads(dl2c("rollout", "example:watertank", "--max-episode-steps", "5", "--json"))
    assert ends["steps"] == 5
    assert next(site.glob("dl2c/py.typed"), None) is not None


def test_an_editable_install_copies_nothing(tmp_path: Path) -> None:
    """But for a path to the checkout: a copy would be a package without code, and become old."""
    code = "import hatchling.build, sys; print(hatchling.build.build_editable(sys.argv[1]))"
    name = run("-c", code, tmp_path, cwd=ROOT)
    inside = {name for name in names(tmp_path / name.splitlines()[-1]) if ".dist-info/" not in name}
    assert inside == {"_dl2c.pth"}
