"""One environment as one C file, with a header and files of its rewards and its tables.

The file has these sections: what it is, with its header (model_h.py); leaf functions, each below the
dL text it stands for; functions of the flows, of the paths, of predicates and observations,
of initial states; rewards and tables, included; the runtime, compiled with the model as one unit.
"""

from collections.abc import Iterable

from dl2c.emit.derived import derived_constants
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import file_stem
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.flow_c import flow_functions
from dl2c.emit.simulator.inputs_c import input_functions
from dl2c.emit.simulator.judge_c import judge_functions, reward_functions
from dl2c.emit.simulator.model_h import model_h, title_of
from dl2c.emit.simulator.ode_c import jacobian_function, lie_function
from dl2c.emit.simulator.paths_c import path_functions, path_tables
from dl2c.emit.simulator.rates_c import rate_functions
from dl2c.emit.simulator.sampler_c import sampler_functions, sampler_tables
from dl2c.emit.simulator.scene_c import scene_functions
from dl2c.emit.simulator.start_c import start_functions
from dl2c.emit.simulator.watch_c import watch_functions, watch_tables
from dl2c.ir.model import Symbol
from dl2c.symbolic.terms import Builder


def model_sources(build: BuildPlan) -> dict[str, str]:
    """The generated files by name: `<model>.h`, `<model>.c`, `<model>_rewards.h` and `<model>_tables.h`, and
    those of a monitor of every step.
    """
    stem = file_stem(build.model.name)
    leaves = leaves_of(build)
    files = {
        f"{stem}.h": model_h(build),
        f"{stem}.c": model_c(build, leaves),
        f"{stem}_rewards.h": rewards_h(build, leaves.apart()),
        f"{stem}_tables.h": tables_h(build),
    }
    if build.monitor is None:
        return files
    from dl2c.emit.monitor.files import monitor_sources

    return files | monitor_sources(build.monitor)


def model_c(build: BuildPlan, leaves: Leaves) -> str:
    """The whole C file."""
    functions = [
        *flow_functions(build, leaves),
        *watch_functions(build, leaves),
        *start_functions(build, leaves),
        *rate_functions(build, leaves),
        *_track_functions(build, leaves),
        *path_functions(build, leaves),
        *input_functions(build, leaves),
        *judge_functions(build, leaves),
        *scene_functions(build.model, leaves),
        *sampler_functions(build, leaves),
        *_judging_functions(build),
    ]
    return "\n".join([_head(build), *leaves.texts, *functions, _runtime(build)])


def _judging_functions(build: BuildPlan) -> Iterable[str]:
    """Those of the monitor of every step."""
    if build.monitor is None:
        return ()
    from dl2c.emit.simulator.judging_c import judging_functions

    return judging_functions(build.monitor)


def leaves_of(build: BuildPlan) -> Leaves:
    """No leaf functions yet, for a file about the model."""
    derived = derived_constants(build.model, build.paths)
    ranks = {symbol: k for k, symbol in enumerate((*_symbols(build), *derived.symbols.values()))}
    return Leaves(
        Builder(derived.bounds),
        lambda symbol: ranks.get(symbol, len(ranks)),
        shared=True,
        taken={symbol.name for symbol in ranks},
        derived=derived,
    )


def rewards_h(build: BuildPlan, leaves: Leaves) -> str:
    """Rewards and endings: a part of the C file, or a unit of its own."""
    functions = reward_functions(build.model, leaves)
    header = f'#include "{file_stem(build.model.name)}.h"\n'
    return _included(build, "rewards", [header, *leaves.texts, *functions, '#include "rewards.h"\n'])


def tables_h(build: BuildPlan) -> str:
    """The tables: of paths, of flows and watches, and last those that initial states are drawn from."""
    tables = path_tables(build), watch_tables(build), sampler_tables(build)
    return _included(build, "tables", ["".join(part) for part in tables])


def _included(build: BuildPlan, what: str, sections: list[str]) -> str:
    """The file `<model>_<what>.h`."""
    guard = f"DL2C_GENERATED_{file_stem(build.model.name).upper()}_{what.upper()}_H"
    return "\n".join([f"{title_of(build)}\n#ifndef {guard}\n#define {guard}\n", *sections, "#endif\n"])


def _track_functions(build: BuildPlan, leaves: Leaves) -> list[str]:
    """What following flows track by track needs that have no solution in closed form."""
    tracked = {k: plan.margins for k, plan in enumerate(build.flows) if plan.kernel != "exact"}
    return [
        *([jacobian_function(build, leaves, tracked)] if tracked else []),
        *([lie_function(build, leaves, tracked)] if tracked else []),
    ]


def _head(build: BuildPlan) -> str:
    stem = file_stem(build.model.name)
    monitor = f'#include "{stem}_monitor.h"\n' if build.monitor is not None else ""
    return f'{title_of(build)}\n#include "{stem}.h"\n{monitor}'


def _symbols(build: BuildPlan) -> list[Symbol]:
    """Parameters of leaf functions come in this order."""
    model = build.model
    return [
        *(Symbol(v.name, "variable") for v in model.variables),
        *(Symbol(c.name, "constant") for c in model.constants),
        *(i.symbol for i in build.paths.inputs),
        *dict.fromkeys(s.symbol for p in build.paths.paths for a in p.admissions for s in a.solved),
    ]


def _runtime(build: BuildPlan) -> str:
    stem = file_stem(build.model.name)
    rewards = f'#if !DL2C_REWARDS_APART\n#include "{stem}_rewards.h"\n#endif'
    runtime = '#include "batch.h" /* the runtime, compiled with this model as one unit */'
    return f'{rewards}\n#include "{stem}_tables.h"\n{runtime}\n'
