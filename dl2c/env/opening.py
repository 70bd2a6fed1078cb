"""From what a user names to a loaded library: `a/model.kyx`, a model's text, `example:waypoint`.

Goes in: a path, a text or a `Source`, and options by name. Comes out: the `Source` and the
built library. The pipeline is imported on first use, so that importing dl2c stays cheap.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from dl2c.progress import LOG, Progress, silent
from dl2c.source import Source

if TYPE_CHECKING:
    from dl2c.native.binding import Library
    from dl2c.native.built import Compiled
    from dl2c.native.manifest import Manifest
    from dl2c.options import Options
    from dl2c.pipeline import Compilation

Model: TypeAlias = Source | Path | str
"""A model as a user names it; see `source_of`."""

EXAMPLE = "example:"


def examples_dir() -> Path:
    """Where the example models are: inside the installed package, or else in the checkout."""
    packaged = Path(__file__).resolve().parent.parent / "examples"
    return packaged if packaged.is_dir() else packaged.parent.parent / "examples"


def source_of(model: Model) -> Source:
    """The text a model stands for. A string of several lines is the text itself,
    `example:NAME` a model that comes with dl2c, anything else a path.

    Raises `OSError` if there is no such file.
    """
    match model:
        case Source():
            return model
        case str() if "\n" in model:
            return Source("<string>", model.removeprefix("\ufeff"))
        case str() if model.startswith(EXAMPLE):
            path = examples_dir() / f"{model.removeprefix(EXAMPLE)}.kyx"
            return Source(f"examples/{path.name}", Source.read(path).text)
        case _:
            return Source.read(model)


def build(
    source: Source, options: Mapping[str, Any], progress: Progress = silent, inspect: bool = False
) -> "Compiled":
    """A model with these options, built or taken from the cache; with `inspect` for who wants to see what
    happens inside steps.

    Raises `CompileError` for a mistake in the model, `UnknownOption`, `NativeError`. `progress` is told
    what is being done.
    """
    from dl2c.configuration import resolve_options

    chosen = resolve_options(options)
    if (found := _built_before(source, chosen, inspect)) is not None:
        return found
    from dl2c.pipeline import compile_model

    return compile_model(source, chosen, progress=progress, inspect=inspect)


def _built_before(source: Source, options: "Options", inspect: bool = False) -> "Compiled | None":
    from dl2c.native.built import built_before
    from dl2c.verify.results import status

    found = built_before(source, options, lambda: str(status(source, options)), inspect)
    if found is not None:
        LOG.info("files: %s", found.directory)
    return found


def manifest_of(model: Model, options: Mapping[str, Any]) -> "Manifest":
    """What a built model says of itself; no C is compiled for that. Raises what `build` raises."""
    from dl2c.configuration import resolve_options

    source = source_of(model)
    found = _built_before(source, resolve_options(options))
    return compilation_of(source, options).manifest() if found is None else found.library.manifest


def compilation_of(model: Model, options: Mapping[str, Any]) -> "Compilation":
    """The compilation of a model with these options; that of its environments, if there are any.

    Raises `UnknownOption`.
    """
    from dl2c.configuration import resolve_options
    from dl2c.pipeline import compilation

    return compilation(source_of(model), resolve_options(options))


def open_library(source: Source, options: Mapping[str, Any], inspect: bool = False) -> "Library":
    """The library of `build`."""
    return build(source, options, inspect=inspect).library


def batch_options(manifest: "Manifest") -> dict[str, Any]:
    """The effective options that concern a batch, as `Library.batch` takes them."""
    names = ("on_blocked", "action_map", "blocked_penalty", "stall_limit")
    return {"max_steps": manifest.options["max_episode_steps"]} | {n: manifest.options[n] for n in names}
