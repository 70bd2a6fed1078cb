"""`[tool.dl2c]` of a project: what it is worth against the other ways to give an option, and its mistakes."""

import json
import pickle
import re
import tomllib
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from commands.test_cli import run

import dl2c
from dl2c.configuration import NAMES, configured, resolve_options
from dl2c.diagnostics import CompileError
from dl2c.options import Options
from dl2c.pipeline import check_model, emit
from dl2c.source import Source

ROOT = Path(__file__).resolve().parent.parent

MODEL = """Theorem "count"
Definitions
  /* @const: bound=[1:2] */
  Real k;
  /* @const: bound=[1:2] */
  Real l;
  /* @safety: penalty=-1 */
  Bool small(Real x) <-> x <= 10;
End.
ProgramVariables
  /* @var: bound=[0:1] */
  Real x;
  Real t;
End.
{episode}
Problem
  k > 0 & l > 0 -> [{{ t := 0; {{x' = k * l, t' = 1 & t <= 1}} }}*]small(x)
End.
End.
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Writes a pyproject.toml and makes a folder inside its project the working folder."""
    inside = tmp_path / "a" / "b"
    inside.mkdir(parents=True)
    monkeypatch.chdir(inside)

    def write(text: str) -> Path:
        path = tmp_path / "pyproject.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def diagnostics(write: Any, text: str) -> list[tuple[int, int, str, str, str]]:
    """Line, column and text of each mistake, its title and its advice."""
    path = write(text)
    with pytest.raises(CompileError) as raised:
        configured(Options())
    found = raised.value.diagnostics
    assert {(d.code, d.span.source.name) for d in found} == {("configuration", str(path))}
    return [(d.span.line, d.span.column, d.span.text, d.title, d.help) for d in found]


def test_the_command_line_wins_over_episode_wins_over_the_file(project: Any) -> None:
    project("[tool.dl2c]\nmax_episode_steps = 7\nstall_limit = 8\non_blocked = 'terminate'\n")
    text = MODEL.format(episode="/* @episode: max_steps=70, stall_limit=80 */")
    options = resolve_options({"stall_limit": 800})
    compiled = emit(Source("m.kyx", text), "c", options)
    assert options.on_blocked == "terminate"
    library = dl2c.build(text, stall_limit=800).library
    shown = library.manifest.options
    assert (shown["max_episode_steps"], shown["stall_limit"], shown["on_blocked"]) == (70, 800, "terminate")
    assert compiled


def test_every_option_can_be_configured(project: Any) -> None:
    defaults = Options()
    project(
        "[tool.dl2c]\ndefault_bound = [-10, 0.1]\n"
        "dt = 0.1\ntolerance = 1e-6\nprogress_failure = 'literal'\nobserve_constants = false\n"
        "obs_dtype = 'float64'\nobservation_bounds = 'unbounded'\naction_format = 'box'\n"
        "action_map = 'squash'\non_blocked = 'truncate'\nblocked_penalty = -2.5\nmax_episode_steps = 3\n"
        "stall_limit = 4\nnative = true\ndebug = true\nmonitor_every_step = true\nduration = 'sample'\n"
        "safety_check = 'step'\nmask_depth = 'step'\nmax_flow = 20\nintegrator = 'cvodes'\n"
        "stiff = 'true'\ninitial_distribution = 'z3'\nrtol = 1e-6\natol = 1e-8\nsundials = 'system'\n"
        "loop = 2\nmax_loop = 5\nmax_repeat = 3\n[tool.dl2c.constants]\nk = 0.3\n"
    )
    found = configured(defaults)
    assert [n for n in NAMES if getattr(found, n) == getattr(defaults, n)] == []
    assert found.default_bound == (-10, Fraction(1, 10))
    assert (found.dt, found.tolerance) == (Fraction(1, 10), Fraction(1, 10**6))
    assert found.constants == (("k", Fraction(3, 10)),)
    assert found.given == frozenset()


def test_constants_are_fixed_one_by_one(project: Any) -> None:
    project("[tool.dl2c]\nconstants = { k = 1.5, l = 2 }\n")
    assert dict(resolve_options({}).constants) == {"k": Fraction(3, 2), "l": 2}
    assert dict(resolve_options({"constants": {"l": "1.2"}}).constants) == {
        "k": Fraction(3, 2),
        "l": Fraction(6, 5),
    }


def test_only_the_nearest_file_counts(project: Any, tmp_path: Path) -> None:
    project("[tool.dl2c]\nstall_limit = 1\n")
    assert configured(Options()).stall_limit == 1
    assert configured(Options(), tmp_path).stall_limit == 1
    (tmp_path / "a" / "pyproject.toml").write_text("[project]\n")
    assert configured(Options()) == Options()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "[tool.dl2c]\non-blocked = 1\n",
            (2, 1, "on-blocked", "no option `on-blocked`", "did you mean `on_blocked`?"),
        ),
        ("[tool.dl2c]\nentry = 'x'\n", (2, 1, "entry", "no option `entry`", "the options are action_format")),
        (
            "[tool]\ndl2c.stal_limit = 1\n",
            (2, 1, "dl2c.stal_limit", "no option", "did you mean `stall_limit`?"),
        ),
        ("[tool]\ndl2c = { nativ = true }\n", (2, 1, "dl2c", "no option", "did you mean `native`?")),
        ("[tool.dl2c]\nx = 1 # no\n", (2, 1, "x", "no option `x`", "the options are")),
        (
            "[a]\nnative = 3\n[tool.dl2c]\n native = 1 # 0\n",
            (4, 11, "1", "`native` takes True or False", "correct"),
        ),
        (
            "[tool.dl2c]\nstall_limit = -1\n",
            (2, 15, "-1", "`stall_limit` takes a whole number from 0 to", "correct"),
        ),
        ("[tool.dl2c]\non_blocked = 'stop'\n", (2, 14, "'stop'", "`on_blocked` takes 'fallback'", "correct")),
        ("[tool.dl2c]\ndt = 0\n", (2, 6, "0", "`dt` must be positive", "correct")),
        ("[tool.dl2c]\ndt = nan\n", (2, 6, "nan", "`dt` takes a number", "correct")),
        ("[tool.dl2c]\ndt = 1979-05-27\n", (2, 6, "1979-05-27", "`dt` takes a number", "correct")),
        ("[tool.dl2c]\nconstants = 3\n", (2, 13, "3", "`constants` takes names with values", "correct")),
        (
            "[tool.dl2c.constants]\nk = 1\nl = 'x'\n",
            (3, 5, "'x'", "`constants[l]` takes a number", "correct `l`"),
        ),
        ("tool.dl2c = 3\n", (1, 1, "", "`dl2c` is not a table", "write [tool.dl2c]")),
        ("[tool.dl2c]\ndt = = 3\n", (2, 6, "=", "this is not TOML: Invalid value", "correct pyproject.toml")),
        ("[tool.dl2c]\ndt = [", (2, 7, "", "this is not TOML", "correct pyproject.toml")),
    ],
)
def test_a_mistake_is_shown_where_it_is(project: Any, text: str, expected: tuple[Any, ...]) -> None:
    (found,) = diagnostics(project, text)
    assert found[:3] == expected[:3]
    assert found[3].startswith(expected[3]) and found[4].startswith(expected[4])


def test_mistakes_are_shown_together(project: Any) -> None:
    found = diagnostics(project, "[tool.dl2c]\ndt = 0\nx = 1\nnative = 2\n")
    assert [line for line, *_ in found] == [2, 3, 4]


def test_the_command_line_shows_them(project: Any, capsys: Any) -> None:
    path = project("[tool.dl2c]\nstall_limit = -1\n")
    Path("m.kyx").write_text(MODEL.format(episode=""))
    code, out, err = run(capsys, "build", "m.kyx")
    assert (code, out) == (1, "")
    assert f"{path}:2:15" in err and "help: " in err and "Traceback" not in err
    code, out, err = run(capsys, "check", "--json", "m.kyx")
    assert (code, json.loads(out)[0]["file"], err) == (1, str(path), "")


def test_a_project_does_not_change_which_models_are_right(project: Any) -> None:
    project("[tool.other]\nx = 1\n")
    assert check_model(Source("m.kyx", MODEL.format(episode="")), resolve_options({})) == ()


def test_an_environment_keeps_its_options_in_another_folder(
    project: Any, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    project("[tool.dl2c]\nmax_episode_steps = 3\ntolerance = 1e-7\n[tool.dl2c.constants]\nk = 1.25\n")
    env = dl2c.make(MODEL.format(episode=""))
    saved = pickle.dumps(env)
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    assert pickle.loads(saved).manifest == env.manifest


def test_the_documents_show_a_configuration_that_is_right(project: Any) -> None:
    text = (ROOT / "docs" / "reference" / "options.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```toml\n(.*?)^```", text, flags=re.M | re.S)
    project(block)
    assert configured(Options()) != Options()
    assert set(tomllib.loads(block)["tool"]) == {"dl2c"}
