"""What is asked of a policy, as data: on which states, what it observes, and what its outputs must satisfy.

A question is about real numbers. Its states are a box over `dimensions`, names of the model, restricted by
the hypothesis. The policy observes some of these and fixed numbers; its outputs are requests between
limits, or numbers of which the largest counts. Each case says what outputs it is about, and what then must
hold of the state and of the requests.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, TypeAlias

import numpy as np

from dl2c.diagnostics import CompileError, error
from dl2c.ir.logic import conjuncts, symbols
from dl2c.ir.model import Compare, Formula, Symbol, Term
from dl2c.policy.network import Layer, Scaling
from dl2c.source import NOWHERE, Span

Range: TypeAlias = tuple[Fraction, Fraction]
Arithmetic: TypeAlias = Literal["double", "float32", "real"]


class NotCovered(CompileError):
    """A model or a policy of which nothing can be said; the diagnostic says why."""

    def __init__(self, why: str, span: Span = NOWHERE, advice: str = "") -> None:
        super().__init__(
            error("policy-not-covered", "nothing can be proved of this policy", span, why, advice)
        )


@dataclass(frozen=True, slots=True)
class Observed:
    """A name that is observed, or its fixed value. It is `rounded` to float32 where the program does so, and
    then clipped to the limits.
    """

    name: str
    value: Symbol | Fraction
    low: float
    high: float
    rounded: bool


@dataclass(frozen=True, slots=True)
class Request:
    """An output as a request: stretched from -1..1 over the limits where `stretched`, and clipped to them.
    Where alternatives from 0 to `last` are spread over the limits, it is rounded to one of these.
    """

    low: Fraction
    high: Fraction
    stretched: bool
    symbol: Symbol
    last: int | None = None


@dataclass(frozen=True, slots=True)
class Premise:
    """A request, before it is clipped, is between two numbers, not at them where `inside`. `value` is what is
    then asked for, None where it is the request itself.
    """

    request: int
    low: Fraction | None
    high: Fraction | None
    inside: bool
    value: Fraction | None


@dataclass(frozen=True, slots=True)
class Case:
    """`premises` are about requests. `largest` are pairs of outputs: the first is at least the second. Where
    all that is so, the conclusion must hold.
    """

    premises: tuple[Premise, ...]
    largest: tuple[tuple[int, int], ...]
    conclusion: Formula
    about: str


@dataclass(frozen=True, slots=True)
class Question:
    """All of it. `requests` have symbols that occur in conclusions. `computed` are dimensions with the terms
    that the program computes for them; `lead` are the alternatives that the environment takes before, `given`
    names to which the claim gives a value. Where requests are `shares` of what is admissible, cases are about
    alternatives only, and conclude that there is something admissible.
    """

    dimensions: tuple[Symbol, ...]
    box: tuple[Range, ...]
    hypothesis: Formula
    observed: tuple[Observed, ...]
    scalings: tuple[Scaling, ...]
    layers: tuple[Layer, ...]
    requests: tuple[Request, ...]
    cases: tuple[Case, ...]
    arithmetic: Arithmetic
    computed: tuple[tuple[Symbol, Term], ...] = ()
    lead: tuple[tuple[str, int], ...] = ()
    given: tuple[tuple[str, Fraction], ...] = ()
    shares: bool = False

    @property
    def equations(self) -> tuple[Compare, ...]:
        """Those among what is assumed, but for what is computed."""
        found, computed = conjuncts(self.hypothesis), {symbol for symbol, _ in self.computed}
        return tuple(c for c in found if isinstance(c, Compare) and c.op == "=" and not symbols(c) & computed)

    @property
    def fixed(self) -> Mapping[str, Fraction]:
        """Names with one value: those of the claim, and what is observed."""
        seen = {o.name: o.value for o in self.observed if isinstance(o.value, Fraction)}
        return dict(self.given) | seen


def check_numbers(question: Question) -> None:
    """Raises `NotCovered` where the program cannot have a number of the network, but for its rounding: errors
    of the arithmetic are stated for numbers that are normal, or 0.
    """
    if question.arithmetic == "real":
        return
    numbers = [a for layer in question.layers for a in (layer.weight, layer.bias)]
    numbers += [a for scaling in question.scalings for a in (scaling.center, scaling.scale)]
    sizes = np.abs(np.concatenate([np.ravel(a) for a in numbers]))
    kind = np.finfo(np.float32 if question.arithmetic == "float32" else np.float64)
    if not np.all((sizes == 0) | ((sizes >= float(kind.tiny)) & (sizes <= float(kind.max)))):
        raise NotCovered(f"a number of its network is too large or too small for {question.arithmetic}")
