"""Certificates of proofs, and their checker.

A certificate is the tree of boxes of each question: for every box, level after level, the dimension along
which it is split, or what decided it; with digests of the question and of the tree. The checker makes the
question of model and policy again, as the search does: that this asks the right thing is trusted. It sees
that the tree covers the box, and decides every leaf anew, in arithmetic of its own (`fixed_point`,
`hyperbolic`, `linear_bounds`): it shares no enclosure with the search, nor what the question says of computed
values. Where its bounds are not as tight it splits a leaf further. Leaves that Z3 decided are given to Z3
again, with these bounds.
"""

import base64
import hashlib
import json
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any

from dl2c.inputs import checked_input, read_json
from dl2c.ir.logic import conjunction, conjuncts, oriented, symbols
from dl2c.ir.model import Add, Compare, Formula, Number, Sub, Symbol
from dl2c.policy.network import PolicyError
from dl2c.policy_proof.fixed_point import ONE, Ends, down, judged, programmed, up
from dl2c.policy_proof.leaves import decided
from dl2c.policy_proof.linear_bounds import Form, NetworkBounds
from dl2c.policy_proof.question import Case, Question, check_numbers
from dl2c.policy_proof.search import Before
from dl2c.policy_proof.tree import BY_BOUNDS, BY_SOLVER, LEFT_OPEN, check_levels, leaves
from dl2c.smt.query import Oracle

FORMAT, VERSION = "dl2c-policy-proof", 1
SEARCH = "dl2c-policy-search"
"""The format of a search that is not finished."""

KINDS = {FORMAT: "certificate", SEARCH: "unfinished search"}

MAX_BYTES = 2**28
MOST_SPLITS = 16
"""How often a leaf is split further."""

SOLVER_SECONDS = 10.0
"""For a case of a leaf."""


class CertificateError(PolicyError):
    """A certificate that does not prove what it is said to prove."""


@dataclass(frozen=True, slots=True)
class Checked:
    """How many leaves there are, and how many of them rest on Z3."""

    leaves: int
    by_solver: int


def digest(question: Question) -> str:
    """What a certificate is about: every number of the question, and of the policy."""
    parts = [repr(getattr(question, n)) for n in ("dimensions", "box", "hypothesis", "observed", "requests")]
    parts += [repr(question.cases), question.arithmetic]
    made = hashlib.sha256("\0".join(parts).encode())
    for scaling in question.scalings:
        made.update(scaling.center.tobytes() + scaling.scale.tobytes() + repr(scaling.clip).encode())
    for layer in question.layers:
        made.update(f"{layer.weight.shape}{layer.activation}".encode())
        made.update(layer.weight.tobytes() + layer.bias.tobytes())
    return made.hexdigest()


def certificate(questions: Sequence[Question], trees: Sequence[Sequence[bytes]]) -> str:
    """The text of a certificate."""
    return _written(FORMAT, map(_entry, questions, trees))


def unfinished(questions: Sequence[Question], found: Sequence[Before]) -> str:
    """The text of a search, as far as it is."""
    pairs = zip(questions, found, strict=True)
    return _written(SEARCH, (_entry(q, f.tree) | {"seconds": list(f.seconds)} for q, f in pairs))


def _written(kind: str, entries: Iterable[dict[str, Any]]) -> str:
    return json.dumps({"format": kind, "version": VERSION, "proofs": list(entries)}, indent=1) + "\n"


def _entry(question: Question, levels: Sequence[bytes]) -> dict[str, Any]:
    content = b"".join(levels)
    return {
        "question": digest(question),
        "levels": [len(level) for level in levels],
        "tree": base64.b64encode(zlib.compress(content, 9)).decode(),
        "digest": hashlib.sha256(content).hexdigest(),
    }


def check(path: Path, questions: Sequence[Question]) -> Checked:
    """Check a certificate. Raises `CertificateError`, `NotCovered`, `OSError`."""
    count = solved = 0
    for question, before in zip(questions, read_trees(path, questions, FORMAT), strict=True):
        checker = _Checker(question)
        for boxes, codes in leaves(question, before.tree):
            for box, code in zip(boxes.tolist(), codes.tolist(), strict=True):
                count += 1
                solved += code == BY_SOLVER
                if not checker.decides(tuple((low, high) for low, high in box), code):
                    raise CertificateError(f"{path}: a box is not proved: {box}")
    return Checked(count, solved)


def begun(path: Path, questions: Sequence[Question]) -> list[Before]:
    """A search that is not finished; one that has not begun where there is no such file. Raises
    `CertificateError`, `OSError`.
    """
    return read_trees(path, questions, SEARCH) if path.exists() else [Before() for _ in questions]


def read_trees(path: Path, questions: Sequence[Question], kind: str) -> list[Before]:
    """The tree of each question, in a certificate (`FORMAT`) or in a search that is not finished (`SEARCH`),
    and the seconds where that has them. Raises `CertificateError`, `OSError`.
    """
    what = KINDS[kind]
    with checked_input(CertificateError, f"{path} is no {what}"):
        top = read_json(path, MAX_BYTES)
        if top["format"] != kind or top["version"] != VERSION:
            raise CertificateError("it is one of another version, or another file")
        entries: list[Any] = list(top["proofs"])
        digests = [entry["question"] for entry in entries]
        trees = [_tree(entry) for entry in entries]
    if digests != [digest(q) for q in questions]:
        raise CertificateError(f"{path} is about another model, policy or claim")
    with checked_input(CertificateError, f"{path} is no {what}"):
        for question, tree in zip(questions, trees, strict=True):
            check_levels(question, tree)
        times = [_seconds(e, len(t)) if kind == SEARCH else () for e, t in zip(entries, trees, strict=True)]
        return [Before(tuple(t), s) for t, s in zip(trees, times, strict=True)]


def _seconds(entry: Mapping[str, Any], levels: int) -> tuple[float, ...]:
    """When each level was judged. Raises what is `MALFORMED`."""
    found = tuple(float(v) for v in entry["seconds"])
    if len(found) != levels or not all(0 <= a <= b < inf for a, b in pairwise((0.0, *found))):
        raise ValueError("its seconds do not fit its levels")
    return found


def _tree(entry: Mapping[str, Any]) -> list[bytes]:
    packed = zlib.decompressobj()
    try:
        content = packed.decompress(base64.b64decode(entry["tree"], validate=True), MAX_BYTES)
    except zlib.error as problem:
        raise CertificateError(f"the tree cannot be read: {problem}") from None
    if hashlib.sha256(content).hexdigest() != entry["digest"] or not packed.eof:
        raise CertificateError("the tree is not what it was")
    levels: list[bytes] = []
    for size in entry["levels"]:
        levels.append(content[:size])
        content = content[size:]
    if content:
        raise CertificateError("the tree is longer than its levels")
    return levels


Box = tuple[tuple[float, float], ...]


def _halves(box: Box, at: int) -> tuple[Box, Box]:
    low, high = box[at]
    middle = low + 0.5 * (high - low)
    return (*box[:at], (low, middle), *box[at + 1 :]), (*box[:at], (middle, high), *box[at + 1 :])


class _Checker:
    def __init__(self, question: Question) -> None:
        check_numbers(question)
        self.question = question
        self.network = NetworkBounds(question)
        self.computed = dict(question.computed)
        self.free = [k for k, s in enumerate(question.dimensions) if s not in self.computed]
        self.widths = [max(float(high - low), 1e-300) for low, high in question.box]
        self.hypothesis = conjunction(
            c for c in conjuncts(question.hypothesis) if not symbols(c) & {*self.computed}
        )
        conditions = conjuncts(oriented(self.hypothesis))
        self.ordered = [c for c in conditions if isinstance(c, Compare) and c.op in ("<", "<=")]
        pairs = dict.fromkeys(pair for case in question.cases for pair in case.largest)
        self.wanted = [*((k, -1) for k in range(len(question.requests))), *pairs]

    def decides(self, box: Box, code: int, splits: int = MOST_SPLITS) -> bool:
        """Whether a leaf is what it is said to be, perhaps after splitting it. Its limits in dimensions that
        are computed are not used.
        """
        if code == LEFT_OPEN:
            return False
        dimensions = self.question.dimensions
        values = {dimensions[k]: (down(Fraction(box[k][0])), up(Fraction(box[k][1]))) for k in self.free}
        if judged(self.hypothesis, values) == "false" or not self._narrow(values):
            return True
        close = self._complete(values)
        if code == BY_SOLVER:
            return close is not None and self._solver_proves(values, close)
        if code == BY_BOUNDS and close is not None and self._proves(values):
            return True
        if splits == 0 or not self.free:
            return False
        widest = max(self.free, key=lambda k: (box[k][1] - box[k][0]) / self.widths[k])
        return all(self.decides(half, code, splits - 1) for half in _halves(box, widest))

    def _narrow(self, values: dict[Symbol, Ends]) -> bool:
        """Limit names to what the hypothesis compares them with; whether something is left."""
        for atom in self.ordered:
            if isinstance(atom.left, Symbol) and isinstance(atom.right, Number):
                low, high = values[atom.left]
                values[atom.left] = low, min(high, up(atom.right.value))
            if isinstance(atom.left, Number) and isinstance(atom.right, Symbol):
                low, high = values[atom.right]
                values[atom.right] = max(low, down(atom.left.value)), high
        return all(low <= high for low, high in values.values())

    def _complete(self, values: dict[Symbol, Ends]) -> Formula | None:
        """Add what the program computes for the states of a box; how close that is to its terms. None where
        that is not known.
        """
        close: list[Formula] = []
        for symbol, term in self.question.computed:
            found = programmed(term, values, self.network.rounding)
            if found is None:
                return None
            (low, high), error = found
            values[symbol] = low - error, high + error
            slack = Number(Fraction(error, ONE))
            close += [Compare("<=", Sub(term, slack), symbol), Compare("<=", symbol, Add(term, slack))]
        return conjunction(close)

    def _solver_proves(self, values: Mapping[Symbol, Ends], close: Formula) -> bool:
        ends = [values[s] for s in self.question.dimensions]
        bounds = self.network.outputs(ends, self.wanted)
        if bounds is None:
            return False
        linear = [[[Fraction(v, ONE) for v in (f.middle, *f.slopes)] for f in pair] for pair in bounds]
        middles = [(low + high) >> 1 for low, high in ends]
        around = zip(middles, ends, strict=True)
        centers = [(Fraction(m, ONE), Fraction(max(high - m, m - low), ONE)) for m, (low, high) in around]
        asked = replace(self.question, hypothesis=conjunction([self.hypothesis, close]))
        box = [[Fraction(low, ONE), Fraction(high, ONE)] for low, high in ends]
        return decided(asked, linear, box, centers, Oracle(SOLVER_SECONDS, 60.0)).proved

    def _proves(self, values: Mapping[Symbol, Ends]) -> bool:
        bounds = self.network.outputs([values[s] for s in self.question.dimensions], self.wanted)
        if bounds is None:
            return False
        ranges = [self._range(k, *pair) for k, pair in enumerate(bounds)]
        return all(self._ends_well(case, ranges, dict(values)) for case in self.question.cases)

    def _range(self, k: int, below: Form, above: Form) -> Ends:
        """The values of an output, stretched as a request is."""
        low = below.middle - sum(map(abs, below.slopes)) - below.radius
        high = above.middle + sum(map(abs, above.slopes)) + above.radius
        requests = self.question.requests
        if k >= len(requests) or not requests[k].stretched:
            return low, high
        least, most = requests[k].low, requests[k].high
        slope, size = (most - least) / 2, 2 * (abs(least) + abs(most))
        largest = Fraction(max(abs(low), abs(high)), ONE)
        error = self.network.rounding.error(up(slope * largest + size), 8)
        ends = [least + slope * (1 + Fraction(v, ONE)) for v in (low, high)]
        return down(ends[0]) - error, up(ends[1]) + error

    def _ends_well(self, case: Case, ranges: Sequence[Ends], values: dict[Symbol, Ends]) -> bool:
        """Whether a case is impossible, or its conclusion holds."""
        nonzero: set[Symbol] = set()
        for p in case.premises:
            low, high = ranges[p.request]
            low = low if p.low is None else max(low, down(p.low))
            high = high if p.high is None else min(high, up(p.high))
            if low > high:
                return True
            symbol = self.question.requests[p.request].symbol
            if p.value is None:
                values[symbol] = low, high
                if p.low is not None and p.high is not None and (p.low >= 0 or p.high <= 0):
                    nonzero.add(symbol)
        for pair in case.largest:
            if ranges[self.wanted.index(pair)][1] < 0:
                return True
        assumed = conjuncts(self.hypothesis)
        conclusion = conjunction(c for c in conjuncts(case.conclusion) if c not in assumed)
        return judged(conclusion, values, frozenset(nonzero)) == "true"
