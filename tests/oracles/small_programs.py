"""Hybrid programs small enough to be enumerated: data, and their text in KeYmaera X's language."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction


@dataclass(frozen=True)
class Term:
    """The sum of coefficient * variable^power; the variable of a number is empty."""

    parts: tuple[tuple[Fraction, str, int], ...]

    def __str__(self) -> str:
        texts: list[str] = []
        for coefficient, variable, power in self.parts:
            size = abs(coefficient)
            factor = variable if power == 1 else f"{variable}^{power}"
            text = str(size) if not variable else factor if size == 1 else f"{size}*{factor}"
            sign = "-" if coefficient < 0 else "+" if texts else ""
            texts.append(f" {sign} {text}" if texts else f"{sign}{text}")
        return "".join(texts) or "0"


def number(value: Fraction | int | str) -> Term:
    return Term(((Fraction(value), "", 0),))


def variable(name: str) -> Term:
    return Term(((Fraction(1), name, 1),))


@dataclass(frozen=True)
class Atom:
    left: Term
    op: str
    right: Term

    def __str__(self) -> str:
        return f"{self.left} {self.op} {self.right}"


@dataclass(frozen=True)
class Both:
    parts: tuple["Formula", ...]

    def __str__(self) -> str:
        return (
            " & ".join(f"({part})" if not isinstance(part, Atom) else str(part) for part in self.parts)
            or "true"
        )


@dataclass(frozen=True)
class Either:
    parts: tuple["Formula", ...]

    def __str__(self) -> str:
        return " | ".join(f"({part})" if not isinstance(part, Atom) else str(part) for part in self.parts)


@dataclass(frozen=True)
class Negation:
    of: "Formula"

    def __str__(self) -> str:
        return f"!({self.of})"


Formula = Atom | Both | Either | Negation
TRUE = Both(())


@dataclass(frozen=True)
class Assign:
    variable: str
    value: Term

    def __str__(self) -> str:
        return f"{self.variable} := {self.value};"


@dataclass(frozen=True)
class Test:
    __test__ = False
    condition: Formula

    def __str__(self) -> str:
        return f"?{self.condition};" if isinstance(self.condition, Atom) else f"?({self.condition});"


@dataclass(frozen=True)
class Flow:
    equations: tuple[tuple[str, Term], ...]
    domain: tuple[Formula, ...]

    def __str__(self) -> str:
        motion = ", ".join(f"{name}' = {term}" for name, term in self.equations)
        parts = [str(part) if isinstance(part, Atom) else f"({part})" for part in self.domain]
        return f"{{{motion}{' & ' if parts else ''}{' & '.join(parts)}}}"


@dataclass(frozen=True)
class Choice:
    """`number` counts choices in the order of the text."""

    number: int
    alternatives: tuple["Program", ...]

    def __str__(self) -> str:
        return "{" + " ++ ".join("{" + listed(program) + "}" for program in self.alternatives) + "}"


@dataclass(frozen=True)
class If:
    condition: Formula
    then: "Program"
    otherwise: "Program"

    def __str__(self) -> str:
        rest = f" else {{{listed(self.otherwise)}}}" if self.otherwise else ""
        return f"if ({self.condition}) {{{listed(self.then)}}}{rest}"


Statement = Assign | Test | Flow | Choice | If
Program = tuple[Statement, ...]


def listed(program: Program) -> str:
    return " ".join(map(str, program))


@dataclass(frozen=True)
class Ending:
    """What `on_success` or `on_failure` says."""

    action: str
    status: str

    def __str__(self) -> str:
        return f"{self.action}:{self.status}"


@dataclass(frozen=True)
class Predicate:
    """An annotated one. `due` has the conditions of its obligations in the postcondition."""

    name: str
    category: str
    condition: Formula
    reward: Term | None = None
    penalty: Term | None = None
    shape: Term | str | None = None
    """A term, or the name of a predicate that stands for its distance."""
    on_success: Ending | None = None
    on_failure: Ending | None = None
    due: tuple[Formula, ...] = ()
    due_text: str = ""

    def annotation(self, call: str) -> str:
        said = {
            "reward": self.reward,
            "penalty": self.penalty,
            "shape": f"{self.shape}{call}" if isinstance(self.shape, str) else self.shape,
            "on_success": self.on_success,
            "on_failure": self.on_failure,
        }
        listed = ", ".join(f"{key}={value}" for key, value in said.items() if value is not None)
        return f"/* @{self.category}: {listed} */" if listed else f"/* @{self.category} */"


@dataclass(frozen=True)
class Problem:
    """`[{body}*] Q` or `[body] Q`; Q is all @safety predicates, all obligations, and `extra`."""

    variables: tuple[str, ...]
    body: Program
    loop: bool
    predicates: tuple[Predicate, ...]
    extra: Formula = TRUE

    def __str__(self) -> str:
        call = "(" + ", ".join(self.variables) + ")"
        parameters = "(" + ", ".join(f"Real {name}" for name in self.variables) + ")"
        definitions = "".join(
            f"  {p.annotation(call)}\n  Bool {p.name}{parameters} <-> ({p.condition});\n"
            for p in self.predicates
        )
        marks = "/* @var: bound=[-100:100] */ " if self.predicates else ""
        variables = "".join(f"  {marks}Real {name};\n" for name in self.variables)
        claims = [f"{p.name}{call}" for p in self.predicates if p.category == "safety"]
        claims += [f"({p.due_text.replace(p.name, p.name + call)})" for p in self.predicates if p.due_text]
        claims += [f"({self.extra})"] if self.extra != TRUE else []
        body = listed(self.body)
        program = f"{{ {body} }}*" if self.loop else body
        return (
            f'Theorem "small"\nDefinitions\n{definitions}End.\nProgramVariables\n{variables}End.\n'
            f"Problem\n  true -> [{program}] ({' & '.join(claims) or 'true'})\nEnd.\nEnd.\n"
        )


def choices(program: Sequence[Statement]) -> list[Choice]:
    """All of a program, in the order of the text."""
    found: list[Choice] = []
    for statement in program:
        match statement:
            case Choice(alternatives=alternatives):
                found += [statement, *(c for alternative in alternatives for c in choices(alternative))]
            case If(then=then, otherwise=otherwise):
                found += choices(then) + choices(otherwise)
            case _:
                pass
    return found
