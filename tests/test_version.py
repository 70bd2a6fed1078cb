"""Versions of packages; advice on how to install what is missing names what dl2c was installed from."""

import json
import shlex
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import SimpleNamespace

import pytest

from dl2c.version import install, version_of


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


@pytest.mark.parametrize("package", ["casadi", "cffi", "filelock", "lark", "numpy"])
def test_a_version_is_that_of_the_metadata(package: str) -> None:
    assert version_of(package) == version(package)


def test_where_folders_do_not_tell_the_metadata_does(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    package = tmp_path / "casadi" / "__init__.py"
    package.parent.mkdir()
    monkeypatch.setattr("dl2c.version.find_spec", lambda name: SimpleNamespace(origin=str(package)))
    monkeypatch.setattr("importlib.metadata.version", lambda name: f"{name} looked up")
    for more, found in (
        ("casadi_kin-1.0.dist-info", "casadi looked up"),
        ("casadi.egg-info", "casadi looked up"),
        ("casadi-3.6.6+here.dist-info", "3.6.6+here"),
        ("casadi-3.6.5.dist-info", "casadi looked up"),
    ):
        (tmp_path / more).mkdir()
        assert version_of("casadi") == found, more


def test_a_package_that_is_not_there_has_no_version() -> None:
    with pytest.raises(PackageNotFoundError):
        version_of("no_such_package")
