"""500 hostile models: each is built or refused with a place, within limits, and leaves nothing half-written.

The first 260 are enlarged examples and public models, all valid; the others are wrong or monstrous. What
became of them is in golden/hostile_models.json: `before` of the valid ones at an earlier commit, `now` of
all at the last look. `make test-hostile` builds all of them, DL2C_HOSTILE=100:120 some.
"""

import json
import os
import shutil
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import pytest
from conftest import REPOSITORY, shared
from hostile.builds import COMPILED, TOTAL, VALID, Ended, built, hostile_model, kind

GOLDEN = REPOSITORY / "tests" / "golden" / "hostile_models.json"
QUICK = "-O0 -DDL2C_NO_TARGET_CLONES"

SHORT = (2, 9, 45, 103, 264, 278, 340, 400)
"""Of many ways, none that takes long."""


def numbers() -> range:
    first, _, last = os.environ.get("DL2C_HOSTILE", f"0:{TOTAL}").partition(":")
    return range(int(first), int(last))


def outcomes(when: str) -> dict[int, str]:
    found = json.loads(GOLDEN.read_text(encoding="utf-8"))[when]
    return {int(number): outcome for number, outcome in found.items()}


def ended(number: int, folder: Path, flags: str = QUICK) -> Ended:
    """Build a model in a folder that goes again."""
    place = folder / str(number)
    place.mkdir()
    path = place / f"m{number}.kyx"
    path.write_bytes(hostile_model(number, shared("corpus")))
    result = built(path, place, flags)
    shutil.rmtree(place)
    return result


def check(chosen: Iterable[int], folder: Path, flags: str = QUICK) -> None:
    """No faults, and what compiled before, or at the last look, compiles."""
    once, last, wrong, seen = outcomes("before"), outcomes("now"), list[str](), Counter[str]()
    for number in chosen:
        result = ended(number, folder, flags)
        where = f"model {number} ({kind(number)})"
        wrong += [f"{where}: {fault}\n{result.said[-500:]}" for fault in result.faults]
        wanted = number < VALID and COMPILED in (once[number], last[number])
        if wanted and result.outcome != COMPILED:
            wrong.append(f"{where} compiled once, now: {result.outcome}")
        sort = "valid" if number < VALID else "monstrous"
        seen[f"{sort}, {'compiled' if result.outcome == COMPILED else 'refused'}"] += 1
        seen["seconds"] += round(result.seconds + result.compiling)
    print(dict(seen), file=sys.stderr)
    assert not wrong, "\n\n".join(wrong)


def test_models_follow_from_their_numbers() -> None:
    corpus = shared("corpus")
    assert hostile_model(17, corpus) == hostile_model(17, corpus) != hostile_model(40, corpus)
    assert VALID * 2 >= TOTAL
    assert len({hostile_model(number, corpus) for number in range(TOTAL)}) == TOTAL


def test_more_of_them_compile_than_before() -> None:
    once, last = outcomes("before"), outcomes("now")
    assert list(once) == list(range(VALID)) and list(last) == list(range(TOTAL))
    lost = [number for number, outcome in once.items() if outcome == COMPILED != last[number]]
    assert not lost
    assert sum(last[number] == COMPILED for number in once) > sum(o == COMPILED for o in once.values())


@pytest.mark.slow
def test_some_hostile_models_are_built_or_refused(tmp_path: Path) -> None:
    check(SHORT, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_all_hostile_models_are_built_or_refused(part: int, tmp_path: Path) -> None:
    check(numbers()[part::10], tmp_path)


@pytest.mark.slow
def test_some_are_built_with_the_flags_of_users(tmp_path: Path) -> None:
    """Thirty of them; those for which the C compiler alone takes minutes are left out."""
    check(
        [n for n in range(0, TOTAL, 16) if kind(n) not in ("conditionals", "statements")][:30], tmp_path, ""
    )
