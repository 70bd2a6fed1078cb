"""Training policies on compiled models, and measuring them.

`evaluate` and `rollout` need only numpy; `train` needs the extra `dl2c[train]` and imports it when called.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dl2c.training.evaluation import evaluate
    from dl2c.training.rollout import rollout
    from dl2c.training.run import Estimate, Evaluation

_PLACES = {"Estimate": "run", "Evaluation": "run", "evaluate": "evaluation", "rollout": "rollout"}
"""In which modules the names are, which are imported when they are asked for."""

__all__ = ["Estimate", "Evaluation", "evaluate", "rollout"]


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
