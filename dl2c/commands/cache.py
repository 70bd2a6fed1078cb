"""`dl2c cache`: the built models that dl2c keeps."""

from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dl2c.commands.failures import to_json
from dl2c.commands.flags import Json
from dl2c.inputs import MALFORMED, read_json
from dl2c.storage import DEFAULT_CAP

if TYPE_CHECKING:
    from dl2c.native.cache import CacheEntry

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Built models that are kept.")

MEGABYTE = 1024**2


@app.command("dir")
def directory(json: Json = False) -> None:
    """Print where built models are kept: in DL2C_CACHE_DIR, or else in the user's cache folder."""
    from dl2c.native.cache import cache_dir

    print(to_json({"directory": str(cache_dir())}) if json else cache_dir())


@app.command("list")
def entries(json: Json = False) -> None:
    """Print the kept models, the last used first: key, size, last use, name."""
    from dl2c.native.cache import cache_entries

    found = cache_entries()
    _show("kept", found, _names(), json)


@app.command("prune")
def shrink(
    cap: Annotated[int, typer.Option(min=0, help="Megabytes to keep.")] = DEFAULT_CAP // MEGABYTE,
    json: Json = False,
) -> None:
    """Remove the least recently used models until the rest fits; print those removed."""
    from dl2c.native.cache import prune

    names = _names()
    _show("removed", prune(cap * MEGABYTE), names, json)


@app.command("clear")
def remove_all(json: Json = False) -> None:
    """Remove every kept model but those that are being built; print them."""
    from dl2c.native.cache import clear

    names = _names()
    _show("removed", clear(), names, json)


def _names() -> Mapping[str, str]:
    """The names of models, and of what else is kept, by key; broken entries have none."""
    from dl2c.native.cache import cache_entries

    return {entry.key: _name(entry) for entry in cache_entries()}


def _name(entry: "CacheEntry") -> str:
    from dl2c.native.manifest import MAX_BYTES

    try:
        return str(read_json(entry.directory / "manifest.json", MAX_BYTES)["name"])
    except (OSError, *MALFORMED):
        return ""


def _show(what: str, entries: Iterable["CacheEntry"], names: Mapping[str, str], json: bool) -> None:
    rows = [_row(entry, names.get(entry.key, "")) for entry in entries]
    if json:
        print(to_json(rows))
        return
    for row in rows:
        used = row["used"].replace("T", " ") if row["used"] else "never"
        print(f"{row['key']}  {row['bytes'] / MEGABYTE:8.2f} MB  {used:19}  {row['name']}".rstrip())
    print(f"{what}: {len(rows)}, {sum(row['bytes'] for row in rows) / MEGABYTE:.2f} MB")


def _row(entry: "CacheEntry", name: str) -> dict[str, Any]:
    """What is shown of an entry; `used` in local time, null if it is broken."""
    used = datetime.fromtimestamp(entry.used).isoformat(timespec="seconds") if entry.used else None
    return {"key": entry.key, "name": name, "bytes": entry.size, "used": used}
