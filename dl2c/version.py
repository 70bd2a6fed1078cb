"""The version of dl2c, written once, and how what it lacks is installed."""

__version__ = "0.1.0"


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
