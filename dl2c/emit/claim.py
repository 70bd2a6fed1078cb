"""What a model claims and what is known of it, for those who read generated files."""

from dataclasses import dataclass

NOT_CHECKED = "not checked"

LONGEST = 400
"""Characters of an invariant in a sentence."""


@dataclass(frozen=True, slots=True)
class Claim:
    """`theorem` is the name of the entry, "" where nothing is to be said of it. `invariant` is that of the
    loop as the model gives it, "" where it gives none. `known` is what is known, such as `proved by dl2c
    verify with z3 5.4.0`, `refuted by dl2c verify` or `not checked`.
    """

    theorem: str = ""
    invariant: str = ""
    known: str = NOT_CHECKED

    @property
    def sentence(self) -> str:
        """All of it, for a comment."""
        text = self.invariant
        short = text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
        return f'Theorem "{self.theorem}"{f" with invariant {short}" * bool(text)}: {self.known}.'
