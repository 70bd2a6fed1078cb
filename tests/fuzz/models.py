"""Fuzzes everything between the text of a model and its paths: `python tests/fuzz/models.py SECONDS`.

Inputs are changed by tokens as often as by bytes. A finding is an exception that is no message for a
user, or an input that takes longer than `LIMIT` seconds; it ends the run with a status other than 0 and
lies in build/fuzz then. What reached new code stays in build/fuzz/corpus and is where the next run begins.
"""

import hashlib
import sys
from pathlib import Path
from random import Random

import atheris
from tokens import DICTIONARY, mutated

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

with atheris.instrument_imports(include=["dl2c"]):
    import dl2c.paths.enumerate  # noqa: F401
    from dl2c.diagnostics import CompileError
    from dl2c.options import Options, UnknownOption
    from dl2c.pipeline import emit, step_model
    from dl2c.source import Source

LIMIT = 10
"""Seconds that a model may take to be read or refused."""

MAX_LENGTH = 20_000
MAX_SEED = 4_000
"""Bytes of an input, and of one to begin with."""

WORK = ROOT / "build" / "fuzz"
SEEDS = ("tests/good", "tests/bad", "examples", "../shared/corpus")


def check(data: bytes) -> None:
    """Read a model as far as its paths; only messages for users may come out."""
    source = Source("fuzz.kyx", data.decode("utf-8", "surrogateescape"))
    for stage in ("tree", "expanded", "paths"):
        try:
            if stage == "paths":
                step_model(source, Options())
            else:
                emit(source, stage, Options())
        except UnknownOption:
            pass
        except CompileError as refused:
            assert str(refused)
            if stage == "tree":
                return


def change(data: bytes, max_size: int, seed: int) -> bytes:
    """The custom mutator of libFuzzer: bytes are its own affair, tokens ours."""
    rng = Random(seed)
    if rng.random() < 0.3:
        return atheris.Mutate(data, max_size)
    text = data.decode("utf-8", "surrogateescape")
    return mutated(text, rng).encode("utf-8", "surrogateescape")[:max_size]


def prepare() -> Path:
    """The corpus folder, with the seeds in it, and the dictionary."""
    corpus = WORK / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for folder in SEEDS:
        for path in sorted((ROOT / folder).rglob("*.kyx")):
            content = path.read_bytes()
            if len(content) <= MAX_SEED:
                (corpus / hashlib.sha256(content).hexdigest()[:16]).write_bytes(content)
    words = (word.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\x0A") for word in DICTIONARY)
    lines = "".join(f'"{word}"\n' for word in words if word.isascii())
    (WORK / "tokens.dict").write_text(lines, encoding="ascii")
    return corpus


def main() -> None:
    seconds = sys.argv[1] if len(sys.argv) > 1 else "300"
    corpus = prepare()
    flags = (
        f"-max_total_time={seconds}",
        f"-timeout={LIMIT}",
        f"-max_len={MAX_LENGTH}",
        f"-dict={WORK / 'tokens.dict'}",
        f"-artifact_prefix={WORK}/",
        "-rss_limit_mb=4096",
        "-print_final_stats=1",
        "-verbosity=1",
    )
    atheris.Setup([sys.argv[0], *flags, str(corpus)], check, custom_mutator=change)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
