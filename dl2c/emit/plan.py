"""What the code generator is given, gathered by the pipeline."""

from dataclasses import dataclass

from dl2c.emit.monitor.monitor_h import Unit
from dl2c.flows.kernel import FlowPlan
from dl2c.ir.model import Model
from dl2c.options import Options
from dl2c.paths.path import Paths
from dl2c.sampling.tables import SamplingPlan


@dataclass(frozen=True, slots=True)
class BuildPlan:
    """All that the code of one environment is generated from. `sampling` is None where resets need a given
    state, `monitor` where steps are not monitored.
    """

    model: Model
    paths: Paths
    flows: tuple[FlowPlan, ...]
    sampling: SamplingPlan | None
    options: Options
    version: str
    monitor: Unit | None = None
