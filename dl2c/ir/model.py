"""The meaning of a model, as data: what one step of the environment does.

Comes from `lower`; read by the reference interpreter, the path enumeration, the
sampler and the code generator. Assumes that every name is bound and every
definition expanded. Formulas are in negation normal form without quantifiers, so
that an atom with an undefined subterm is false wherever it stands.

Numbers are exact rationals. Floating-point evaluation rounds each number once and
each operation once, in the order of the tree.
"""

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal, TypeAlias

from dl2c.options import Duration, MaskDepth
from dl2c.source import NOWHERE, Span


def _span() -> Span:
    return field(default=NOWHERE, compare=False, repr=False, kw_only=True)  # pyright: ignore[reportReturnType]


# Terms ------------------------------------------------------------------------

Kind: TypeAlias = Literal["variable", "constant", "input", "time", "start"]
"""Program variable, episode constant, agent input (by key), time since a flow began, value at its start."""


@dataclass(frozen=True, slots=True)
class Number:
    value: Fraction


@dataclass(frozen=True, slots=True)
class Symbol:
    name: str
    kind: Kind


@dataclass(frozen=True, slots=True)
class Neg:
    child: "Term"


@dataclass(frozen=True, slots=True)
class Binary:
    """An arithmetic operation on two terms: one of the four below."""

    left: "Term"
    right: "Term"


class Add(Binary):
    __slots__ = ()


class Sub(Binary):
    __slots__ = ()


class Mul(Binary):
    __slots__ = ()


class Div(Binary):
    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Pow:
    """`base` to a positive integer power, by repeated multiplication.

    x^(2k) is (x^k)*(x^k) and x^(2k+1) is x*x^(2k): this order is part of the meaning.
    """

    base: "Term"
    exponent: int


@dataclass(frozen=True, slots=True)
class Call:
    """A function by its name in `functions.FUNCTIONS`."""

    function: str
    args: tuple["Term", ...]


Term: TypeAlias = Number | Symbol | Neg | Add | Sub | Mul | Div | Pow | Call

LARGEST_STATE = Fraction(10**100)
"""State values beyond this magnitude count as infinite, so that terms of them rarely overflow."""

ZERO = Number(Fraction(0))
ONE = Number(Fraction(1))

# Formulas ---------------------------------------------------------------------

Comparison: TypeAlias = Literal["=", "!=", "<", "<=", ">", ">="]


@dataclass(frozen=True, slots=True)
class Truth:
    value: bool


@dataclass(frozen=True, slots=True)
class Compare:
    op: Comparison
    left: Term
    right: Term
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Junction:
    """A conjunction or a disjunction of several formulas."""

    children: tuple["Formula", ...]


class And(Junction):
    __slots__ = ()


class Or(Junction):
    __slots__ = ()


Formula: TypeAlias = Truth | Compare | And | Or

TRUE = Truth(True)
FALSE = Truth(False)

# Programs ---------------------------------------------------------------------

Role: TypeAlias = Literal["agent", "env", "reset"]
"""Who decides: the agent; the environment, at random; or chance too, in the program before the loop."""


@dataclass(frozen=True, slots=True)
class Assign:
    variable: str
    term: Term
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class AssignAny:
    """`variable := *`. `key` names the decision (`assign_x`); its value is the input of that name."""

    variable: str
    key: str
    role: Role = "agent"
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Test:
    __test__ = False

    formula: Formula
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Alternative:
    """One branch of a choice; `fallback` where it is marked `@fallback`. Of a loop, how many `times` its
    body is run.
    """

    body: "Block"
    fallback: bool = False
    times: int | None = None
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Choice:
    """An n-ary choice that is a decision. `key` is `choice_<k>`."""

    key: str
    alternatives: tuple[Alternative, ...]
    role: Role = "agent"
    name: str = ""
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class If:
    """Two alternatives with complementary first tests: no decision.

    `otherwise` is the negation of `condition` in normal form; where both are false
    (an undefined subterm) the run blocks.
    """

    condition: Formula
    otherwise: Formula
    then: "Block"
    orelse: "Block"
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class While:
    """`{?condition; body}*; ?otherwise`: no decision. Its head is a cut point of runs."""

    condition: Formula
    otherwise: Formula
    body: "Block"
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Repeat:
    """`{body}*` inside a step: a decision how often, at most `most` times. `key` is `loop_<k>`.

    Decisions of the body are made once: they have the same key, and so the same outcome, each time.
    """

    key: str
    body: "Block"
    most: int
    role: Role = "agent"
    span: Span = _span()

    @property
    def name(self) -> str:
        return ""

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """The choice that it stands for: alternative k runs the body k times."""
        return tuple(Alternative(self.body * k, times=k, span=self.span) for k in range(self.most + 1))

    @property
    def choice(self) -> Choice:
        """The same decision with its iterations written out."""
        return Choice(self.key, self.alternatives, self.role, span=self.span)


@dataclass(frozen=True, slots=True)
class Evolve:
    """Follow `Model.flows[flow]`."""

    flow: int
    span: Span = _span()


Statement: TypeAlias = Assign | AssignAny | Test | Choice | If | While | Repeat | Evolve
Block: TypeAlias = tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Horizon:
    """A top-level domain conjunct `clock <= bound` with clock' = 1 and a bound constant along the flow."""

    clock: str
    bound: Term


@dataclass(frozen=True, slots=True)
class Flow:
    """`{equations & domain}`.

    `domain` must hold where the flow begins. `watched` is what is left of it along the flow,
    without the conjuncts that `horizons` stand for and without invariants: equalities whose Lie
    derivative is zero, which are relaxed by the tolerance where the flow begins. `cap` is a
    further limit of the duration in seconds: an explicit `dt`, or the default where there is no
    horizon. A flow with a `reach` lasts to the end of its domain where that is met within so many
    seconds, at least `cap`; else for `cap`. How much of that it lasts is `drawn` where chance decides.
    """

    equations: tuple[tuple[str, Term], ...]
    domain: Formula
    watched: Formula
    horizons: tuple[Horizon, ...]
    cap: Fraction | None
    invariants: tuple[Compare, ...] = ()
    reach: Fraction | None = None
    drawn: bool = False
    span: Span = _span()


# Annotated parts --------------------------------------------------------------

Category: TypeAlias = Literal["safety", "progress", "stability"]
EndAction: TypeAlias = Literal["terminate", "truncate", "continue"]
Status: TypeAlias = Literal["none", "success", "failure"]


@dataclass(frozen=True, slots=True)
class Trigger:
    action: EndAction
    status: Status


@dataclass(frozen=True, slots=True)
class Predicate:
    """An annotated predicate, its parameters bound (semantics 1 and 6).

    `formula` and `relaxed` are P, exact and with each atom of the source relaxed by the tolerance;
    `along`, unless None, is watched along flows, relaxed by what `slacks` are where one begins.
    `reward`, `penalty`, `shape` are terms over the post-state, None where absent. `due` is when a
    progress obligation must hold: P is then required wherever it is true; None without obligation.
    """

    name: str
    category: Category
    formula: Formula
    relaxed: Formula
    reward: Term | None = None
    penalty: Term | None = None
    shape: Term | None = None
    on_success: Trigger | None = None
    on_failure: Trigger | None = None
    due: Formula | None = None
    along: Formula | None = None
    slacks: tuple[tuple[Symbol, Term], ...] = ()
    span: Span = _span()


Rank: TypeAlias = tuple[int, int, int, bool]


def rank(k: int, predicate: Predicate, trigger: Trigger) -> Rank:
    """The place of an ending of predicate k among all that fire at once; the least wins (semantics 6).

    Of one predicate both may fire: an obligation that failed on the way, met in the end.
    """
    status = ("failure", "success", "none").index(trigger.status)
    category = ("safety", "progress", "stability").index(predicate.category)
    return status, category, k, trigger != predicate.on_failure


@dataclass(frozen=True, slots=True)
class Bound:
    """A closed interval of exact decimals; None is unbounded on that side."""

    low: Fraction | None
    high: Fraction | None


UNBOUNDED = Bound(None, None)


@dataclass(frozen=True, slots=True)
class Variable:
    """A program variable. `observed` where an observation shows it.

    `initial` is "sampled" (jointly with the constants, inside `bound` and the precondition) or
    "zero" (no bound, not in the precondition, written before any read).
    """

    name: str
    bound: Bound = UNBOUNDED
    initial: Literal["sampled", "zero"] = "sampled"
    observed: bool = False
    description: str = ""
    unit: str = ""
    plot: str = "none"
    span: Span = _span()

    @property
    def symbol(self) -> Symbol:
        return Symbol(self.name, "variable")


@dataclass(frozen=True, slots=True)
class Constant:
    """A parameter of the episode: sampled inside `bound` at reset, or fixed to `value`.

    `observed` where an observation shows a sampled value.
    """

    name: str
    bound: Bound = UNBOUNDED
    value: Fraction | None = None
    observed: bool = True
    description: str = ""
    unit: str = ""
    plot: str = "none"
    span: Span = _span()

    @property
    def symbol(self) -> Symbol:
        return Symbol(self.name, "constant")


# Scene ------------------------------------------------------------------------

SceneRole: TypeAlias = Literal["agent", "unsafe", "goal", "world"]
"""Who a shape is: what is controlled, what it must not touch, where it is to go, anything else."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A shape of a picture: `kind` is a key of `scene.FORMS`, `arguments` are terms over the state by name,
    in the order of the form; a point has two of them. One that has no value is not drawn.
    """

    kind: str
    role: SceneRole
    name: str
    arguments: tuple[tuple[str, tuple[Term, ...]], ...]
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Scene:
    """What a picture of a state shows. `shaded` are two variables in whose plane a picture marks where
    @safety predicates fail; empty for none. Without shapes there is no scene.
    """

    shapes: tuple[Shape, ...] = ()
    shaded: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Model:
    """One environment.

    A step is one execution of `lead; body`: `lead` is executed as soon as the step before it, or the
    reset, is over (see `leading`). `prefix` is executed once, after an initial state is drawn. Without
    `loops` episodes are one step long. `precondition` is P, `postcondition` Q, None where the program's
    suffix changes what Q reads. `duration` is who decides how long a flow lasts. `continuous`: safety is
    watched along flows with which a step may end; `everywhere`: along the others too. `mask_depth` is how
    far masks follow a step. A run that enters `while` loops more than `max_loop` times diverges.
    """

    name: str
    source: str
    variables: tuple[Variable, ...]
    constants: tuple[Constant, ...]
    precondition: Formula
    prefix: Block
    body: Block
    loops: bool
    flows: tuple[Flow, ...]
    predicates: tuple[Predicate, ...]
    postcondition: Formula | None
    tolerance: Fraction = Fraction(1, 10**9)
    duration: Duration = "max"
    continuous: bool = False
    everywhere: bool = False
    mask_depth: MaskDepth = "flow"
    lead: Block = ()
    max_loop: int = 10_000
    scene: Scene = Scene()

    @property
    def drawn(self) -> tuple[Variable | Constant, ...]:
        """What is drawn at reset: variables, then constants."""
        variables = (v for v in self.variables if v.initial == "sampled")
        return (*variables, *(c for c in self.constants if c.value is None))

    @property
    def sampled(self) -> tuple[str, ...]:
        """The names of what is drawn at reset."""
        return tuple(item.name for item in self.drawn)
