"""Nothing that a model or a manifest says is ever run, and no shell sees a file name or a flag."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from generators.toy_library import toy_manifest
from typer.testing import CliRunner

from dl2c.cli import app
from dl2c.diagnostics import error, render
from dl2c.emit import names
from dl2c.native import cgen_dir, toolchain
from dl2c.native.errors import CompilerFailed, NativeError
from dl2c.native.manifest import Manifest
from dl2c.native.toolchain import find_compiler, user_flags
from dl2c.options import Options, UnknownOption, with_options
from dl2c.source import Source, Span

pytestmark = pytest.mark.usefixtures("unoptimised")

ROOT = Path(__file__).resolve().parent.parent
PYTHON = sorted((ROOT / "dl2c").rglob("*.py"))

RUNS_TEXT = {"eval", "exec", "compile", "__import__", "os.system", "os.popen", "subprocess.getoutput"}
LOADS_CODE = {"pickle", "marshal", "shelve", "dill", "cloudpickle"}


def calls(path: Path) -> list[ast.Call]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call)]


def test_no_shell_is_ever_started() -> None:
    for path in PYTHON:
        for call in calls(path):
            assert "shell" not in {k.arg for k in call.keywords}, f"{path}:{call.lineno}"
            if ast.unparse(call.func).startswith("subprocess."):
                first = call.args[0]
                assert not isinstance(first, ast.Constant | ast.JoinedStr), f"{path}:{call.lineno}"


def test_no_text_is_run() -> None:
    """The benchmark alone compiles Python, which it makes of lowered terms: no name in it is the model's.
    Nothing, `exec("")`, may be run.
    """
    for path in PYTHON:
        some = [call for call in calls(path) if ast.unparse(call) != "exec('')"]
        found = {ast.unparse(call.func) for call in some} & RUNS_TEXT
        assert not found or path.parent.name == "bench", path
        assert not re.search(rf"^\s*(import|from) ({'|'.join(LOADS_CODE)})\b", path.read_text("utf-8"), re.M)


MACROS = (
    '#include "model.h"\n#include <stdlib.h>\n#include <stdio.h>\n#include <errno.h>\n#include <limits.h>\n'
)
NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*_?(?:_(?:0|[1-9][0-9]*))?")


def test_no_variable_is_a_macro() -> None:
    """Every macro without parameters that a variable could be called is renamed."""
    command = ["cc", "-std=c11", "-E", "-dM", "-x", "c", "-"]
    includes = [f"-I{cgen_dir() / folder}" for folder in ("include", "runtime")]
    done = subprocess.run([*command, *includes], input=MACROS, capture_output=True, text=True, check=True)
    macros = re.findall(r"^#define (\w+) ", done.stdout, re.M)
    possible = [m for m in macros if NAME.fullmatch(m)]
    assert len(possible) > 20 and not [m for m in possible if names.local(m) == m]


def test_no_model_hides_a_header_of_the_runtime() -> None:
    headers = {path.stem for folder in ("include", "runtime") for path in (cgen_dir() / folder).glob("*.h")}
    assert len(headers) > 30
    assert not {names.file_stem(stem).lower() for stem in (*headers, *map(str.upper, headers))} & headers


def test_file_stems_are_short_plain_words() -> None:
    for name in ("../../etc/passwd", "/abs", "a/b", "", ".", "..", "n" * 9999, "日本", "-rf", "a b\n\0"):
        assert re.fullmatch(r"[A-Za-z_]\w{0,69}", names.file_stem(name), re.ASCII)


def test_build_stays_in_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path / "cache"))
    text = (ROOT / "tests" / "good" / "tank.kyx").read_text(encoding="utf-8")
    (tmp_path / "m.kyx").write_text(text.replace('"Tank"', '"../../evil"'), encoding="utf-8")
    output = tmp_path / "one" / "two"
    done = CliRunner().invoke(app, ["build", str(tmp_path / "m.kyx"), "-o", str(output)])
    assert done.exit_code == 0
    assert [path.name for path in output.iterdir()] == ["______evil"]
    assert {path.name for path in tmp_path.iterdir()} == {"cache", "m.kyx", "one"}


@pytest.mark.parametrize("name", ["CC", "CFLAGS"])
def test_unbalanced_quotes_are_a_clear_error(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, "gcc 'x")
    with pytest.raises(CompilerFailed, match=f"{name} cannot be split"):
        (find_compiler if name == "CC" else user_flags)()


def test_flags_are_words_not_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CFLAGS", "-DA='$(id)' `id`; -g|cat")
    assert user_flags() == ("-DA=$(id)", "`id`;", "-g|cat")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits another process")
def test_compilers_run_for_a_limited_time(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(toolchain, "COMPILER_SECONDS", 1)
    endless = tmp_path / "endless-cc"
    endless.write_text("#!/bin/sh\nsleep 0.2\nwhile :; do :; done\n", encoding="utf-8")
    endless.chmod(0o755)
    with pytest.raises(CompilerFailed, match=r"too large|did not end within"):
        toolchain.run((str(endless), "-c"), tmp_path)


def test_diagnostics_send_no_commands_to_the_terminal() -> None:
    span = Span(Source("\x1b[2Jname.kyx", "text \x1b]0;x\x07"), 0, 4)
    shown = render(error("code", "title \x1b[31m", span, "label \x07", "help \x9b", ("note \x1b[0m",)))
    assert all(line.isprintable() for line in shown.split("\n"))


@pytest.mark.parametrize(
    "value", ["1e999999999", "1e9_9999999", "1/0", "nan", "inf", "9" * 5000, "1e400", "0x1"]
)
def test_numbers_of_options_are_bounded(value: str) -> None:
    with pytest.raises(UnknownOption, match="takes a number"):
        with_options(Options(), {"constants": {"b": value}})
    with pytest.raises(UnknownOption, match="whole number"):
        with_options(Options(), {"max_episode_steps": 10**30})


# Manifests --------------------------------------------------------------------


def plain() -> dict[str, Any]:
    return json.loads(toy_manifest((2, 3), inputs=1).to_json())


def refused(tmp_path: Path, text: str | bytes) -> str:
    path = tmp_path / "manifest.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(NativeError) as problem:
        Manifest.read(path)
    return str(problem.value)


WRONG: list[Any] = [None, True, -1, 1.5, 2**70, "text", [], {}, [1], [[["x"]]], {"a": 1}, [{"name": 1}]]


@pytest.mark.parametrize("field", sorted(plain()))
def test_every_field_of_a_manifest_is_checked(field: str, tmp_path: Path) -> None:
    good = plain()
    lacking = {name: value for name, value in good.items() if name != field}
    assert "manifest" in refused(tmp_path, json.dumps(lacking))
    for wrong in WRONG:
        path = tmp_path / "manifest.json"
        path.write_text(json.dumps(good | {field: wrong}), encoding="utf-8")
        try:
            Manifest.read(path)
        except NativeError as problem:
            assert "manifest" in str(problem)
        else:
            assert type(wrong) is type(good[field]) or (field, wrong) in [("sampler", {}), ("platform", {})]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "Expecting value"),
        ("[" * 100_000, "nested too deeply"),
        ("[]", "not an object"),
        ("{}", "another version"),
        (b"\xff\xfe", "no UTF-8 text"),
        ('{"manifest_version": 1, "manifest_version": ' + "9" * 5000 + "}", "digits"),
        ('{"manifest_version": NaN}', "NaN"),
    ],
)
def test_what_is_no_manifest_is_refused(text: str | bytes, said: str, tmp_path: Path) -> None:
    assert said in refused(tmp_path, text)


def test_parts_of_a_manifest_are_checked(tmp_path: Path) -> None:
    def changed(**parts: Any) -> str:
        return refused(tmp_path, json.dumps(plain() | parts))

    quantity = plain()["variables"][0]
    assert "low of variables" in changed(variables=[quantity | {"low": "nan"}])
    assert "high of variables" in changed(variables=[quantity | {"high": 10**400}])
    assert "unknown '__class__'" in changed(variables=[quantity | {"__class__": "os.system"}])
    assert "lacks name" in changed(variables=[{"low": 0, "high": 1}])
    assert "as many entries" in changed(runs=[[0]])
    assert "every run has a text" in changed(run_texts=[])
    assert "`on_blocked` takes" in changed(options=plain()["options"] | {"on_blocked": "explode"})
    assert "no option `os`" in changed(options={"os": 1})
