"""What is known of every state that a model can be in, apart from what its loop does.

Comes in: a model. Go out: formulas over what never changes in an episode, from its precondition and
its bounds, and the variables that do change.
"""

from collections.abc import Iterable

from dl2c.ir.liveness import written
from dl2c.ir.logic import conjuncts, limits_of, symbols
from dl2c.ir.model import Compare, Formula, Model, Number


def changing(model: Model) -> frozenset[str]:
    """Variables that any part of the program may change."""
    return written((*model.prefix, *model.lead, *model.body), model.flows)


def rigid_facts(model: Model) -> tuple[Formula, ...]:
    """What holds of constants, and of variables that nothing changes, in every episode."""
    moving = changing(model)
    assumed = [
        part
        for part in conjuncts(model.precondition)
        if not any(s.kind == "variable" and s.name in moving for s in symbols(part))
    ]
    return (*assumed, *bounds_of(model, exclude=moving))


def bounds_of(model: Model, exclude: Iterable[str] = ()) -> tuple[Formula, ...]:
    """The declared bounds, of variables that are not excluded and of constants, and fixed values."""
    found: list[Formula] = []
    for variable in model.variables:
        if variable.name not in exclude:
            found += limits_of(variable.symbol, variable.bound)
    for constant in model.constants:
        symbol = constant.symbol
        if constant.value is not None:
            found.append(Compare("=", symbol, Number(constant.value)))
        else:
            found += limits_of(symbol, constant.bound)
    return tuple(found)
