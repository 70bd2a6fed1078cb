"""Training policies on compiled models, and measuring them.

`evaluate` and `rollout` need only numpy; `train` needs the extra `dl2c[train]` and imports it when called.
"""

from dl2c.training.evaluation import evaluate
from dl2c.training.rollout import rollout
from dl2c.training.run import Estimate, Evaluation

__all__ = ["Estimate", "Evaluation", "evaluate", "rollout"]
