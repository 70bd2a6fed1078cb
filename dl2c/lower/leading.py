"""What of a step the environment decides before the agent does.

The leading statements of a step, up to the last decision of the environment that comes before the
agent's first and before any flow, are executed as soon as the step before is over, so that the
agent sees what they led to. A step is split into these statements and the rest.
"""

from dataclasses import replace

from dl2c.ir.liveness import statements
from dl2c.ir.model import AssignAny, Block, Choice, Evolve, Repeat, Role, Statement, Test


def leading(body: Block) -> tuple[Block, Block]:
    """`(lead, rest)`: `lead; rest` does what the body does; the lead ends with a decision of the
    environment and the tests right after it, or is empty.

    A choice of the environment whose alternatives contain decisions of the agent is split inside, and so
    is a loop: both parts then hold a choice of the same key, which is made in the first.
    """
    free = 0
    while free < len(body) and not _waits(body[free]):
        free += 1
    if free < len(body) and (choice := _split(body[free])):
        parts = [(a, *_divided(a.body)) for a in choice.alternatives]
        first = replace(choice, alternatives=tuple(replace(a, body=lead) for a, lead, _ in parts))
        second = replace(choice, alternatives=tuple(replace(a, body=rest) for a, _, rest in parts))
        return (*body[:free], first), (second, *body[free + 1 :])
    end = max((k + 1 for k in range(free) if _decides(body[k], "env")), default=0)
    if end:
        end += _tests(body[end:])
    return body[:end], body[end:]


def _split(statement: Statement) -> Choice | None:
    """What the environment decides with decisions of the agent inside."""
    match statement:
        case Choice(role="env"):
            return statement
        case Repeat(role="env"):
            return statement.choice
        case _:
            return None


def _divided(body: Block) -> tuple[Block, Block]:
    """As `leading`, right after a decision: leading tests are executed too."""
    lead, rest = leading(body)
    tests = 0 if lead else _tests(rest)
    return (*lead, *rest[:tests]), rest[tests:]


def _tests(body: Block) -> int:
    """How many tests the block begins with."""
    count = 0
    while count < len(body) and isinstance(body[count], Test):
        count += 1
    return count


def _waits(statement: Statement) -> bool:
    """Whether the agent decides something in it, or time passes."""
    return any(isinstance(s, Evolve) for s in statements((statement,))) or _decides(statement, "agent")


def _decides(statement: Statement, role: Role) -> bool:
    """Whether the agent, or the environment, decides something in it."""
    inside = statements((statement,))
    return any(isinstance(s, AssignAny | Choice | Repeat) and s.role == role for s in inside)
