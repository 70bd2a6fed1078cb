"""What is said of words that are not names of a model: annotations, their attributes, keywords; and snippets.

Which annotations, attributes and values there are is decided in `parse`: those without a text here are
known too.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from dl2c.lint.codes import LINTS
from dl2c.options import IN_EPISODE
from dl2c.parse.annotations import ATTRIBUTES, EXPRESSIONS, WORDS
from dl2c.parse.options import ALLOW

Place: TypeAlias = Literal["file", "entry", "definitions", "variables", "program"]

ANNOTATIONS = {
    "var": "above a program variable: it is observed, and where it begins",
    "const": "above an undefined constant: how it is drawn at every reset",
    "safety": "above a `Bool` definition or `Problem`: what must never fail",
    "progress": "above a `Bool` definition or `Problem`: what is to be reached",
    "stability": "above a `Bool` or `Real` definition: what is to be reached and kept",
    "choice": "before a choice: its name, and who decides",
    "fallback": "before an alternative: it is taken first where a request has no run",
    "episode": "above `Problem`: options of the environment",
}

_ATTRIBUTES = {
    "bound": "`[lo:hi]`: values at reset lie in it",
    "def": '`"text"`: a description',
    "unit": '`"m/s"`: its unit',
    "plot": "how it is drawn",
    "observe": "whether observations have it",
    "role": "who decides: the agent, or chance",
    "name": '`"text"`: what the decision is called',
    "reward": "term or predicate: added where the predicate holds",
    "penalty": "term or predicate: added where it does not hold, a negative number",
    "shape": "term or predicate: added always",
    "on_success": "what becomes of the episode where the predicate holds",
    "on_failure": "what becomes of the episode where it does not hold",
    ALLOW: "codes of warnings that are silent, `code|code`",
}

_VALUES = {"bound": "[$1:$2]", "def": '"$1"', "unit": '"$1"', "name": '"$1"', ALLOW: "$1"}
"""How values are begun."""

KEYWORDS = {
    "Real": "a number: a variable, a constant, or a function",
    "Bool": "a predicate",
    "HP": "a hybrid program",
    "HG": "a hybrid game",
    "implicit": "functions that solve a differential equation",
    "import": "functions of the package kyx.math",
    "true": "the formula that holds",
    "false": "the formula that does not hold",
    "if": "`if (P) {a} else {b}` is `{?P; a ++ ?!P; b}`",
    "else": "the other branch of an `if`",
    "ArchiveEntry": "a problem with all that is declared for it",
    "Theorem": "an `ArchiveEntry`",
    "Lemma": "an `ArchiveEntry`",
    "Exercise": "an `ArchiveEntry` with holes to fill",
    "Definitions": "constants, functions, predicates and programs",
    "SharedDefinitions": "definitions that all entries of a file share",
    "ProgramVariables": "what programs change",
    "Problem": "the formula that is to be proved, such as `P -> [{a}*]Q`",
    "Tactic": "a proof for KeYmaera X, which dl2c does not read",
    "End": "ends a section or an entry",
}


@dataclass(frozen=True, slots=True)
class Snippet:
    """A text with places to fill in, `$1` first, as the protocol writes them."""

    label: str
    meaning: str
    text: str
    places: tuple[Place, ...]


SNIPPETS = (
    Snippet(
        "ArchiveEntry",
        "a whole model",
        'ArchiveEntry "${1:name}"\n\nDefinitions\n  ${2:Real c;}\nEnd.\n\nProgramVariables\n  Real ${3:x};\n'
        "End.\n\nProblem\n  ${4:$3 = 0} -> [{ ${5:$3 := *; ?$3 >= 0;} }*]${6:$3 >= 0}\nEnd.\n\nEnd.",
        ("file",),
    ),
    Snippet("Definitions", "a section", "Definitions\n  $0\nEnd.", ("file", "entry")),
    Snippet("ProgramVariables", "a section", "ProgramVariables\n  Real ${1:x};\nEnd.", ("entry",)),
    Snippet("Problem", "a section", "Problem\n  ${1:P} -> [{ ${2:ctrl} }*]${3:Q}\nEnd.", ("entry",)),
    Snippet("Real constant", "a constant", "Real ${1:c};", ("definitions",)),
    Snippet("Real function", "a function", "Real ${1:f}(Real ${2:x}) = ${3:$2^2};", ("definitions",)),
    Snippet("Bool predicate", "a predicate", "Bool ${1:p}(Real ${2:x}) <-> ${3:$2 >= 0};", ("definitions",)),
    Snippet("HP program", "a program", "HP ${1:ctrl} ::= { $2 };", ("definitions",)),
    Snippet("import kyx.math", "functions of the library", "import kyx.math.${1:abs};", ("definitions",)),
    Snippet("Real variable", "a variable", "Real ${1:x};", ("variables",)),
    Snippet("choice", "one program or another", "{ ${1:a} ++ ${2:b} }", ("program",)),
    Snippet(
        "flow", "a differential equation", "{${1:x}' = ${2:v}, ${3:t}' = 1 & ${4:$3 <= ep}}", ("program",)
    ),
    Snippet("if", "a branch", "if (${1:P}) { ${2:a} } else { ${3:b} }", ("program",)),
    Snippet("input", "a value that is chosen, and its test", "${1:a} := *; ?${2:$1 <= A};", ("program",)),
    Snippet("loop", "repetition with an invariant", "{ ${1:a} }*@invariant(${2:J})", ("program",)),
    Snippet("box", "what holds after every run", "[${1:a}]${2:P}", ("program",)),
    Snippet("diamond", "what holds after some run", "<${1:a}>${2:P}", ("program",)),
)


def attributes(annotation: str) -> tuple[str, ...]:
    """The attributes of an annotation."""
    return ATTRIBUTES.get(annotation, ())


def values(annotation: str, attribute: str) -> tuple[str, ...]:
    """The words that an attribute may be; none where its values are others."""
    if annotation != "episode":
        return WORDS.get(attribute, ())
    if attribute == ALLOW:
        return tuple(lint.code for lint in LINTS)
    option = IN_EPISODE.get(attribute)
    if option is None:
        return ()
    return option.words or (("true", "false") if option.kind == "boolean" else ())


def meaning(annotation: str, attribute: str) -> str:
    """A line about an attribute, "" where none is known."""
    if annotation == "episode" and attribute in IN_EPISODE:
        return IN_EPISODE[attribute].help
    return _ATTRIBUTES.get(attribute, "")


def begun(annotation: str, attribute: str) -> str:
    """An attribute with the beginning of its value, as a snippet."""
    if annotation == "episode" and attribute != ALLOW:
        return f"{attribute}=$1"
    return f"{attribute}={_VALUES.get(attribute, '{$1}' if attribute == 'shape' else '$1')}"


def is_expression(attribute: str) -> bool:
    """Whether the value of an attribute is a term or formula."""
    return attribute in EXPRESSIONS
