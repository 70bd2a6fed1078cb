"""What is known of theorems from earlier proofs, kept beside built models.

An answer belongs to the theorem with its definitions expanded, its invariants and hints, bounds and given
values, this version of dl2c, and the versions of the solvers.
"""

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dl2c.code import code_digest
from dl2c.diagnostics import CompileError
from dl2c.inputs import MALFORMED, read_json
from dl2c.native.notes import recalled, remember
from dl2c.options import Options
from dl2c.outputs import write_output
from dl2c.source import Source
from dl2c.storage import StorageError, cache_home

if TYPE_CHECKING:
    from dl2c.parse.tree import Entry
    from dl2c.verify.report import Report
    from dl2c.verify.theorem import Theorem

NOT_CHECKED = "not checked"

DEFINITE = ("proved", "refuted")
"""Answers that an indefinite one, given in less time, does not replace."""

OPEN = {"unknown": "to dl2c verify", NOT_CHECKED: "(dl2c verify leaves a part of it open)"}
"""What is added to indefinite answers."""

MAX_BYTES = 2**20


@dataclass(frozen=True, slots=True)
class Status:
    """What is known: the answer, and in a line what it rests on."""

    answer: str = NOT_CHECKED
    basis: str = ""

    def __str__(self) -> str:
        return f"{self.answer} {self.basis}".strip()


def status(source: Source, options: Options, entry: "Entry | None" = None) -> Status:
    """What is known of the theorem of a model, whose `entry` may have been read; `not checked` where nothing
    is.
    """
    if not any_kept():
        return Status()
    name = recalled("theorem", source, options).get("name")
    if not isinstance(name, str):
        from dl2c.resolve.unreadable import read_entry
        from dl2c.verify.theorem import theorem_of

        try:
            read = entry or read_entry(source, options.entry)
        except CompileError:
            return Status()
        try:
            name = digest_of(theorem_of(read, dict(options.constants)))
        except (CompileError, RecursionError):
            name = ""  # it states no theorem
        remember("theorem", source, options, {"name": name})
    return kept(name)


def any_kept() -> bool:
    """Whether there are answers, of this user: those of others count for nothing."""
    with suppress(OSError, StorageError):
        return folder().stat().st_uid == os.getuid()
    return False


def kept(digest: str) -> Status:
    """The answer that is kept under a name, `not checked` where none is."""
    with suppress(*MALFORMED, OSError, StorageError):
        found: dict[str, Any] = read_json(folder() / f"{digest}.json", MAX_BYTES)
        return Status(str(found["answer"]), str(found["basis"]))
    return Status()


def store(theorem: "Theorem", report: "Report") -> None:
    """Keep an answer; what cannot be written is not kept."""
    digest = digest_of(theorem)
    if not digest or (any_kept() and kept(digest).answer in DEFINITE and report.answer not in DEFINITE):
        return
    basis = report.basis or OPEN.get(report.answer, "")
    if report.within_bounds != report.answer:
        basis += f"; within bounds {report.within_bounds}"
    said = {"answer": report.answer, "basis": basis}
    with suppress(OSError, StorageError):
        folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        write_output(folder() / f"{digest}.json", json.dumps(said, indent=1) + "\n")


def folder() -> Path:
    """Where answers are kept. Raises `StorageError` where the user has no home."""
    return cache_home() / "proofs"


def digest_of(theorem: "Theorem") -> str:
    """The name under which the answer for a theorem is kept; "" for one that is nested too deeply."""
    try:
        facts = [repr(theorem.formula), repr(theorem.hints), repr(sorted(theorem.bounds.items()))]
    except RecursionError:
        return ""
    facts += [repr(sorted(theorem.scope.items())), code_digest()]
    facts += [_version(name) for name in ("z3-solver", "cvc5")]
    return hashlib.sha256("\0".join(facts).encode("utf-8", "surrogatepass")).hexdigest()[:32]


def _version(name: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    with suppress(PackageNotFoundError):
        return version(name)
    return ""
