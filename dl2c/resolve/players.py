"""Who decides in a hybrid game: `{a}^@` as decisions of two players.

Comes in: an expanded program. Goes out: the same program without `Dual`; every choice, `x := *`, loop
and duration under an odd number of them is `dual`, a decision of the other player.
"""

from dataclasses import replace
from typing import assert_never

from dl2c.parse import tree


def with_players(program: tree.Program, dual: bool = False) -> tree.Program:
    """By the axioms of duality: `^@` distributes over what is not a decision, and twice is not at all."""
    match program:
        case tree.Dual(child):
            return with_players(child, not dual)
        case tree.Compose(left, right):
            return replace(program, left=with_players(left, dual), right=with_players(right, dual))
        case tree.Choice(left, right):
            return replace(program, left=with_players(left, dual), right=with_players(right, dual), dual=dual)
        case tree.Loop(child):
            return replace(program, child=with_players(child, dual), dual=dual)
        case tree.AssignAny() | tree.ODESystem():
            return replace(program, dual=dual)
        case tree.Assign() | tree.Test() | tree.ProgramConst():
            return program
        case _:
            assert_never(program)
