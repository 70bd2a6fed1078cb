"""What all tests share: golden files and the shared test data."""

import os
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from uuid import uuid4

import pytest
from hypothesis import settings

settings.register_profile("dl2c", deadline=None, derandomize=os.environ.get("CI") == "true")
settings.load_profile("dl2c")
"""New examples every time, but for CI, which tells whether a commit has broken something."""

os.environ["DL2C_STRICT"] = "1"
"""Warnings about generated code are errors."""

REPOSITORY = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden", action="store_true", help="write the golden files instead of comparing"
    )


@pytest.fixture(autouse=True)
def fresh_compilations() -> Generator[None]:
    """No test finds what another one, which may have changed the compiler, has compiled."""
    yield
    if (pipeline := sys.modules.get("dl2c.pipeline")) is not None:
        pipeline.compilation.cache_clear()


@pytest.fixture(autouse=True)
def nothing_proved(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """No test finds what anybody has proved; what it proves itself it finds again."""
    folder = tmp_path_factory.getbasetemp() / "proofs" / uuid4().hex
    monkeypatch.setattr("dl2c.verify.results.folder", lambda: folder)


@pytest.fixture
def unoptimised(monkeypatch: pytest.MonkeyPatch) -> None:
    """Libraries are compiled in less time: where it does not matter how fast they are."""
    monkeypatch.setenv("CFLAGS", "-O0 -DDL2C_NO_TARGET_CLONES")


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[Path, str], None]:
    """`golden(path, text)` asserts that the file at `path` holds `text`; `--update-golden` writes it."""
    update = bool(request.config.getoption("--update-golden"))

    def check(path: Path, text: str) -> None:
        if update:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        assert path.exists(), f"{path} is missing; write it with --update-golden"
        assert text == path.read_text(encoding="utf-8")

    return check


def shared(name: str) -> Path:
    """A path in the shared test data beside the repository; skips where that is absent.

    With DL2C_REQUIRE_SHARED=1 an absent path is a failure instead.
    """
    path = REPOSITORY.parent / "shared" / name
    if not path.exists():
        reason = f"shared test data `{name}` is not at {path}"
        if os.environ.get("DL2C_REQUIRE_SHARED") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    return path
