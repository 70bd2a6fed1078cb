"""Reads models for a test that cannot afford to hang: a path and what to do a line, a JSON object back.

What to do is `check`, which looks for lints too, or `build`, which also steps the environment once.
Memory is limited.
"""

import json
import resource
import sys

import dl2c
from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError, render
from dl2c.env.opening import source_of
from dl2c.lint.check import examine
from dl2c.pipeline import check_model
from dl2c.source import NOWHERE

MEMORY = 4 * 1024**3


def result_of(task: str, path: str) -> dict[str, object]:
    try:
        if task == "check":
            warnings = check_model(source_of(path), resolve_options({}))
            examine(source_of(path), resolve_options({}), portable=True)
            return {"codes": ["builds", *(d.code for d in warnings)], "located": True}
        else:
            env = dl2c.make(path)
            env.action_space.seed(0)
            env.reset(seed=0)
            env.step(env.action_space.sample())
        return {"codes": ["builds"], "located": True}
    except CompileError as refused:
        located = all(d.span != NOWHERE and d.span.place for d in refused.diagnostics)
        assert all(render(d).isprintable() or "\n" in render(d) for d in refused.diagnostics)
        return {"codes": [d.code for d in refused.diagnostics], "located": located}
    except BaseException as crash:
        return {"codes": [f"{type(crash).__name__}: {crash}"[:2000]], "located": False}


def main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    for line in sys.stdin:
        task, path = line.rstrip("\n").split(" ", 1)
        print(json.dumps(result_of(task, path)), flush=True)


if __name__ == "__main__":
    main()
