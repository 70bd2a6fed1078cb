"""The version of dl2c, written once, those of packages it builds with, and how what it lacks is installed."""

from importlib.util import find_spec
from pathlib import Path

__version__ = "0.1.0"


def version_of(package: str) -> str:
    """The version of an installed package, which is not imported. Raises `PackageNotFoundError`.

    It is in the name of the folder that describes the package. `importlib.metadata` looks further, but every
    command asks this, and would take 10 ms more to import that.
    """
    place = find_spec(package)
    if place is not None and place.origin is not None:
        found = list(Path(place.origin).parents[1].glob(f"{package}-*.dist-info"))
        if len(found) == 1:
            return found[0].stem.removeprefix(f"{package}-")
    from importlib.metadata import version

    return version(package)


def install(extra: str) -> str:
    """The command that installs an extra to where dl2c comes from: the folder of its source, or an index."""
    import json
    import shlex
    from importlib.metadata import PackageNotFoundError, distribution
    from typing import Any
    from urllib.parse import unquote, urlsplit

    told: dict[str, Any]
    try:
        told = json.loads(distribution("dl2c").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        told = {}
    if "dir_info" not in told:
        return f"pip install 'dl2c[{extra}]'"
    editable = "-e " if told["dir_info"].get("editable") else ""
    place = shlex.quote(f"{unquote(urlsplit(str(told['url'])).path)}[{extra}]")
    return f"pip install {editable}{place}"
