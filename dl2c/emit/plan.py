"""What the code generator is given, gathered by the pipeline."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from dl2c.emit.claim import Claim
from dl2c.flows.kernel import FlowPlan
from dl2c.ir.model import Model
from dl2c.options import Options
from dl2c.paths.path import Paths
from dl2c.sampling.tables import SamplingPlan

if TYPE_CHECKING:
    from dl2c.emit.monitor.monitor_h import Unit


@dataclass(frozen=True, slots=True)
class BuildPlan:
    """All that the code of one environment is generated from. `sampling` is None where resets need a given
    state, `monitor` where steps are not monitored. `claim` is said in comments and means nothing to code.
    """

    model: Model
    paths: Paths
    flows: tuple[FlowPlan, ...]
    sampling: SamplingPlan | None
    options: Options
    version: str
    monitor: "Unit | None" = None
    claim: Claim = Claim()

    def claiming(self, claim: Claim) -> "BuildPlan":
        """The same with a claim, also that of its monitor."""
        monitor = None if self.monitor is None else replace(self.monitor, claim=claim)
        return replace(self, claim=claim, monitor=monitor)
