"""Runs the tests in the source archives of Stable-Baselines3 and sb3-contrib on environments of dl2c.

They are fetched into `build/clients`, in the versions of this interpreter. `make test-clients` runs this.
"""

import os
import subprocess
import sys
import tarfile
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
BUILD = ROOT / "build" / "clients"

PROJECTS = ("stable-baselines3", "sb3-contrib")


def source_of(project: str) -> Path:
    """The unpacked archive."""
    exact = f"{project.replace('-', '_')}-{version(project)}"
    folder = BUILD / exact
    if not folder.is_dir():
        download = ["pip", "download", "-q", "--no-deps", "--no-binary", ":all:", "-d", str(BUILD)]
        subprocess.run([sys.executable, "-m", *download, f"{project}=={version(project)}"], check=True)
        with tarfile.open(BUILD / f"{exact}.tar.gz") as archive:
            archive.extractall(BUILD, filter="data")
    return folder


def run(project: str) -> int:
    """The exit status of its tests, which run in a folder without modules."""
    folder = source_of(project)
    work = BUILD / "work"
    work.mkdir(exist_ok=True)
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join((str(HERE), str(ROOT))),
        "OMP_NUM_THREADS": "1",
        "MPLBACKEND": "Agg",
        "CUDA_VISIBLE_DEVICES": "",
        "SDL_VIDEODRIVER": "dummy",
    }
    options = ["-q", "--tb=short", "-p", "shipped_plugin", "-p", "no:cacheprovider"]
    command = [
        sys.executable,
        "-m",
        "pytest",
        *options,
        "-c",
        str(folder / "pyproject.toml"),
        str(folder / "tests"),
    ]
    print(f"{project} {version(project)}", flush=True)
    return subprocess.run(command, cwd=work, env=environment, check=False).returncode


if __name__ == "__main__":
    BUILD.mkdir(parents=True, exist_ok=True)
    sys.exit(max([run(project) for project in PROJECTS]))
