"""All traps: theorems that are false, each with a run that shows it, or an argument."""

from verify import traps_environment, traps_flows, traps_inexact, traps_logic, traps_sets, traps_terms

TRAPS = (
    *traps_environment.TRAPS,
    *traps_flows.TRAPS,
    *traps_sets.TRAPS,
    *traps_terms.TRAPS,
    *traps_logic.TRAPS,
    *traps_inexact.TRAPS,
)

WITNESSED = tuple(trap for trap in TRAPS if not trap.argument)
POLYNOMIAL = tuple(trap for trap in TRAPS if trap.polynomial)
