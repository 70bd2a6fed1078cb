"""Built models on disk, each under a key that names everything its bytes depend on.

An entry is a folder `<root>/<key>` that appears whole by a rename and carries the digests
of its files, so that what a killed build or a bad disk left behind is never used. Builders
of one key, in whatever process, take turns. Entries are used by whoever can write the
cache, so it belongs to one user alone.
"""

import hashlib
import json
import os
import secrets
import shutil
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from dl2c.code import code_digest
from dl2c.inputs import MALFORMED, read_json
from dl2c.native.errors import NativeError
from dl2c.native.sundials import find_sundials
from dl2c.native.toolchain import cpu_features, find_compiler
from dl2c.storage import ADVICE, DEFAULT_CAP, StorageError, cache_home, private_folder
from dl2c.version import version_of

GRACE = 60.0
"""Seconds for which the automatic pruning spares an entry, so that its user can load it."""

SEAL = "sealed.json"
"""Digests of all other files of an entry."""

MOST_SEALED = 2**20

NOTES = "notes"
"""In the cache's folder: what is known of texts, see `notes`."""

ZIG = "zig"
"""Beside the cache's folder: what zig has compiled of its C library for pages."""

KEY_LENGTH = 32

Loaded = TypeVar("Loaded")


@dataclass(frozen=True, slots=True)
class CacheEntry:
    """A built model: its key, bytes on disk, and when it was last used (seconds since the epoch)."""

    key: str
    directory: Path
    size: int
    used: float


def build_key(sources: Mapping[str, str], options: Mapping[str, str], known: str = "") -> str:
    """The key of a build: `sources` are the texts of the model and its imports by name, `options` the
    effective ones as words, `known` what its files say of its theorem.

    Covers also this version of dl2c, the compiler, its flags and casadi, and the CPU where the build is for
    that one alone. Raises `CompilerMissing`, `CompilerFailed`.
    """
    compiler = find_compiler()
    native = {"True": True, "False": False}.get(options["native"])
    flags = compiler.flags(native, debug=options["debug"] == "True")
    facts = {
        "sources": dict(sources),
        "known": known,
        "options": dict(options),
        "code": code_digest(),
        "compiler": (compiler.command, compiler.version),
        "flags": flags,
        "casadi": version_of("casadi"),
        "sundials": find_sundials("system", compiler).version if options["sundials"] == "system" else "",
        "cpu": cpu_features() if any("native" in flag for flag in flags) else "",
    }
    return key_of(facts)


def key_of(facts: object) -> str:
    """The key under which is kept what these facts decide; they are such as JSON has."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:KEY_LENGTH]


def inspected_key(key: str) -> str:
    """Where the build `key` is kept with the calls of dl2c_inspect.h."""
    return hashlib.sha256(f"inspect {key}".encode()).hexdigest()[:KEY_LENGTH]


def cache_dir() -> Path:
    """The cache's folder, `builds` where dl2c keeps things. Raises `NativeError` if there can be none."""
    try:
        return private_folder("builds")
    except StorageError as problem:
        raise NativeError(str(problem)) from None


def name_entry(directory: Path, name: str) -> None:
    """Give a name, which `dl2c cache list` shows, to an entry that is no model."""
    (directory / "manifest.json").write_text(json.dumps({"name": name}), encoding="utf-8")


def cached(key: str, build: Callable[[Path], None], load: Callable[[Path], Loaded]) -> Loaded:
    """What `load(folder)` makes of the entry `key`, which is made by `build(folder)` unless it is there.

    Only one process builds a key at a time, the others wait for it and use its result. An entry that
    cannot be loaded, though nothing is wrong with its files, is built once more. An exception of `build`
    passes through and leaves no entry. Raises `NativeError` where the disk is full or cannot be written,
    and what `load` raises of a fresh entry.
    """
    root = cache_dir()
    entry = root / key
    try:
        if (loaded := reused(key, load)) is None:
            with _locked(root, key):
                if (loaded := reused(key, load)) is None:
                    _remove_leftovers(root, key)
                    _build(root, entry, build)
                    loaded = load(entry)
            prune(idle=GRACE)
    except OSError as problem:
        raise NativeError(f"cannot write the build cache {root}: {problem.strerror}; {ADVICE}") from None
    return loaded


def reused(key: str, load: Callable[[Path], Loaded]) -> Loaded | None:
    """What `load(folder)` makes of the entry `key`; None where there is no whole entry, or none that can be
    loaded. Raises `NativeError` where there can be no cache.
    """
    entry = cache_dir() / key
    if _intact(entry):
        with suppress(NativeError, OSError):
            loaded = load(entry)
            os.utime(entry / SEAL)
            return loaded
    return None


def cache_entries() -> tuple[CacheEntry, ...]:
    """All entries, most recently used first."""
    entries = [e for path in cache_dir().iterdir() if _is_key(path.name) and (e := _entry(path))]
    return tuple(sorted(entries, key=lambda e: (-e.used, e.key)))


def prune(cap: int = DEFAULT_CAP, idle: float = 0.0) -> tuple[CacheEntry, ...]:
    """Remove the least recently used entries until at most `cap` bytes are left; returns them.

    Spares entries used in the last `idle` seconds and those being built.
    """
    root, total, now = cache_dir(), 0, time.time()
    removed: list[CacheEntry] = []
    for entry in cache_entries():
        total += entry.size
        if total > cap and now - entry.used >= idle and _remove(root, entry.key):
            removed.append(entry)
            total -= entry.size
    return tuple(removed)


def clear() -> tuple[CacheEntry, ...]:
    """Remove every entry that nobody is building, all notes, what zig keeps, and what killed builds left;
    returns the entries.
    """
    from filelock import Timeout

    root = cache_dir()
    removed = prune(cap=0)
    shutil.rmtree(root / NOTES, ignore_errors=True)
    shutil.rmtree(cache_home() / ZIG, ignore_errors=True)
    for key in {path.name.partition(".")[0] for path in root.glob("*.tmp")}:
        with suppress(Timeout), _locked(root, key, timeout=0):
            _remove_leftovers(root, key)
    return removed


def _build(root: Path, entry: Path, build: Callable[[Path], None]) -> None:
    """Build in a folder of its own and let it appear as `entry` when it is whole."""
    fresh = _unfinished(root, entry.name)
    try:
        fresh.mkdir(mode=0o700)
        build(fresh)
        seal = json.dumps(_digests(fresh), indent=1, sort_keys=True)
        (fresh / SEAL).write_text(seal + "\n", encoding="utf-8")
        os.rename(fresh, entry)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def _unfinished(root: Path, key: str) -> Path:
    """A folder for a build, or for what is left of one; it is not made, so that Ctrl-C leaves none behind."""
    return root / f"{key}.{secrets.token_hex(4)}.tmp"


def _intact(entry: Path) -> bool:
    """Whether every file of the entry is what the build left."""
    try:
        return read_json(entry / SEAL, MOST_SEALED) == _digests(entry)
    except (OSError, *MALFORMED):
        return False


def _digests(directory: Path) -> dict[str, str]:
    files = sorted(path for path in directory.rglob("*") if path.is_file() and path != directory / SEAL)
    names = [path.relative_to(directory).as_posix() for path in files]
    return {n: hashlib.sha256(path.read_bytes()).hexdigest() for n, path in zip(names, files, strict=True)}


def _entry(path: Path) -> CacheEntry | None:
    """What is at `path`, None if it vanished meanwhile. A broken entry counts as never used."""
    try:
        size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
        seal = path / SEAL
        return CacheEntry(path.name, path, size, seal.stat().st_mtime if seal.exists() else 0.0)
    except OSError:
        return None


def _remove(root: Path, key: str) -> bool:
    from filelock import Timeout

    try:
        with _locked(root, key, timeout=0):
            return _remove_leftovers(root, key)
    except Timeout:
        return False


def _remove_leftovers(root: Path, key: str) -> bool:
    """Remove the entry and unfinished builds of a key whose lock is held; says if all went.

    The entry is renamed first: at no moment is there half an entry.
    """
    with suppress(FileNotFoundError):
        os.rename(root / key, _unfinished(root, key))
    for path in root.glob(f"{key}.*.tmp"):
        shutil.rmtree(path, ignore_errors=True)
    return not (root / key).exists()


@contextmanager
def _locked(root: Path, key: str, timeout: float = -1) -> Generator[None]:
    """Hold the lock of a key; its file stays, since removing it would let two in."""
    from filelock import FileLock

    locks = root / "locks"
    locks.mkdir(mode=0o700, exist_ok=True)
    with FileLock(locks / key, timeout=timeout):
        yield


def _is_key(name: str) -> bool:
    return len(name) == KEY_LENGTH and "." not in name
