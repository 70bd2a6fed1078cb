"""`dl2c play`: what it writes, and what it refuses."""

import importlib.util
from pathlib import Path

import pytest
from play.pages import needs_zig
from typer.testing import CliRunner

from dl2c.cli import app
from dl2c.diagnostics import CompileError
from dl2c.env.opening import source_of
from dl2c.play.build import DOPRI5, playable
from dl2c.version import install

STIFF = """ArchiveEntry "Stiff"
Definitions
  /* @const: bound=[1:100000] */
  Real k;
End.
ProgramVariables
  /* @var: bound=[0:1] */
  Real x;
  Real y;
  Real t;
End.
Problem
  k > 0 & x >= 0 & y = 0 -> [{ t := 0; {x' = -k * x + y, y' = x - k * y, t' = 1 & t <= 1} }*] x >= 0
End.
End.
"""


def test_what_is_stiff_is_refused_with_its_place(tmp_path: Path) -> None:
    model = tmp_path / "stiff.kyx"
    model.write_text(STIFF, encoding="utf-8")
    done = CliRunner().invoke(app, ["play", str(model), "-o", str(tmp_path / "page.html")])
    assert done.exit_code == 1 and not (tmp_path / "page.html").exists()
    with pytest.raises(CompileError) as refused:
        playable(source_of(str(model)), {})
    [found] = refused.value.diagnostics
    assert found.code == "play-stiff" and found.span.text.startswith("{x' =") and "dl2c rollout" in found.help


def test_without_zig_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n == "ziglang" else found(n))
    done = CliRunner().invoke(app, ["play", "example:watertank", "-o", str(tmp_path / "page.html")])
    assert done.exit_code == 1 and install("zig") in str(done.exception)
    assert not (tmp_path / "page.html").exists()


@needs_zig
def test_a_page_says_which_integrator_it_has() -> None:
    made = playable(source_of("example:pendulum"), {})
    assert made.notes == (DOPRI5,) and made.manifest.options["integrator"] == "dopri5"
