"""A built model, and how it is found again without reading its text."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from dl2c.diagnostics import Diagnostic, as_stored, in_source_order, restored
from dl2c.inputs import checked_input, read_json
from dl2c.native.cache import build_key, inspected_key, reused
from dl2c.native.errors import NativeError
from dl2c.native.manifest import MAX_BYTES, Manifest
from dl2c.native.notes import recalled, remember
from dl2c.options import Options, as_words
from dl2c.source import Source

if TYPE_CHECKING:
    from dl2c.native.binding import Library

Found = TypeVar("Found")

WARNINGS = "warnings.json"
"""In the folder of a build: what was found after the text was read."""


@dataclass(frozen=True, slots=True)
class Compiled:
    """A built model: its loaded library, the folder of its files, and what to tell the user."""

    library: "Library"
    directory: Path
    warnings: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True)
class Kept:
    """A build in the cache that is not loaded: its manifest, the folder of its files, and what to tell."""

    manifest: Manifest
    directory: Path
    warnings: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True)
class Reading:
    """What a build needs to know of a text: the effective options as words, and what was found while it was
    read.
    """

    options: Mapping[str, str]
    warnings: tuple[Diagnostic, ...]

    def keep(self, source: Source, given: Options) -> None:
        """Note it for the same text and the same given options."""
        stored = [as_stored(w) for w in self.warnings]
        remember("reading", source, given, {"options": dict(self.options), "warnings": stored})


def reading_of(source: Source, given: Options) -> Reading | None:
    """What was noted of a text; None where nothing was."""
    note = recalled("reading", source, given)
    try:
        warnings = tuple(restored(w, source) for w in note["warnings"])
        options = dict(note["options"])
    except (KeyError, TypeError, ValueError):
        return None
    return Reading(options, warnings) if options.keys() == as_words(given).keys() else None


def built_before(
    source: Source, options: Options, known: Callable[[], str], inspect: bool = False
) -> Compiled | None:
    """The build of a text, without reading it; None where there is none. `known` gives what is known of its
    theorem; with `inspect` the one that has the calls of dl2c_inspect.h.
    """
    return _found(source, options, known, inspect, loaded)


def kept_before(source: Source, options: Options, known: Callable[[], str]) -> Kept | None:
    """The same, for who does not run it."""
    return _found(source, options, known, False, _kept)


def _found(
    source: Source,
    options: Options,
    known: Callable[[], str],
    inspect: bool,
    take: Callable[[Path, Source, Sequence[Diagnostic]], Found],
) -> Found | None:
    reading = reading_of(source, options)
    if reading is None:
        return None
    key = build_key({source.file_name: source.text}, reading.options, known())
    found = inspected_key(key) if inspect else key
    return reused(found, lambda folder: take(folder, source, reading.warnings))


def loaded(directory: Path, source: Source, earlier: Sequence[Diagnostic]) -> Compiled:
    """The build in a folder. Raises `NativeError`."""
    from dl2c.native.binding import load_library

    warnings = _warnings(directory, source, earlier)
    return Compiled(load_library(directory), directory, warnings)


def _kept(directory: Path, source: Source, earlier: Sequence[Diagnostic]) -> Kept:
    """The same, not loaded."""
    warnings = _warnings(directory, source, earlier)
    return Kept(Manifest.read(directory / "manifest.json"), directory, warnings)


def _warnings(directory: Path, source: Source, earlier: Sequence[Diagnostic]) -> tuple[Diagnostic, ...]:
    with checked_input(NativeError, "this is not a build"):
        later: list[Any] = read_json(directory / WARNINGS, MAX_BYTES)
        return in_source_order([*earlier, *(restored(w, source) for w in later)])
