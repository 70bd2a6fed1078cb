"""Networks that others verified: the answers that were published."""

import os
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path

import pytest
from conftest import shared

from dl2c.commands.policy import Asked, report_on
from dl2c.policy_proof.verdict import PolicyReport

pytest.importorskip("onnx")

RETRAINED = "acc-2000000-64-64-64-64-retrain-100000-200000-0.9"
FALLBACK = "rVel <= 0.1 & rVel >= -2.1 & rPos <= 0.08"

ANNOTATED = {
    "  Real rPos;": "  /* @var: bound=[0:100] */\n  Real rPos;",
    "  Real rVel;": "  /* @var: bound=[-200:200] */\n  Real rVel;",
    "  Real rAcc;": "  Real rAcc;\n  Real c;",
    "        }*\n": "        }*@invariant(rPos > rVel^2 / (2*A))\n",
}
"""The model's clock is declared, and it says what was asked of the networks."""

PUBLISHED = ANNOTATED | {
    "        }*\n": "        }*@invariant(rPos > 0 & rPos >= rVel^2/(2*A))\n",
    "(rPos - rVel^2/rAcc + rVel^2/(2*rAcc)) > 0": "rPos*rAcc - rVel^2 + rVel^2/2 > 0",
}
"""The question of acc.formula: a condition of the model is multiplied by rAcc, whatever its sign is."""


def asked_of(
    tmp_path: Path, name: str, arithmetic: str, outside: str = "", edits: Mapping[str, str] = ANNOTATED
) -> PolicyReport:
    text = (shared("oracle/n3v") / "acc.kyx").read_text(encoding="utf-8")
    for old, new in edits.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    (tmp_path / "acc.kyx").write_text(text)
    given = Asked(
        shared("oracle/n3v") / f"{name}.onnx",
        arithmetic,
        "rPos,rVel",
        ("rAcc=-100:100",),
        outside,
        ("A=100", "B=100", "T=0.1"),
        120,
        min(2, os.cpu_count() or 1),
    )
    return report_on(str(tmp_path / "acc.kyx"), given, {})


@pytest.mark.parametrize("arithmetic", ["real", pytest.param("double", marks=pytest.mark.slow)])
def test_safe_outside_the_fallback(tmp_path: Path, arithmetic: str) -> None:
    report = asked_of(tmp_path, RETRAINED, arithmetic, FALLBACK)
    assert report.answer == "proved" and not report.warnings


@pytest.mark.parametrize("arithmetic", ["real", "double"])
@pytest.mark.parametrize("name", [RETRAINED, "acc-2000000-64-64-64-64", "acc-3000000-64-64"])
def test_unsafe_without_a_fallback(tmp_path: Path, name: str, arithmetic: str) -> None:
    report = asked_of(tmp_path, name, arithmetic)
    assert report.answer == "refuted" and report.violation is not None
    position, velocity = (report.violation.state[n] for n in ("rPos", "rVel"))
    asked = report.violation.requests["rAcc"]
    assert position > velocity**2 / 200 and -100 <= asked < 100
    after = position + velocity / 10 + asked / 200, velocity + asked / 10
    turns = asked != 0 and 0 <= -velocity / asked <= velocity.__class__(1, 10)
    low = position - velocity**2 / (2 * asked) if turns else after[0]
    assert after[0] <= after[1] ** 2 / 200 or low <= 0


@pytest.mark.parametrize("arithmetic", ["real", "double"])
def test_the_published_formula_asks_for_more_than_the_model(tmp_path: Path, arithmetic: str) -> None:
    """The network that is safe by the model brakes where the formula has the wrong sign."""
    report = asked_of(tmp_path, RETRAINED, arithmetic, f"{FALLBACK} | rVel = 0", PUBLISHED)
    assert report.answer == "refuted" and report.violation is not None
    position, velocity = (Fraction(report.violation.state[n]) for n in ("rPos", "rVel"))
    asked, time = Fraction(report.violation.requests["rAcc"]), Fraction(1, 10)
    assert position > 0 and position >= velocity**2 / 200 and velocity != 0
    assert not (-2.1 <= velocity <= 0.1 and position <= 0.08)
    stops = position + velocity * time + asked * time**2 / 2 > (velocity + asked * time) ** 2 / 200
    turns = 0 <= -velocity / asked <= time
    assert -100 <= asked < 0 and turns and position * asked - velocity**2 / 2 <= 0  # the formula is false
    assert stops and position - velocity**2 / (2 * asked) > 0  # the model's condition is true
