"""The scene of a model: that of its `@scene`, else one of what `plot=` and units say."""

from collections.abc import Sequence

from dl2c.ir import model as ir
from dl2c.ir.logic import symbols
from dl2c.ir.scene import plotted_pairs
from dl2c.lower.terms import Scope, lower_term
from dl2c.resolve.scene import SceneShape

LENGTHS = ("m", "km", "cm", "mm", "ft", "mi")
"""Units of positions on a line."""


def lower_scene(shapes: Sequence[SceneShape] | None, scope: Scope) -> ir.Scene | None:
    """The shapes over symbols of the step model. Raises `CompileError` for numbers that are not doubles."""
    if shapes is None:
        return None
    return ir.Scene(
        tuple(
            ir.Shape(
                shape.kind,
                shape.role,
                shape.name,
                tuple((name, tuple(lower_term(t, scope) for t in terms)) for name, terms in shape.arguments),
                span=shape.span,
            )
            for shape in shapes
        )
    )


def default_scene(model: ir.Model) -> ir.Scene:
    """Without `@scene`: pairs that `plot=scatter` names, in a plane, shaded where @safety fails if that
    depends on both. Else observed lengths as positions on a line, if motion changes some of them.
    """
    items = {v.name: v for v in model.variables}
    if pairs := plotted_pairs(model):
        judged = symbols(*(p.formula for p in model.predicates if p.category == "safety"))
        first = pairs[0] if all(items[name].symbol in judged for name in pairs[0]) else ()
        return ir.Scene(tuple(_point(items[x], items[y], k) for k, (x, y) in enumerate(pairs)), first)
    moving = {name for flow in model.flows for name, _ in flow.equations}
    lengths = [v for v in model.variables if v.unit in LENGTHS and v.observed]
    moved = [v for v in lengths if v.name in moving]
    if not moved:
        return ir.Scene()
    return ir.Scene(tuple(_position(v, "agent" if v == moved[0] else "world") for v in lengths))


def _point(x: ir.Variable, y: ir.Variable, k: int) -> ir.Shape:
    same = x.description if x.description == y.description else ""
    arguments = (("x", (x.symbol,)), ("y", (y.symbol,)))
    return ir.Shape("point", "world" if k else "agent", same or f"{x.name}, {y.name}", arguments, span=x.span)


def _position(variable: ir.Variable, role: ir.SceneRole) -> ir.Shape:
    name = variable.description or variable.name
    return ir.Shape("on_line", role, name, (("x", (variable.symbol,)),), span=variable.span)
