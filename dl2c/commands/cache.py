"""`dl2c cache`: the built models that dl2c keeps."""

from typing import Annotated

import typer

from dl2c.native.cache import DEFAULT_CAP, CacheEntry, cache_dir, cache_entries, clear, prune

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Built models that are kept.")

MEGABYTE = 1024**2


@app.command("dir")
def directory() -> None:
    """Print where built models are kept."""
    print(cache_dir())


@app.command("list")
def entries() -> None:
    """Print the kept models: key and size."""
    for entry in cache_entries():
        print(_line(entry))


@app.command("prune")
def shrink(
    cap: Annotated[int, typer.Option(min=0, help="Megabytes to keep.")] = DEFAULT_CAP // MEGABYTE,
) -> None:
    """Remove the least recently used models until the rest fits."""
    for entry in prune(cap * MEGABYTE):
        print(_line(entry))


@app.command("clear")
def remove_all() -> None:
    """Remove every kept model."""
    for entry in clear():
        print(_line(entry))


def _line(entry: CacheEntry) -> str:
    return f"{entry.key}  {entry.size / MEGABYTE:8.2f} MB"
