"""Which shapes a scene may have, and its terms as one list of values."""

from collections.abc import Mapping
from dataclasses import dataclass

from dl2c.ir.model import Model, Scene, Term

ROLES = ("agent", "unsafe", "goal", "world")


PAIRS = ("heading",)
"""Arguments of two terms, the components of a direction."""


@dataclass(frozen=True, slots=True)
class Form:
    """The arguments of a kind of shape: those given by place, in their order, and those given by name. With
    `many`, places are x and y of any number of points, at least three. `panel` is the part of a picture
    that shows it.
    """

    panel: str
    places: tuple[str, ...] = ()
    needed: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    many: bool = False

    @property
    def keywords(self) -> tuple[str, ...]:
        """All arguments that are given by name."""
        return tuple(dict.fromkeys((*self.needed, *self.optional, "role", "name")))


FORMS: Mapping[str, Form] = {
    "disk": Form("plane", ("x", "y"), ("radius",), ("heading",)),
    "point": Form("plane", ("x", "y"), (), ("heading",)),
    "box": Form("plane", ("x", "y"), ("width", "height"), ("heading",)),
    "segment": Form("plane", ("x", "y", "x2", "y2")),
    "polygon": Form("plane", many=True),
    "ray": Form("plane", ("x", "y"), ("heading",), ("length",)),
    "on_line": Form("line", ("x",), (), ("length",)),
    "level": Form("level", ("value",), (), ("low", "high")),
    "pointer": Form("dial", ("angle",), (), ("spread",)),
    "text": Form("text", ("value",), ("name",)),
}
"""The shapes of an `@scene` by name."""

POINTS = "points"
"""The argument of a shape with many places: x and y of each point in turn."""


def scene_terms(scene: Scene) -> tuple[Term, ...]:
    """The terms of all shapes, each once: values are passed around in this order."""
    return tuple(dict.fromkeys(t for s in scene.shapes for _, terms in s.arguments for t in terms))


def plotted_pairs(model: Model) -> tuple[tuple[str, str], ...]:
    """Variables that `plot=scatter` names, paired in their order; one left over is in no pair."""
    scatter = [v.name for v in model.variables if v.plot == "scatter"]
    return tuple(zip(scatter[0::2], scatter[1::2], strict=False))
