"""Whatever a model says, it is built or refused with a place: soon, in bounded memory, and without harm."""

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

import pytest
from hostile.cases import CASES, Case, mutated
from selection import quick_among

from dl2c.interval.rounding import root_down, root_up
from dl2c.options import Options
from dl2c.pipeline import step_model
from dl2c.smt.precondition import Unknown, decide, diagnose
from dl2c.source import Source

ROOT = Path(__file__).resolve().parent.parent
MODELS = [ROOT / "examples" / "waypoint.kyx", *sorted((ROOT / "tests" / "good").glob("*.kyx"))]

LIMIT = 60.0
"""Seconds for one file on a busy machine; Z3 alone may take ten."""


LONG = {
    *("annotation_lines", "comment_openers", "doubling_loops", "doubling_predicates", "doubling_terms"),
    *("hard_for_z3", "implicit_many", "implicit_uses", "large_body_used_often", "long_choice"),
    *("long_sequence", "long_values", "many_branches", "names", "old_bare_ends", "old_lines_of_sorts"),
    *("old_sorts", "parentheses", "parentheses_open"),
}
"""Cases that are refused, but late. Each diagnostic that ends one of them ends a quick case too, but for
`implicit-function`.
"""

BUILT = {
    *("comment_trigraph", "entry_runtime_header", "line_ends_cr", "names_long", "old_plain"),
    *("number_below_doubles", "powers_in_domain", "predicate_int", "variable_EDOM"),
}
"""Quick ones of the cases that are built, each by a compiler: of every kind of text one."""

QUICK = [c for c in CASES if (c.name in BUILT if c.expected == "builds" else c.name not in LONG)]


class Checker:
    """A process of its own that reads models, so that one that hangs can be stopped."""

    def __init__(self, cache: Path) -> None:
        environment = os.environ | {
            "DL2C_CACHE_DIR": str(cache),
            "CFLAGS": "-O0 -DDL2C_NO_TARGET_CLONES",
            "PYTHONPATH": str(ROOT),
        }
        script = [sys.executable, str(ROOT / "tests" / "hostile" / "checker.py")]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(script, stdin=pipe, stdout=pipe, cwd=ROOT, env=environment)

    def ask(self, task: str, path: Path) -> tuple[list[str], bool]:
        """Codes of the diagnostics, or `builds`; and whether all have a place."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(f"{task} {path}\n".encode())
        self.process.stdin.flush()
        ready, _, _ = select.select([self.process.stdout], [], [], LIMIT)
        assert ready, f"{path.name} takes more than {LIMIT} seconds"
        line = self.process.stdout.readline()
        assert line, f"{path.name} kills the process"
        found = json.loads(line)
        return found["codes"], found["located"]


@pytest.fixture
def checker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Checker]:
    made = RUNNING.get("checker")
    if made is None or made.process.poll() is not None:
        made = RUNNING["checker"] = Checker(tmp_path_factory.mktemp("hostile-cache"))
    yield made


RUNNING: dict[str, Checker] = {}


@pytest.fixture(scope="module", autouse=True)
def _stop() -> Iterator[None]:
    yield
    for made in RUNNING.values():
        made.process.kill()
        made.process.wait()
    RUNNING.clear()


@pytest.mark.parametrize(
    "case",
    quick_among(CASES, QUICK),
    ids=lambda case: case.name,
)
def test_hostile_models_are_built_or_refused(case: Case, checker: Checker, tmp_path: Path) -> None:
    path = tmp_path / f"{case.name}.kyx"
    path.write_bytes(case.content)
    codes, located = ask(checker, "build" if case.expected == "builds" else "check", path)
    assert case.expected in codes and located, codes


def test_file_names_do_no_harm(checker: Checker, tmp_path: Path) -> None:
    plain = next(case for case in CASES if case.name == "comment_end")
    for name in ("*\\ %s %n #.kyx", "a?? \t b.kyx", "$(touch harm) ; `id` & \u202e.kyx", "-o.kyx"):
        path = tmp_path / name
        path.write_bytes(plain.content)
        assert ask(checker, "build", path) == (["builds"], True)
    assert not list(tmp_path.glob("harm"))


def ask(checker: Checker, task: str, path: Path) -> tuple[list[str], bool]:
    try:
        return checker.ask(task, path)
    except AssertionError:
        checker.process.kill()
        checker.process.wait()
        raise


def test_z3_is_asked_only_what_it_can_read_and_stops_in_time() -> None:
    case = {case.name: case.text for case in CASES}
    large, _ = step_model(Source("large.kyx", str(case["powers_in_precondition"])), Options())
    hard, _ = step_model(Source("hard.kyx", str(case["hard_for_z3"])), Options())
    start = time.monotonic()
    decisions = [decide(model, timeout_s=0.5) for model in (large, hard)]
    assert time.monotonic() - start < 10
    reasons = [d.reason for d in decisions if isinstance(d, Unknown)]
    assert len(reasons) == 2 and "too large for Z3" in reasons[0] and "gave up" in reasons[1]
    assert "not known" in diagnose(decisions[1]).title  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("degree", [3, 7, 64])
@pytest.mark.parametrize("value", [5e-324, 1e-310, 1e-300, 1.0, 1e300])
def test_roots_of_the_smallest_numbers_are_found(value: float, degree: int) -> None:
    below, above = root_down(value, degree), root_up(value, degree)
    assert Fraction(below) ** degree <= Fraction(value) <= Fraction(above) ** degree
    assert above - below < 0.02 * above


def check_mutations(checker: Checker, seeds: Sequence[int], folder: Path) -> None:
    known = {"builds": 0, "refused": 0}
    for seed in seeds:
        path = folder / "mutated.kyx"
        path.write_bytes(mutated(MODELS[seed % len(MODELS)].read_bytes(), seed))
        codes, located = ask(checker, "check", path)
        assert located and all(" " not in code for code in codes), f"seed {seed}: {codes}"
        known["builds" if codes[0] == "builds" else "refused"] += 1
    assert min(known.values()) > 0


def test_mutated_models_are_read_or_refused(checker: Checker, tmp_path: Path) -> None:
    check_mutations(checker, range(30), tmp_path)


@pytest.mark.slow
def test_many_mutated_models_are_read_or_refused(checker: Checker, tmp_path: Path) -> None:
    check_mutations(checker, (*range(30, 60), *range(1000, 3000)), tmp_path)
