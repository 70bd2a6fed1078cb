"""What is known of a model by its text alone, kept beside the builds: who asks again need not read it again.

A note belongs to the text and its name, to the options as they are given, and to this version of dl2c.
"""

import hashlib
import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from dl2c.code import code_digest
from dl2c.inputs import MALFORMED, read_json
from dl2c.native.cache import NOTES, cache_dir
from dl2c.native.errors import NativeError
from dl2c.options import Options, as_words
from dl2c.outputs import write_output
from dl2c.source import Source

MOST = 2000
"""Notes that are kept; then the oldest half goes."""

MAX_BYTES = 2**22


def recalled(kind: str, source: Source, options: Options) -> dict[str, Any]:
    """A note; empty where there is none."""
    with suppress(*MALFORMED, OSError, NativeError):
        return dict(read_json(_path(kind, source, options), MAX_BYTES))
    return {}


def remember(kind: str, source: Source, options: Options, found: dict[str, Any]) -> None:
    """Keep a note, in the place of an earlier one; what cannot be written is not kept."""
    with suppress(OSError, NativeError):
        path = _path(kind, source, options)
        path.parent.mkdir(mode=0o700, exist_ok=True)
        write_output(path, json.dumps(found) + "\n")
        _forget(path.parent)


def _path(kind: str, source: Source, options: Options) -> Path:
    facts = [kind, source.file_name, source.text, as_words(options), sorted(options.given), code_digest()]
    name = hashlib.sha256(json.dumps(facts, sort_keys=True).encode("utf-8", "surrogatepass")).hexdigest()
    return cache_dir() / NOTES / f"{name[:32]}.json"


def _forget(folder: Path) -> None:
    paths = list(os.scandir(folder))
    if len(paths) > MOST:
        for path in sorted(paths, key=lambda p: p.stat().st_mtime)[: len(paths) - MOST // 2]:
            with suppress(OSError):
                os.unlink(path)
