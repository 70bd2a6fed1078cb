"""Terms in C over what encloses the state: intervals (hull.h) or Taylor models (taylor.h).

Printed from terms as they are written, each different subterm once. What does not move along a flow
is computed in doubles, in place. The operations are those of dl2c/flows/taylor.py and hull.py, in their
order.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from dl2c.emit import names
from dl2c.emit.cfile import wrapped
from dl2c.emit.leaf import Locals
from dl2c.emit.names import index
from dl2c.flows.enclosed import last_operation
from dl2c.ir.model import Pow, Symbol, Term

LONGEST = 60
"""Longer expressions over intervals get a name."""


@dataclass(slots=True)
class Enclosed:
    """Statements that compute terms along one flow, beside `local`, which computes what does not move.

    `kind` is the type without `dl2c_`: hulls go by value, Taylor models by address.
    """

    kind: str
    moves: Callable[[Term], bool]
    local: Locals
    uses: Counter[Term] = field(default_factory=Counter[Term])
    lines: list[str] = field(default_factory=list[str])
    made: dict[Term, str] = field(default_factory=dict[Term, str])

    def count(self, terms: Iterator[Term]) -> None:
        """Notes how often each subterm of these will be asked for: those used once need no name."""
        left = list(terms)
        while left:
            term = left.pop()
            self.uses[term] += 1
            if self.uses[term] == 1 and self.moves(term) and not isinstance(term, Symbol):
                left += (
                    [term.base] if isinstance(term, Pow) and term.exponent == 1 else last_operation(term)[1]
                )

    def term(self, term: Term) -> str:
        """The expression of a term: the name of what a statement made, or a variable's place."""
        if isinstance(term, Symbol) and self.moves(term):
            return f"z[{index(term)}]"
        if term not in self.made:
            text = self.value(term)
            if self.kind == "hull" and self.uses[term] == 1 and len(text) <= LONGEST:
                return text
            name = f"{names.stem('part', self.local.leaves.taken)}{len(self.made)}"
            self.lines += wrapped(f"const dl2c_{self.kind} {name} = {text};")
            self.made[term] = name
        return self.made[term]

    def value(self, term: Term) -> str:
        """The operation that makes a term."""
        if term in self.made or (isinstance(term, Symbol) and self.moves(term)):
            return self.term(term)
        if not self.moves(term):
            return f"dl2c_{self.kind}_{'at' if self.kind == 'hull' else 'number'}({self.local.term(term)})"
        if isinstance(term, Pow) and term.exponent == 1:
            return self.term(term.base)
        operation, args = last_operation(term)
        still = [not self.moves(a) for a in args]
        if self.kind == "taylor" and operation in ("add", "sub", "mul") and any(still):
            return self._with_number(operation, args[still.index(False)], args[still.index(True)], still[0])
        address = "" if self.kind == "hull" else "&"
        return f"dl2c_{self.kind}_{operation}({', '.join(f'{address}{self.term(a)}' for a in args)})"

    def _with_number(self, operation: str, moving: Term, still: Term, first: bool) -> str:
        """A sum or product of which one operand does not move; `first`: the first one."""
        model, value = f"&{self.term(moving)}", self.local.term(still)
        match operation, first:
            case "mul", _:
                return f"dl2c_taylor_times({model}, {value})"
            case "sub", True:
                return f"dl2c_taylor_from({value}, {model})"
            case "sub", False:
                simple = re.fullmatch(r"[\w\[\]]+", value)
                return f"dl2c_taylor_plus({model}, {f'-{value}' if simple else f'-({value})'})"
            case _:
                return f"dl2c_taylor_plus({model}, {value})"
