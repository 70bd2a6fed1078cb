"""Training policies on compiled models, and measuring them.

`evaluate` and `rollout` need only numpy; `train` needs the extra `dl2c[train]` and imports it when called.
"""

from dl2c.training.evaluation import Estimate, Evaluation, evaluate
from dl2c.training.rollout import rollout

__all__ = ["Estimate", "Evaluation", "evaluate", "rollout"]
