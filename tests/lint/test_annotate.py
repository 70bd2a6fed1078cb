"""`dl2c annotate`: a copy that differs in comments only, and that can be built and learned in."""

import re
from pathlib import Path
from typing import Any

import pytest
from commands.test_cli import run
from conftest import shared
from selection import quick_among

import dl2c
import dl2c.cli
from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError
from dl2c.lint.check import examine
from dl2c.lint.edits import edited
from dl2c.lint.suggest import suggestions
from dl2c.options import Options
from dl2c.parse.parser import parse_archive
from dl2c.pipeline import Compilation, check_model
from dl2c.source import Source

ROOT = Path(__file__).resolve().parents[2]
MODELS = sorted((*(ROOT / "examples").rglob("*.kyx"), *(ROOT / "tests" / "good").glob("*.kyx")))
COMMENT = re.compile(r"[ \t]*/\* @[^*\n]*\*/\n|/\*\n@[^*\n]*\*/")
"""A suggested comment with its line, or one behind other text."""

BRAKE = """Theorem "brake"
Definitions Real A; Real B, m; Bool safe(Real x) <-> x <= m; End.
ProgramVariables
  Real x;
\tReal v; Real a; Real t;
End.

Problem
  A > 0 & B > 0 & B <= 4 & v >= 0 & v <= 1/3 & x + v^2 / (2 * B) <= m
    -> [{ {a := -B; ++ a := *; ?-B <= a & a <= A & v = 0;} t := 0;
           {x' = v, v' = a, t' = 1 & t <= 1 & v >= 0} }*]safe(x)
End.
End.
"""
DIAMOND = """Theorem "reach"
ProgramVariables Real x; Real y; End.
Problem
  x = 0 & y >= 12 -> <{x := x + 1;}*>x >= y
End.
End.
"""


def annotated(content: bytes, name: str = "m.kyx", **options: Any) -> bytes:
    text = content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    return edited(content, suggestions(Source(name, text), resolve_options(options)))


def without(content: bytes) -> bytes:
    """The content without suggested comments, in a file that had none."""
    return COMMENT.sub("", content.decode().replace("\r\n", "\n")).encode()


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_annotated_models_stay_as_they_are(path: Path) -> None:
    content = path.read_bytes()
    edits = suggestions(Source.read(path), Options())
    assert all(e.start == e.end and COMMENT.fullmatch(e.text) for e in edits)
    check_model(Source("copy.kyx", edited(content, edits).decode()), Options())


@pytest.mark.parametrize("path", quick_among(MODELS, MODELS[::4]), ids=lambda path: path.stem)
def test_models_are_annotated_anew(path: Path) -> None:
    """Without its comments every model gets annotations with which it builds."""
    plain = re.sub(r"/\*.*?\*/", "", path.read_text(encoding="ascii"), flags=re.S)
    plain = re.sub(r"//[^\n]*", "", plain).encode()
    copy = annotated(plain)
    assert copy != plain and without(copy) == plain
    built = Compilation(Source("copy.kyx", copy.decode()), Options())
    assert built.resolved.problem.annotated and built.planned.build.model.predicates
    assert {d.code for d in examine(Source("copy.kyx", copy.decode()), Options(), portable=True)} <= {
        "default-dt", "zero-duration", "deadlock", "agent-moves-world", "decision-in-loop",
        "unsampled-precondition", "safety-after-steps", "unobserved-variable", "keymaera-rejects",
    }  # fmt: skip


@pytest.mark.parametrize("text", [BRAKE, DIAMOND])
@pytest.mark.parametrize("ending", [b"\n", b"\r\n"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_removing_the_comments_restores_the_model(text: str, ending: bytes, mark: bytes) -> None:
    content = mark + text.encode().replace(b"\n", ending)
    copy = annotated(content)
    assert copy.count(ending) == copy.count(b"\n")
    assert without(copy) == content.replace(b"\r\n", b"\n") != copy
    plain = Source("copy.kyx", copy.decode("utf-8-sig").replace("\r\n", "\n"))
    assert examine(plain, Options(), portable=True) == ()


def test_suggestions_follow_the_precondition() -> None:
    copy = annotated(BRAKE.encode()).decode()
    assert "@const: bound=[0:10] */Real A" in copy
    assert "@const: bound=[-10:10] */Real B, m" in copy
    assert "\t/* @var: bound=[0:10] */\n\tReal v" in copy
    assert "@var: bound=[-10:10] */Real a" in copy and "*/Real t" not in copy
    assert "@safety: penalty=-1, on_failure=terminate:failure */Bool safe" in copy
    wide = annotated(BRAKE.encode(), default_bound="-0.25:0.25").decode()
    assert "\t/* @var: bound=[0:0.334] */\n\tReal v" in wide


def test_suggestions_are_what_a_person_would_write() -> None:
    """Clocks have short limits, and what invariant or domain exclude is left out."""
    text = (
        BRAKE.replace("t <= 1", "t <= ep")
        .replace("Real A;", "Real A, ep;")
        .replace("A > 0 &", "A > 0 & ep > 0 &")
    )
    assert (
        "@const: bound=[0.1:1] */Real ep"
        in annotated(text.replace("Real A, ep;", "Real A; Real ep;").encode()).decode()
    )
    kept = text.replace("}*]", "}*@invariant(v <= 5 & x >= 2)]")
    copy = annotated(kept.encode()).decode()
    assert "/* @var: bound=[0:5] */\n\tReal v" in copy and "/* @var: bound=[-10:10] */\n  Real x" in copy


def test_what_only_the_program_before_the_loop_sets_is_observed() -> None:
    text = DIAMOND.replace("<{x := x + 1;}*>", "<y := 3; {x := x + y;}*>").replace("& y >= 12 ", "")
    copy = annotated(text.encode()).decode()
    assert "bound=[-10:10] */Real y" in copy and examine(Source("m.kyx", copy), Options()) == ()


def test_the_diamond_becomes_progress() -> None:
    copy = annotated(DIAMOND.encode()).decode()
    assert "/* @progress: reward=1, on_success=terminate:success */\nProblem" in copy
    assert "@var: bound=[12:32] */Real y" in copy
    env = dl2c.make(copy)
    env.reset(seed=3)
    for _ in range(40):
        _, reward, terminated, _, info = env.step(env.action_space.sample())
        assert reward == float(terminated)
        if terminated:
            break
    assert info["is_success"] and info["reason"] == "progress" and info["time"] == 0


def test_conclusions_can_be_annotated_above_the_problem() -> None:
    both = "-> [{x := x + 1;}*]x <= y + 1 & <{x := x + 1;}*>x >= y"
    note = (
        "/* @safety: penalty=-7, shape={10 - x}, on_failure=truncate:failure */\n"
        "/* @progress: reward={x} */\nProblem"
    )
    text = DIAMOND.replace("-> <{x := x + 1;}*>x >= y", both).replace("Problem", note)
    model = Compilation(Source("m.kyx", text), resolve_options({"default_bound": "0:20"}))
    safety, progress = model.lowered.model.predicates
    assert (safety.name, safety.category, progress.name, progress.category) == (
        "postcondition", "safety", "progress", "progress",
    )  # fmt: skip
    assert safety.shape is not None and safety.on_failure is not None and progress.reward is not None


@pytest.mark.parametrize(
    ("note", "code"),
    [
        ("/* @safety: penalty=-1 */", "misplaced-annotation"),
        ("/* @progress: reward=1 */ /* @progress: reward=2 */", "repeated-annotation"),
        ("/* @stability: shape={x} */", "misplaced-annotation"),
        ("/* @progress: reward=z */", "undeclared-variable"),
    ],
)
def test_wrong_annotations_of_the_problem_are_explained(note: str, code: str) -> None:
    with pytest.raises(CompileError) as refused:
        check_model(Source("m.kyx", DIAMOND.replace("Problem", note + "\nProblem")), Options())
    assert [d.code for d in refused.value.diagnostics] == [code]


def test_what_the_program_afterwards_changes_cannot_be_a_predicate() -> None:
    text = DIAMOND.replace("*>x", "*; x := 0;>x").replace("Problem", "/* @progress: reward=1 */\nProblem")
    with pytest.raises(CompileError, match="a program after the loop is not run"):
        check_model(Source("m.kyx", text), Options())


def test_the_command_writes_bytes(capsys: Any, tmp_path: Path) -> None:
    path, copy = tmp_path / "brake.kyx", tmp_path / "copy.kyx"
    path.write_bytes(BRAKE.replace("\n", "\r\n").encode())
    assert run(capsys, "annotate", str(path), "-o", str(copy)) == (
        0,
        f"{copy}\n",
        f"note: {dl2c.cli.NO_GOAL}\n",
    )
    assert copy.read_bytes() == annotated(path.read_bytes())
    assert run(capsys, "check", "--portable", str(copy))[0] == 0
    code, out, _ = run(capsys, "annotate", "example:acc")
    assert code == 0 and out == (ROOT / "examples" / "acc.kyx").read_text()
    path.write_text("no model\n")
    assert run(capsys, "annotate", str(path))[0] == 1


@pytest.mark.slow
def test_public_models_are_annotated() -> None:
    """The first entries of files that are read; those that cannot be built are refused."""
    done = 0
    for path in sorted(shared("corpus").rglob("*.kyx"))[::7]:
        content = path.read_bytes()
        try:
            archive, _ = parse_archive(Source.read(path))
        except CompileError:
            continue
        for entry in archive.entries[:3]:
            try:
                copy = annotated(content, path.name, entry=entry.name)
            except CompileError:
                continue
            assert without(copy) == content.replace(b"\r\n", b"\n"), path
            done += copy != content
    assert done >= 5
