"""Everything that commands write: files and folders that appear whole or not at all.

What is written goes to a hidden place beside the target and is renamed when it is complete, so that a
full disk, a failure or Ctrl-C leaves what was there before, and a process that has the old file open, or
the old library loaded, keeps it whole. Folders that were made for an output go with it.
"""

import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

HIDDEN = ".dl2c-"
"""How names of unfinished outputs begin."""


def write_output(path: Path, content: str | bytes) -> None:
    """Write a file; text as UTF-8, where lone surrogates become the bytes that they stand for.

    Raises `OSError` with the path.
    """
    raw = content.encode("utf-8", "surrogateescape") if isinstance(content, str) else content
    with output_file(path) as fresh:
        fresh.write_bytes(raw)


def check_outputs(paths: Sequence[Path]) -> None:
    """Raises `OSError` for files that could not be written, or of which two are one: before work begins whose
    result they are to hold.
    """
    for number, path in enumerate(paths):
        _check_no_folder(path)
        if path.resolve() in [other.resolve() for other in paths[:number]]:
            raise OSError(0, "two outputs would be written there", str(path))
        there = next(p for p in (path.resolve(), *path.resolve().parents) if p.exists())
        if not os.access(there, os.W_OK):
            raise PermissionError(13, "it cannot be written", str(path))


def _check_no_folder(path: Path) -> None:
    if path.is_dir():
        raise IsADirectoryError(21, "a folder of this name is there", str(path))


@contextmanager
def output_file(path: Path) -> Generator[Path]:
    """Yields a path to write to, of the same suffix, that becomes `path`, with the permissions it has.

    What is there and is not a regular file, such as a pipe, is written to itself. Raises `OSError` with the
    path.
    """
    with _named(path):
        target = path.resolve()
        if target.exists() and not target.is_file():
            _check_no_folder(path)
            yield target
            return
        with _folder_for(target.parent) as folder:
            fresh = folder / f"{HIDDEN}{secrets.token_hex(8)}{target.suffix}"
            try:
                yield fresh
                if target.exists():
                    os.chmod(fresh, stat.S_IMODE(target.stat().st_mode))
                os.replace(fresh, target)
            finally:
                fresh.unlink(missing_ok=True)


@contextmanager
def output_folder(path: Path) -> Generator[Path]:
    """Yields an empty folder whose content becomes that of `path`. Of a folder that is there, other files
    stay; those of the same name are replaced one by one, when all are complete. Raises `OSError` with the
    path.
    """
    with _named(path), _folder_for(path.resolve()) as target:
        fresh = Path(tempfile.mkdtemp(prefix=HIDDEN, dir=target))
        try:
            yield fresh
            _merge(fresh, target)
        finally:
            shutil.rmtree(fresh, ignore_errors=True)


@contextmanager
def _named(path: Path) -> Generator[None]:
    """An `OSError` that says which output it prevented."""
    try:
        yield
    except shutil.Error as problem:
        raise OSError(0, str(problem), str(path)) from None
    except OSError as problem:
        if problem.filename is not None and HIDDEN not in str(problem.filename):
            raise
        raise OSError(problem.errno or 0, problem.strerror or str(problem), str(path)) from None


@contextmanager
def _folder_for(folder: Path) -> Generator[Path]:
    """A folder that is made where it is not there; what was made goes again where its content fails."""
    made: list[Path] = []
    try:
        for missing in reversed([p for p in (folder, *folder.parents) if not p.exists()]):
            with suppress(FileExistsError):
                missing.mkdir()
                made.append(missing)
        yield folder
    except BaseException:
        for own in reversed(made):
            with suppress(OSError):
                own.rmdir()
        raise


def _merge(fresh: Path, target: Path) -> None:
    """Move what is in one folder to another."""
    for part in sorted(fresh.iterdir()):
        place = target / part.name
        if part.is_dir() and place.is_dir():
            _merge(part, place)
        else:
            os.replace(part, place)
