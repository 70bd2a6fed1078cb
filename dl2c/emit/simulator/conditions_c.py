"""What a page asks about the conditions of a model, in C: a file that includes the model's own."""

from dl2c.emit.cfile import function, place, wrapped
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import file_stem
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.conditions import Conditions
from dl2c.emit.simulator.model_c import leaves_of
from dl2c.emit.simulator.model_h import title_of
from dl2c.emit.simulator.page_policy_c import page_policy_c
from dl2c.ir.margins import margin_of
from dl2c.ir.printer import print_formula
from dl2c.policy.network import NetworkPolicy


def conditions_c(build: BuildPlan, conditions: Conditions, policy: NetworkPolicy | None = None) -> str:
    """The whole file, with the network of a policy; compiled with DL2C_INSPECT=1."""
    leaves = leaves_of(build)
    atoms = _atoms(conditions, leaves)
    parts = [
        title_of(build),
        f'#include "{file_stem(build.model.name)}.c"\n',
        f"enum {{ NATOM = {len(conditions.atoms)} }};\n",
        *leaves.texts,
        atoms,
        '#include "conditions.h"\n',
        *([] if policy is None else [page_policy_c(policy)]),
    ]
    return "\n".join(parts)


def _atoms(conditions: Conditions, leaves: Leaves) -> str:
    body: list[str] = []
    for k, atom in enumerate(conditions.atoms):
        about = f"{place(atom.span)}  {print_formula(atom)}"
        body += wrapped(f"margin[{k}] = {leaves.term(f'atom{k}_margin', margin_of(atom), about)};")
        body += wrapped(f"truth[{k}] = {leaves.condition(f'atom{k}_holds', atom, about)};")
    return function(
        "static void model_atoms(const real *x, const real *p, const real *u, real *margin, uint8_t *truth)",
        body,
        "All comparisons.   margin, truth: (NATOM)",
    )
