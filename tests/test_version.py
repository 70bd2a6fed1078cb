"""Advice on how to install what is missing names what dl2c was installed from."""

import json
import shlex
from pathlib import Path
from types import SimpleNamespace

import pytest

from dl2c.version import install


def installed(monkeypatch: pytest.MonkeyPatch, told: str | None) -> None:
    """As if dl2c came from where pip's `direct_url.json` says."""
    found = SimpleNamespace(read_text=lambda name: told)
    monkeypatch.setattr("importlib.metadata.distribution", lambda name: found)


@pytest.mark.parametrize("told", [None, "{}", "no JSON", '{"url": "https://example.org/dl2c.whl"}'])
def test_an_index_is_the_source_of_what_does_not_say(
    monkeypatch: pytest.MonkeyPatch, told: str | None
) -> None:
    installed(monkeypatch, told)
    assert install("zig") == "pip install 'dl2c[zig]'"


@pytest.mark.parametrize("editable", [True, False])
def test_a_folder_is_named_so_that_a_shell_reads_it(
    monkeypatch: pytest.MonkeyPatch, editable: bool, tmp_path: Path
) -> None:
    folder = tmp_path / "a b'c"
    installed(monkeypatch, json.dumps({"url": folder.as_uri(), "dir_info": {"editable": editable}}))
    words = ["pip", "install", *["-e"] * editable, f"{folder}[train]"]
    assert shlex.split(install("train")) == words


def test_the_folder_of_this_installation_is_there() -> None:
    place = shlex.split(install("zig"))[-1].removesuffix("[zig]")
    assert place == "dl2c" or (Path(place) / "pyproject.toml").is_file()
