"""A trained network in C for a page: what it makes of an observation. Deciding by that is the page's part."""

from dl2c.emit.cfile import function
from dl2c.emit.monitor.copied import copied
from dl2c.emit.monitor.network_c import network_functions
from dl2c.policy.network import NetworkPolicy


def page_policy_c(policy: NetworkPolicy) -> str:
    """Functions for the end of a file that has `real` and DL2C_API."""
    size, outputs = len(policy.interface.observations), policy.interface.outputs
    signature = f"static void policy_outputs(const real observation[{size}], real output[{outputs}])"
    network = network_functions(False, policy.network, size, signature)
    call = function(
        "DL2C_API void dl2c_policy_outputs(const double *observation, double *output)",
        ["policy_outputs(observation, output);"],
        "What the policy makes of an observation, before it is an action.",
    )
    clipped = [copied("policy.h", ("clipped",))] if "clipped(" in network else []
    return "\n".join([*clipped, network, call])
