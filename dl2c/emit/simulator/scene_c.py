"""What a picture of a state shows, in C: `model_scene`."""

from dl2c.emit.cfile import function, wrapped
from dl2c.emit.leaf import Leaves
from dl2c.ir.model import Model
from dl2c.ir.printer import print_term
from dl2c.ir.scene import scene_terms


def scene_functions(model: Model, leaves: Leaves) -> list[str]:
    """`model_scene`; nothing where there is no scene."""
    terms = scene_terms(model.scene)
    body = [
        line
        for k, term in enumerate(terms)
        for line in wrapped(f"values[{k}] = {leaves.term(f'scene_value{k}', term, print_term(term))};")
    ]
    if not body:
        return []
    head = "static inline void model_scene(const real *x, const real *p, real *values)"
    return [function(head, body, "What a picture of state x shows.   values: (DL2C_SCENE)")]
