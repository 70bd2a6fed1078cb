"""A model as text that grows: more names, assumptions, programs and equations at the places for them."""

import re
from random import Random

_HIDDEN = re.compile(r"/\*.*?\*/|//[^\n]*|\"[^\"]*\"", re.DOTALL)
_WORD = re.compile(r"(?<![\w.\\])[A-Za-z]\w*")
_FLOW = re.compile(r"\{\s*[A-Za-z]\w*'\s*=")
_HEAD = re.compile(r"^[ \t]*(?:ArchiveEntry|Theorem)\b", re.MULTILINE)

_WORDS = """
Real Bool HP if else while true false End Definitions ProgramVariables Problem Theorem ArchiveEntry
import kyx implicit abs min max sin cos tan exp sqrt pi e forall exists Tactic Description Title Link Author
See invariant bound unit def plot line scatter role env name penalty shape reward on_failure on_success
terminate truncate continue success failure status allow max_steps observe
"""
KEYWORDS = frozenset(_WORDS.split())
"""Of the language, its library and its annotations."""


SCENE_NAME = re.compile(r"\"[^\"]*\"|\brole=\w+|\b[A-Za-z]\w*\b(?![=\w])")
"""A name of the model in `@scene`, or what is kept: a text, a role. A word before `=` is the scene's own."""


def without_comments(text: str) -> str:
    """The same text with blanks for comments and strings."""
    return _HIDDEN.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)


def piece(text: str, number: int) -> str:
    """An entry of an archive."""
    heads = [found.start() for found in _HEAD.finditer(text)]
    return text[heads[number] : [*heads, len(text)][number + 1]]


def closing(code: str, at: int) -> int:
    """The place of the brace that closes the one at `at`."""
    depth = 0
    for k in range(at, len(code)):
        depth += (code[k] == "{") - (code[k] == "}")
        if depth == 0:
            return k
    raise ValueError("a brace is not closed")


def opening(code: str, at: int) -> int:
    """The place of the brace that is closed at `at`."""
    depth = 0
    for k in range(at, -1, -1):
        depth += (code[k] == "}") - (code[k] == "{")
        if depth == 0:
            return k
    raise ValueError("a brace is not opened")


def _has_premise(problem: str) -> bool:
    """Whether there is an implication before the first program, outside of parentheses."""
    depth = 0
    for k, letter in enumerate(problem):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and problem.startswith("->", k):
            return True
        if letter in "[{":
            return False
    return False


class Draft:
    """A model that is changed piece by piece; names that are added begin with `zq`."""

    def __init__(self, text: str, rng: Random) -> None:
        self.text = text
        self.rng = rng
        self.named = 0

    def names(self, count: int) -> list[str]:
        """New names, not declared yet."""
        self.named += count
        return [f"zq{k}" for k in range(self.named - count, self.named)]

    def insert(self, at: int, what: str) -> None:
        self.text = f"{self.text[:at]}{what}{self.text[at:]}"

    def variables(self, count: int, bound: str = "[0:1]") -> list[str]:
        """New variables with bounds."""
        made = self.names(count)
        at = re.search(r"\bProgramVariables\b\.?", without_comments(self.text))
        assert at is not None
        declared = (f"\n  /* @var: bound={bound} */\n  Real {name};" for name in made)
        self.insert(at.end(), "".join(declared))
        return made

    def define(self, what: str) -> None:
        """Definitions, before all others."""
        code = without_comments(self.text)
        if (at := re.search(r"\bDefinitions\b", code)) is not None:
            self.insert(at.end(), f"\n{what}")
        else:
            self.insert(code.index("ProgramVariables"), f"Definitions\n{what}\nEnd.\n")

    def assume(self, formula: str) -> None:
        """One more assumption."""
        code = without_comments(self.text)
        at = code.index("Problem") + len("Problem")
        at += code[at] == "."
        link = "&" if _has_premise(code[at:]) else "->"
        self.insert(at, f"\n  {formula} {link} ")

    def loop(self) -> tuple[int, int]:
        """Where the body of the loop begins and ends."""
        code = without_comments(self.text)
        *_, last = re.finditer(r"\}\*", code)
        return opening(code, last.start()) + 1, last.start()

    def before_body(self, program: str) -> None:
        """A program that runs first in every step."""
        begin, end = self.loop()
        self.text = f"{self.text[:begin]} {program} {{{self.text[begin:end]}}}{self.text[end:]}"

    def flow(self, equations: str = "", domain: str = "") -> None:
        """More equations, each with a comma before it, and conditions of the first flow."""
        code = without_comments(self.text)
        begin = _FLOW.search(code)
        assert begin is not None, "there is no flow"
        end = closing(code, begin.start())
        middle = code.find("&", begin.start(), end)
        link = " & " if domain else ""
        self.insert(end, f"{link}{domain}")
        self.insert(middle if middle >= 0 else end, equations)

    def own_names(self) -> set[str]:
        """All that the model itself names."""
        return {word for word in _WORD.findall(without_comments(self.text)) if word not in KEYWORDS}

    def renamed(self, beginning: str) -> str:
        """The text with other names for everything."""
        own = self.own_names()
        parts: list[str] = []
        for part in re.split(r"(@scene.*?\*/|\"[^\"]*\"|@\w+|\brole=\w+)", self.text, flags=re.DOTALL):
            if part.startswith("@scene"):
                parts.append(re.sub(SCENE_NAME, lambda f: beginning * (f[0] in own) + f[0], part))
                continue
            quoted = part[:1] in ('"', "@") or part.startswith("role=")
            parts.append(part if quoted else _WORD.sub(lambda f: beginning * (f[0] in own) + f[0], part))
        return "".join(parts)
