"""A pytest plugin that runs tests of another library on environments of dl2c.

Each test passes on them, or `unfit.toml` says why it cannot: those must fail, or use no environment.
"""

import os
import tempfile
import tomllib
from collections import Counter
from collections.abc import Generator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import pytest

USES = Path(tempfile.mkdtemp()) / "uses"
USES.touch()
os.environ["DL2C_STAND_INS_USES"] = str(USES)

import stand_ins  # noqa: E402 # needs the file

TABLE = Path(__file__).with_name("unfit.toml")


def name_of(item: pytest.Item) -> str:
    """`stable_baselines3/test_run.py::test_a2c[x]`, for tests below `stable_baselines3-2.9.2/tests`."""
    package = item.path.parent.parent.name.split("-")[0]
    return f"{package}/{item.path.name}::{item.nodeid.split('::', 1)[1]}"


def reasons() -> dict[str, str]:
    """Why tests do not fit, by pattern of their names; brackets are meant literally."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    return {
        f"{file}::{test}".replace("[", "[[]"): row["because"]
        for row in table["unfit"]
        for file, tests in row["tests"].items()
        for test in tests
    }


def pytest_configure(config: pytest.Config) -> None:
    for mark in ("expensive", "slow"):
        config.addinivalue_line("markers", f"{mark}: of theirs")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks what does not fit, to fail; a row of the table for which there is no test is wrong."""
    table = reasons()
    idle = set(table)
    files = {name_of(item).split("::")[0] for item in items}
    for item in items:
        vars(item.module).update(stand_ins.OWN_CLASSES.get(item.module.__name__, {}))
        matches = [pattern for pattern in table if fnmatchcase(name_of(item), pattern)]
        idle.difference_update(matches)
        if matches:
            item.add_marker(pytest.mark.xfail(reason=table[matches[0]], strict=True))
    wrong = [pattern for pattern in idle if pattern.split("::")[0] in files]
    if wrong:
        raise pytest.UsageError(f"{TABLE.name} lists what is not there: {', '.join(sorted(wrong))}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """A test that uses no environment of dl2c, or skips, fails."""
    before = USES.stat().st_size
    try:
        result = yield
    except pytest.skip.Exception as skipped:
        pytest.fail(f"skipped: {skipped.msg}")
    if USES.stat().st_size == before:
        pytest.fail("used no environment of dl2c")
    return result


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """How many ran, and for which reasons the others did not."""
    listed = Counter(report.wasxfail for report in terminalreporter.stats.get("xfailed", ()))
    passed = len(terminalreporter.stats.get("passed", ()))
    terminalreporter.write_line(f"{passed} tests passed on environments of dl2c")
    for reason, count in listed.most_common():
        terminalreporter.write_line(f"{count:5} do not fit: {reason}")
