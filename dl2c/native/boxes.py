"""The library that judges boxes of states: cgen/verify, compiled once, which knows no model.

Questions come as tables (`Tables`); what becomes of each box goes out. Built into the cache on first use.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import cffi  # pyright: ignore[reportMissingTypeStubs]  # cffi publishes no types
import numpy as np
from numpy.typing import NDArray

from dl2c.code import cgen_dir
from dl2c.native.cache import cached, key_of, name_entry
from dl2c.native.errors import NativeError
from dl2c.native.toolchain import find_compiler, link_flags, run, warning_flags

Doubles: TypeAlias = NDArray[np.float64]
Bytes: TypeAlias = NDArray[np.uint8]

OPEN, OUTSIDE, PROVED, SUSPECT = range(4)
"""Verdicts; a suspect box is open, and its middle seems to violate the claim."""

NO_SPLIT = 255
"""Instead of a dimension where a box cannot be split."""

MOST_STEPS, MOST_SYMBOLS, MOST_DIMENSIONS, MOST_WIDTH, MOST_LAYERS, MOST_OUTPUTS = 400, 32, 24, 256, 12, 64
"""Limits of the library, as in its headers."""

CDEF = """
typedef struct { int32_t operation, left, right; double low, high; } dl2c_operation_step;
typedef struct { int32_t comparison, first, count, left, right; } dl2c_atom;
typedef struct { int32_t kind, first, count; } dl2c_node;
typedef struct {
  const dl2c_operation_step *steps; const dl2c_atom *atoms; const dl2c_node *nodes;
  const int32_t *parts; int32_t symbols;
} dl2c_formulas;
typedef struct { int32_t rows, columns, activation; const double *weight, *bias; } dl2c_layer;
typedef struct { double slope, offset, size, low, high; } dl2c_scale;
typedef struct {
  int32_t dimension, scales; double value, relative, absolute; const dl2c_scale *scale;
} dl2c_observation;
typedef struct { int32_t index, other; dl2c_scale scale; } dl2c_output;
typedef struct {
  int32_t dimensions, observations, layers, outputs; const dl2c_observation *observation;
  const dl2c_layer *layer; const dl2c_output *output; double unit, tiny, largest, library;
} dl2c_network;
typedef struct { int32_t output, inside, symbol; double low, high; } dl2c_premise;
typedef struct { int32_t first, count, conclusion; } dl2c_case;
typedef struct {
  dl2c_formulas formulas; dl2c_network network; int32_t hypothesis, cases, computed;
  const dl2c_case *each; const dl2c_premise *premises;
} dl2c_question;
int dl2c_search_judge(const dl2c_question *q, const double *boxes, int64_t count, uint8_t *verdicts,
                      uint8_t *splits, int threads);
int dl2c_search_linear(const dl2c_question *q, const double *box, double *linear);
int dl2c_search_middle(const dl2c_question *q, const double *box, double *point);
int dl2c_search_ranges(const dl2c_question *q, const double *boxes, int64_t count, double *ranges);
int64_t dl2c_search_inside(const dl2c_question *q, const double *boxes, int64_t count);
"""
"""The interface of the library: the structures of its headers."""

LIBRARY = "libboxes.so"


@dataclass(frozen=True, slots=True)
class Tables:
    """A question as rows of its structures, in the order of `CDEF`. A layer is its activation, weights and
    biases; an observation its dimension, value, relative and absolute error, and rows of scales.
    """

    steps: tuple[tuple[int, int, int, float, float], ...]
    atoms: tuple[tuple[int, int, int, int, int], ...]
    nodes: tuple[tuple[int, int, int], ...]
    parts: tuple[int, ...]
    symbols: int
    dimensions: int
    observations: tuple[tuple[int, float, float, float, tuple[tuple[float, ...], ...]], ...]
    layers: tuple[tuple[int, Doubles, Doubles], ...]
    outputs: tuple[tuple[int, int, tuple[float, ...]], ...]
    arithmetic: tuple[float, float, float, float]
    hypothesis: int
    cases: tuple[tuple[int, int, int], ...]
    premises: tuple[tuple[int, int, int, float, float], ...]
    computed: int = 0


class Judge:
    """Judges boxes of one question. Raises `NativeError` where the library cannot be compiled or loaded."""

    def __init__(self, tables: Tables) -> None:
        self._ffi, self._lib = _library()
        self._kept: list[Any] = []
        self.dimensions, self.outputs = tables.dimensions, len(tables.outputs)
        self._question = self._made(tables)

    def verdicts(self, boxes: Doubles, threads: int) -> tuple[Bytes, Bytes]:
        """Of boxes (n, dimensions, 2), low and high: verdicts, and the dimension to split along."""
        given = np.ascontiguousarray(boxes, np.float64)
        count = len(given)
        verdicts, splits = np.empty(count, np.uint8), np.empty(count, np.uint8)
        done = self._lib.dl2c_search_judge(
            self._question,
            self._ffi.from_buffer("double[]", given),
            count,
            self._ffi.from_buffer("uint8_t[]", verdicts),
            self._ffi.from_buffer("uint8_t[]", splits),
            threads,
        )
        if not done:
            raise MemoryError
        return verdicts, splits

    def middle(self, box: Doubles) -> Doubles | None:
        """The middle of what the hypothesis leaves of a box (dimensions, 2); None where it leaves nothing."""
        given, point = np.ascontiguousarray(box, np.float64), np.empty(self.dimensions)
        left = self._lib.dl2c_search_middle(
            self._question,
            self._ffi.from_buffer("double[]", given),
            self._ffi.from_buffer("double[]", point),
        )
        return point if left else None

    def linear(self, box: Doubles) -> Doubles | None:
        """Bounds of the network's outputs on a box (dimensions, 2): (outputs, 2, 1 + dimensions), below and
        above, the constant and the slopes, over t between -1 and 1; None where nothing is known.
        """
        given = np.ascontiguousarray(box, np.float64)
        linear = np.empty((self.outputs, 2, 1 + self.dimensions))
        known = self._lib.dl2c_search_linear(
            self._question,
            self._ffi.from_buffer("double[]", given),
            self._ffi.from_buffer("double[]", linear),
        )
        return linear if known else None

    def ranges(self, boxes: Doubles) -> Doubles:
        """The outputs on boxes (n, dimensions, 2), scaled as requests: (n, outputs, 2), low and high."""
        given = np.ascontiguousarray(boxes, np.float64)
        found = np.empty((len(given), self.outputs, 2))
        boxes_in, ranges_out = (self._ffi.from_buffer("double[]", a) for a in (given, found))
        if not self._lib.dl2c_search_ranges(self._question, boxes_in, len(given), ranges_out):
            raise MemoryError
        return found

    def inside(self, boxes: Doubles) -> int:
        """How many of boxes (n, dimensions, 2) have states of the hypothesis, as far as contraction tells."""
        given = np.ascontiguousarray(boxes, np.float64)
        return self._lib.dl2c_search_inside(
            self._question, self._ffi.from_buffer("double[]", given), len(given)
        )

    def _array(self, kind: str, rows: Any) -> Any:
        """An array of C that lives as long as this."""
        made = self._ffi.new(f"{kind}[]", list(rows) or 1)
        self._kept.append(made)
        return made

    def _numbers(self, array: Doubles) -> Any:
        kept = np.ascontiguousarray(array, np.float64)
        self._kept.append(kept)
        return self._ffi.from_buffer("double[]", kept)

    def _made(self, t: Tables) -> Any:
        layers = [(len(b), w.shape[1], kind, self._numbers(w), self._numbers(b)) for kind, w, b in t.layers]
        observations = [
            (dimension, len(scales), value, relative, absolute, self._array("dl2c_scale", scales))
            for dimension, value, relative, absolute, scales in t.observations
        ]
        network = (
            *(t.dimensions, len(observations), len(layers), len(t.outputs)),
            self._array("dl2c_observation", observations),
            self._array("dl2c_layer", layers),
            self._array("dl2c_output", t.outputs),
            *t.arithmetic,
        )
        formulas = (
            self._array("dl2c_operation_step", t.steps),
            self._array("dl2c_atom", t.atoms),
            self._array("dl2c_node", t.nodes),
            self._array("int32_t", t.parts),
            t.symbols,
        )
        cases, premises = self._array("dl2c_case", t.cases), self._array("dl2c_premise", t.premises)
        return self._ffi.new(
            "dl2c_question *",
            (formulas, network, t.hypothesis, len(t.cases), t.computed, cases, premises),
        )


@lru_cache(maxsize=1)
def _library() -> tuple[Any, Any]:
    """cffi's FFI and the library."""
    ffi: Any = cffi.FFI()
    ffi.cdef(CDEF)

    def load(directory: Path) -> Any:
        try:
            return ffi.dlopen(str(directory / LIBRARY))
        except OSError as problem:
            raise NativeError(f"cannot load {LIBRARY}: {problem}") from None

    return ffi, cached(_key(), _build, load)


def _key() -> str:
    folder = cgen_dir() / "verify"
    compiler = find_compiler()
    texts = [path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.[ch]"))]
    facts = (texts, compiler.command, compiler.version, compiler.flags(native=False))
    return key_of(facts)


def _build(directory: Path) -> None:
    """One command."""
    compiler = find_compiler()
    source = str(cgen_dir() / "verify" / "search.c")
    flags = (*compiler.flags(native=False), *warning_flags(), *link_flags())
    run((*compiler.command, source, *flags, "-o", LIBRARY), directory)
    name_entry(directory, "boxes of states")
