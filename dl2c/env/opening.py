"""From what a user names to a loaded library: `a/model.kyx`, a model's text, `example:waypoint`.

Goes in: a path, a text or a `Source`, and options by name. Comes out: the `Source` and the
built library. The pipeline is imported on first use, so that importing dl2c stays cheap.
"""

from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from dl2c.diagnostics import Mistake
from dl2c.progress import LOG, Progress, silent
from dl2c.source import Source

if TYPE_CHECKING:
    from dl2c.native.binding import Library
    from dl2c.native.built import Compiled, Kept
    from dl2c.native.manifest import Manifest
    from dl2c.options import Options
    from dl2c.pipeline import Compilation

Model: TypeAlias = Source | Path | str
"""A model as a user names it; see `source_of`."""

Found = TypeVar("Found", "Compiled | None", "Kept | None")

EXAMPLE = "example:"


class UnknownExample(Mistake):
    """No model of this name comes with dl2c; the message says which do."""

    def __init__(self, name: str) -> None:
        names = sorted(path.stem for path in examples_dir().glob("*.kyx"))
        near = get_close_matches(name, names, 1)
        others = f"did you mean `{near[0]}`? There are" if near else "there are"
        super().__init__(f"no example `{name}`; {others} {', '.join(names)}")


def examples_dir() -> Path:
    """Where the example models are: inside the installed package, or else in the checkout."""
    packaged = Path(__file__).resolve().parent.parent / "examples"
    return packaged if packaged.is_dir() else packaged.parent.parent / "examples"


def source_of(model: Model) -> Source:
    """The text a model stands for. A string of several lines is the text itself,
    `example:NAME` a model that comes with dl2c, anything else a path.

    Raises `OSError` if there is no such file, `UnknownExample`.
    """
    match model:
        case Source():
            return model
        case str() if "\n" in model:
            return Source("<string>", model.removeprefix("\ufeff"))
        case str() if model.startswith(EXAMPLE):
            path = examples_dir() / f"{model.removeprefix(EXAMPLE)}.kyx"
            if not path.is_file():
                raise UnknownExample(model.removeprefix(EXAMPLE))
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


def kept(source: Source, options: Mapping[str, Any], progress: Progress = silent) -> "Kept":
    """The build of a model for who does not run it: one in the cache is not loaded. Raises what `build`
    raises.
    """
    from dl2c.configuration import resolve_options
    from dl2c.native.built import Kept

    chosen = resolve_options(options)
    if (found := _kept_before(source, chosen)) is not None:
        return found
    from dl2c.pipeline import compile_model

    compiled = compile_model(source, chosen, progress=progress)
    return Kept(compiled.library.manifest, compiled.directory, compiled.warnings)


def _built_before(source: Source, options: "Options", inspect: bool) -> "Compiled | None":
    from dl2c.native.built import built_before
    from dl2c.verify.results import status

    return _told(built_before(source, options, lambda: str(status(source, options)), inspect))


def _kept_before(source: Source, options: "Options") -> "Kept | None":
    from dl2c.native.built import kept_before
    from dl2c.verify.results import status

    return _told(kept_before(source, options, lambda: str(status(source, options))))


def _told(found: Found) -> Found:
    if found is not None:
        LOG.info("files: %s", found.directory)
    return found


def manifest_of(model: Model, options: Mapping[str, Any]) -> "Manifest":
    """What a built model says of itself; no C is compiled for that. Raises what `build` raises."""
    from dl2c.configuration import resolve_options

    source = source_of(model)
    found = _kept_before(source, resolve_options(options))
    return compilation_of(source, options).manifest() if found is None else found.manifest


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
