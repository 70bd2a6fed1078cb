"""What a manifest says of a model's scene: shapes, the places of their values, and axes."""

import math
from collections.abc import Callable, Iterator, Mapping

from dl2c.interval.arithmetic import Interval, evaluate, hull_of, plus, times
from dl2c.interval.bounded import interval_of
from dl2c.ir.model import Add, Constant, Model, Neg, Shape, Sub, Symbol, Term, Variable
from dl2c.ir.scene import FORMS, POINTS, scene_terms
from dl2c.native.manifest import AxisSpec, SceneSpec, ShapeSpec

AXES = {"plane": ("x", "y"), "line": ("line",), "level": ("level",)}
"""The axes of each part of a picture."""

ZERO, UNIT, HALF = Interval(0.0, 0.0), Interval(-1.0, 1.0), Interval(-0.5, 0.5)

Enclose = Callable[[Term], Interval]


def scene_spec(model: Model) -> SceneSpec:
    """The scene as data."""
    places = {term: k for k, term in enumerate(scene_terms(model.scene))}
    items = {item.symbol: item for item in (*model.variables, *model.constants)}
    return SceneSpec(
        shapes=tuple(_shape(shape, places, items) for shape in model.scene.shapes),
        axes=_axes(model, items),
        shaded=model.scene.shaded,
    )


def _shape(
    shape: Shape, places: Mapping[Term, int], items: Mapping[Symbol, Variable | Constant]
) -> ShapeSpec:
    first = shape.arguments[0][1][0]
    return ShapeSpec(
        kind=shape.kind,
        panel=FORMS[shape.kind].panel,
        role=shape.role,
        name=shape.name,
        unit=items[first].unit if isinstance(first, Symbol) else "",
        arguments={name: tuple(places[t] for t in terms) for name, terms in shape.arguments},
    )


def _axes(model: Model, items: Mapping[Symbol, Variable | Constant]) -> dict[str, AxisSpec]:
    """Each axis with limits between which its shapes stay as long as variables are within their bounds;
    infinite ones where there are none."""
    box = {
        symbol: interval_of(item.bound, item.value if isinstance(item, Constant) else None)
        for symbol, item in items.items()
    }
    extents: dict[str, list[Interval]] = {}
    units: dict[str, list[str]] = {}
    for shape in model.scene.shapes:
        for axis, term, reach in _extents(shape, lambda t: evaluate(t, box)):
            extents.setdefault(axis, []).append(reach)
            units.setdefault(axis, []).extend(items[s].unit for s in _summed(term) if items[s].unit)
    found: dict[str, AxisSpec] = {}
    for axis, reaches in extents.items():
        whole = hull_of(r for r in reaches if not r.empty)
        low, high = (-math.inf, math.inf) if whole.empty else (whole.low, whole.high)
        found[axis] = AxisSpec(low, high, next(iter(units[axis]), ""))
    return found


def _summed(term: Term) -> Iterator[Symbol]:
    """Symbols of which a term is a sum or difference, and which so have its unit."""
    match term:
        case Symbol():
            yield term
        case Neg(child):
            yield from _summed(child)
        case Add(left, right) | Sub(left, right):
            yield from (*_summed(left), *_summed(right))
        case _:
            pass


def _extents(shape: Shape, enclose: Enclose) -> Iterator[tuple[str, Term, Interval]]:
    """How far a shape reaches along each axis, beside the term that says where it is."""
    given = dict(shape.arguments)
    if shape.kind == "polygon":
        for k, term in enumerate(given[POINTS]):
            yield "xy"[k % 2], term, enclose(term)
        return
    for axis in AXES.get(FORMS[shape.kind].panel, ()):
        for name in {"level": ("value", "low", "high"), "line": ("x",)}.get(axis, (axis, f"{axis}2")):
            if name in given:
                (term,) = given[name]
                yield axis, term, plus(enclose(term), _around(axis, shape, enclose))


def _around(axis: str, shape: Shape, enclose: Enclose) -> Interval:
    """How far a shape reaches from where it is along an axis."""
    size = {name: enclose(terms[0]) for name, terms in shape.arguments}
    match shape.kind:
        case "disk":
            return times(UNIT, size["radius"])
        case "box":
            both = plus(size["width"], size["height"])
            longest = size["width"] if axis == "x" else size["height"]
            return times(HALF, both if "heading" in size else longest)
        case "on_line" if "length" in size:
            return hull_of((ZERO, size["length"]))
        case "ray" if "length" in size:
            return times(UNIT, size["length"])
        case _:
            return ZERO
