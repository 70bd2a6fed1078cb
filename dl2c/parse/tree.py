"""The syntax of dL as KeYmaera X reads it: terms, formulas, programs, archives.

Constructors are named after KeYmaera X's own. Every node carries the span it was
read from; spans never take part in equality, so two texts with the same meaning
compare equal. `if`, `<-` and doubled arguments are resolved while parsing, as
KeYmaera X does, so no node stands for them.

What a player of a hybrid game decides is `dual` where that is the other player. The parser makes
`Dual` nodes and leaves it False; `resolve.players` does away with the one and sets the other.

Annotations inside programs (`@choice`, `@fallback`) are kept at the statement before which they stand.
"""

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal, TypeAlias

from dl2c.source import NOWHERE, Span


def _span() -> Span:
    return field(default=NOWHERE, compare=False, repr=False, kw_only=True)  # pyright: ignore[reportReturnType]


def _annotations() -> tuple["Annotation", ...]:
    return field(default=(), compare=False, repr=False, kw_only=True)  # pyright: ignore[reportReturnType]


def _dual() -> bool:
    return field(default=False, repr=False, kw_only=True)  # pyright: ignore[reportReturnType]


@dataclass(frozen=True, slots=True)
class Number:
    """A non-negative decimal, exact. `-2` is `Neg(Number(2))`."""

    value: Fraction
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Variable:
    """A bare name: a program variable, or a constant used without `()`."""

    name: str
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class DifferentialSymbol:
    """`x'` as a term."""

    name: str
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class FuncOf:
    """`f(t1, ..., tn)`; `f()` has no arguments."""

    name: str
    args: tuple["Term", ...]
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class UnitFunctional:
    """`f(||)` or `f(|x|)`: uniform-substitution syntax. `taboo` lists the names between the bars."""

    name: str
    taboo: tuple[str, ...]
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Neg:
    child: "Term"
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class BinaryTerm:
    """An operation on two terms: one of the five below."""

    left: "Term"
    right: "Term"
    span: Span = _span()


class Plus(BinaryTerm):
    __slots__ = ()


class Minus(BinaryTerm):
    __slots__ = ()


class Times(BinaryTerm):
    __slots__ = ()


class Divide(BinaryTerm):
    __slots__ = ()


class Power(BinaryTerm):
    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Differential:
    """`(e)'`."""

    child: "Term"
    span: Span = _span()


Term: TypeAlias = (
    Number
    | Variable
    | DifferentialSymbol
    | FuncOf
    | UnitFunctional
    | Neg
    | Plus
    | Minus
    | Times
    | Divide
    | Power
    | Differential
)

Comparison: TypeAlias = Literal["=", "!=", "<", "<=", ">", ">="]


@dataclass(frozen=True, slots=True)
class Truth:
    """`true` or `false`."""

    value: bool
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Compare:
    """`left op right`."""

    op: Comparison
    left: Term
    right: Term
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class PredOf:
    """`p(t1, ..., tn)`; a bare `p` in formula position is `p()`."""

    name: str
    args: tuple[Term, ...]
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class UnitPredicational:
    """`p(||)` or `p(|x|)`: uniform-substitution syntax."""

    name: str
    taboo: tuple[str, ...]
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class PredicationalOf:
    """`P{F}`: uniform-substitution syntax."""

    name: str
    child: "Formula"
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Not:
    child: "Formula"
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Connective:
    """Two formulas joined: one of the four below."""

    left: "Formula"
    right: "Formula"
    span: Span = _span()


class And(Connective):
    __slots__ = ()


class Or(Connective):
    __slots__ = ()


class Imply(Connective):
    __slots__ = ()


class Equiv(Connective):
    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Quantified:
    variable: str
    child: "Formula"
    span: Span = _span()


class Forall(Quantified):
    __slots__ = ()


class Exists(Quantified):
    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Modal:
    """A formula about the states after a program: `[program] child` or `<program> child`."""

    program: "Program"
    child: "Formula"
    span: Span = _span()


class Box(Modal):
    __slots__ = ()


class Diamond(Modal):
    __slots__ = ()


@dataclass(frozen=True, slots=True)
class DifferentialFormula:
    """`(F)'`."""

    child: "Formula"
    span: Span = _span()


Formula: TypeAlias = (
    Truth
    | Compare
    | PredOf
    | UnitPredicational
    | PredicationalOf
    | Not
    | And
    | Or
    | Imply
    | Equiv
    | Forall
    | Exists
    | Box
    | Diamond
    | DifferentialFormula
)


@dataclass(frozen=True, slots=True)
class Assign:
    """`name := term;`, or `name' := term;` when `differential`."""

    name: str
    term: Term
    differential: bool = False
    annotations: tuple["Annotation", ...] = _annotations()
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class AssignAny:
    """`name := *;`"""

    name: str
    differential: bool = False
    dual: bool = _dual()
    annotations: tuple["Annotation", ...] = _annotations()
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Test:
    """`?formula;`"""

    __test__ = False  # not a test case, whatever its name suggests to pytest

    formula: Formula
    annotations: tuple["Annotation", ...] = _annotations()
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class ProgramConst:
    """`a;`: a call of a defined program, or a program symbol."""

    name: str
    annotations: tuple["Annotation", ...] = _annotations()
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class AtomicODE:
    """`name' = term` inside an ODE."""

    name: str
    term: Term
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class DifferentialProgramConst:
    """`c` or `c{|x|}` inside an ODE; `taboo` is None without bars."""

    name: str
    taboo: tuple[str, ...] | None = None
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class ODESystem:
    """`{x' = f(x), ... & domain}`; the domain is `true` where none is written.

    `invariants` are those of an attached `@invariant(...)`; they are a proof hint and
    take no part in equality.
    """

    equations: tuple[AtomicODE | DifferentialProgramConst, ...]
    domain: Formula
    invariants: tuple[Formula, ...] = field(default=(), compare=False)
    dual: bool = _dual()
    annotations: tuple["Annotation", ...] = _annotations()
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Compose:
    """`left right`: one after the other, right-nested where the text has no braces."""

    left: "Program"
    right: "Program"
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Choice:
    """`left ++ right`."""

    left: "Program"
    right: "Program"
    dual: bool = _dual()
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Loop:
    """`{child}*`; `invariants` as for an ODE."""

    child: "Program"
    invariants: tuple[Formula, ...] = field(default=(), compare=False)
    dual: bool = _dual()
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Dual:
    """`{child}^@`, and what demonic choice and repetition abbreviate: a hybrid game."""

    child: "Program"
    span: Span = _span()


Statement: TypeAlias = Assign | AssignAny | Test | ProgramConst | ODESystem
Program: TypeAlias = Statement | Compose | Choice | Loop | Dual

Expression: TypeAlias = Term | Formula | Program


@dataclass(frozen=True, slots=True)
class Annotation:
    """One `@name: attribute=value, ...` found in a comment, its values still text.

    `attributes` holds (attribute, value text, span of the value) in the order written;
    an attribute without `=` has an empty value. `span` covers the annotation, `name`
    comes without its `@`.
    """

    name: str
    attributes: tuple[tuple[str, str, Span], ...]
    span: Span = _span()


Sort: TypeAlias = Literal["Real", "Bool", "HP"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """`Real x` in the parameter list of a definition."""

    name: str
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Declaration:
    """One declared name of a `Definitions` or `ProgramVariables` block.

    `parameters` is None for a plain name (`Real c;`), a tuple for `Real f(Real x)`,
    empty for `Bool p()`. `body` is the definition, or None; a program that defines a Real is an
    implicit definition: values at time 0, then a differential equation, both of which the functions
    defined together share. `span` covers the name.
    """

    sort: Sort
    name: str
    parameters: tuple[Parameter, ...] | None
    body: Expression | None
    annotations: tuple[Annotation, ...] = field(default=(), compare=False)
    span: Span = _span()

    @property
    def implicit(self) -> bool:
        return self.sort == "Real" and isinstance(self.body, Program)


@dataclass(frozen=True, slots=True)
class Entry:
    """One archive entry: a problem with everything declared for it.

    `program_annotations` are the annotations that stand inside programs (`@choice`,
    `@fallback`), in source order, those before no statement too; `problem_annotations`
    stand above `Problem`.
    `imports` are the library names imported, in full (`kyx.math.abs`).
    """

    kind: str
    name: str
    imports: tuple[str, ...]
    definitions: tuple[Declaration, ...]
    variables: tuple[Declaration, ...]
    problem: Formula
    problem_annotations: tuple[Annotation, ...] = field(default=(), compare=False)
    program_annotations: tuple[Annotation, ...] = field(default=(), compare=False)
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Archive:
    """A whole file: its entries in order. Shared definitions are already part of each."""

    entries: tuple[Entry, ...]
    span: Span = _span()
