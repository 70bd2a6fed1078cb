"""The C of a page computes what the library computes: the same bits, or those of other functions like sin."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from play.pages import EXAMPLES, NODE, made, needs_node, needs_zig

from dl2c.env.opening import batch_options, open_library
from dl2c.play.facts import facts_of

pytestmark = [needs_node, needs_zig]

TOLERANCE = 1e-12


def rows_of(example: str, steps: int, folder: Path) -> NDArray[np.float64]:
    """What the page's engine does."""
    facts, module, out = folder / "facts.json", folder / "module.wasm", folder / "rows"
    facts.write_text(json.dumps(facts_of(made(example))), encoding="utf-8")
    module.write_bytes(made(example).wasm)
    script = Path(__file__).with_name("steps.mjs")
    command = [str(NODE), str(script), str(facts), str(module), str(steps), str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return np.fromfile(out).reshape(steps, -1)


def check(example: str, steps: int, folder: Path) -> None:
    playable = made(example)
    library = open_library(playable.source, playable.manifest.options)
    batch = library.batch(1, autoreset="disabled", **batch_options(library.manifest))
    sizes, seed = library.sizes, 0
    before: Any = None
    for row in rows_of(example, steps, folder):
        cuts = np.cumsum([1, sizes.nchoice, sizes.ninput, sizes.nx, sizes.np, sizes.nmask])
        stepped, choices, inputs, x, p, mask, said = np.split(row, cuts)
        if not stepped[0]:
            batch.reset(seeds=np.array([seed], np.uint64))
            seed += 1
        else:
            if playable.approximate:
                batch.set_state(0, *before)
            batch.choices[0], batch.inputs[0] = choices, inputs
            batch.step()
        found = batch.get_state(0)
        if playable.approximate:
            np.testing.assert_allclose(found[0], x, rtol=TOLERANCE, atol=TOLERANCE)
            np.testing.assert_allclose(batch.rewards[0], said[3], rtol=TOLERANCE, atol=TOLERANCE)
        else:
            assert found[0].tobytes() == x.tobytes() and batch.rewards[0].tobytes() == said[3].tobytes()
        assert found[1].tobytes() == p.tobytes() and batch.mask[0].tolist() == mask.tolist()
        assert [batch.reason[0], batch.status[0], batch.blocked[0]] == said[:3].tolist()
        before = x, p
    batch.close()
    assert seed >= 1


@pytest.mark.parametrize("example", [pytest.param("watertank", marks=pytest.mark.slow), "pendulum"])
def test_a_page_computes_what_a_library_computes(example: str, tmp_path: Path) -> None:
    check(example, 2000, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_for_long(example: str, tmp_path: Path) -> None:
    check(example, 100_000, tmp_path)


def test_functions_that_round_otherwise_are_known() -> None:
    assert made("pendulum").approximate and not made("watertank").approximate
