"""The example programs run, with few steps."""

import runpy
from pathlib import Path
from typing import Any

import pytest
from selection import quick_among

FOLDER = Path(__file__).resolve().parent.parent / "examples"

LAST_LINE = {
    "train_ppo": "reach the goal area in time",
    "train_maskable_ppo": ": ",
    "train_torch": "steps/s",
    "train_lagrangian": "constrained: cost per episode",
    "tune": "mean return",
}
ARGUMENTS = {
    "train_ppo": "4096",
    "train_maskable_ppo": "8192",
    "train_torch": "16384",
    "train_lagrangian": "3840",
    "tune": f"{FOLDER}/watertank.kyx -o tuned.yaml --trials 2 --steps 2048",
}


def test_every_program_is_run() -> None:
    assert {path.stem for path in FOLDER.glob("*.py")} == set(ARGUMENTS)


@pytest.mark.parametrize("name", quick_among(ARGUMENTS, ("train_torch", "train_lagrangian")))
def test_an_example_runs(name: str, capsys: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("optuna" if name == "tune" else "sb3_contrib")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [f"{name}.py", *ARGUMENTS[name].split()])
    runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    said = capsys.readouterr().out.splitlines()
    assert LAST_LINE[name] in said[-1]
    if name in ("train_maskable_ppo", "train_torch"):
        assert not [line for line in said if "violations" in line and "violations 0.0%" not in line]
