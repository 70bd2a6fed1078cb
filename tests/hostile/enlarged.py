"""Models that are as valid as the ones that they are made of, and larger in one respect or in several.

Every way to enlarge a model takes a draft and a size of 0, 1 or 2.
"""

import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from random import Random

from hostile.draft import Draft, piece, without_comments

EXAMPLES = (
    *(
        "acc",
        "bouncing_ball",
        "dubins",
        "etcs",
        "evasion",
        "forced_acceleration",
        "passive_safety",
        "pendulum",
    ),
    *("static_safety", "static_safety_line", "thermostat", "watertank", "waypoint"),
)

_PROJECTS = "LS-Lab__KeYmaeraX-projects/"
_RELEASED = "LS-Lab__KeYmaeraX-release/keymaerax-webui/src/"
PUBLIC = (
    (f"{_PROJECTS}benchmarks/advanced.kyx", 0),
    (f"{_PROJECTS}benchmarks/advanced.kyx", 3),
    (f"{_PROJECTS}benchmarks/basic.kyx", 6),
    (f"{_PROJECTS}benchmarks/basic.kyx", 7),
    (f"{_PROJECTS}benchmarks/games.kyx", 1),
    (f"{_PROJECTS}benchmarks/nonlinear2.kyx", 0),
    (f"{_PROJECTS}examples/lyapunov.kyx", 3),
    (f"{_PROJECTS}stability/UGpAS/examples/example3.kyx", 0),
    (f"{_PROJECTS}stability/UGpAS/examples/example8.kyx", 1),
    (f"{_PROJECTS}stability/UGpAS/nonholo/nonholotime.kyx", 0),
    (f"{_PROJECTS}lfcps/lfcps.kyx", 3),
    (f"{_PROJECTS}tutorials/fm-2019/speedcontrol.kyx", 3),
    (f"{_RELEASED}main/resources/examples/casestudies/etcs/rephrased/safety-lemma-brakingnoair.kyx", 0),
    (f"{_RELEASED}main/resources/examples/casestudies/roundabout/TRM-essentials.kyx", 0),
    (f"{_RELEASED}test/resources/examples/casestudies/components/llc/multiport_follower.kyx", 0),
    (f"{_RELEASED}test/resources/examples/casestudies/components/robix/robot.kyx", 0),
    (f"{_RELEASED}test/resources/examples/simple/bouncing-ball/bouncing-ball-tout.kyx", 0),
    (f"{_RELEASED}main/resources/examples/tutorials/basic/basictutorial.kyx", 3),
    (f"{_RELEASED}main/resources/examples/tutorials/cpsweek/cpsweek.kyx", 3),
    (f"{_RELEASED}main/resources/examples/tutorials/fm/fm.kyx", 2),
)
"""Files of the public corpus, and which of their entries."""

Enlarging = Callable[[Draft, int], None]


def base(number: int, examples: Path, corpus: Path) -> str:
    """The model that is enlarged: of every five, two are public ones."""
    turn, place = divmod(number, 5)
    if place < 3:
        return (examples / f"{EXAMPLES[(turn * 3 + place) % len(EXAMPLES)]}.kyx").read_text(encoding="utf-8")
    path, entry = PUBLIC[(turn * 2 + place - 3) % len(PUBLIC)]
    return piece((corpus / path).read_text(encoding="utf-8"), entry)


def enlarged(number: int, examples: Path, corpus: Path) -> str:
    """Model `number`, whose way and size follow from the number."""
    rng = Random(f"enlarged {number}")
    draft = Draft(base(number, examples, corpus), rng)
    ways = list(WAYS)
    chosen = [(ways[number % len(ways)], number // len(ways) % 3)]
    if rng.random() < 0.4:
        chosen += [(way, 0) for way in rng.sample(ways[2:], rng.choice((1, 2)))]
    for way, size in sorted(chosen, key=lambda each: ways.index(each[0])):
        WAYS[way](draft, size)
    return draft.text


# The whole model ---------------------------------------------------------------


def _product(draft: Draft, size: int) -> None:
    """Several copies with names of their own, side by side in one loop."""
    code = without_comments(draft.text)
    found = re.search(r"Problem\.?(.*?)->\s*\[\s*\{", code, re.DOTALL)
    if found is None or "}*" not in code[found.end() :] or "\\exists" in code:
        return _repeated(draft, size)
    texts = [draft.renamed(f"qc{k}x") for k in range(1, 2 + size)]
    for text in texts:
        copied = Draft(text, draft.rng)
        low, high = copied.loop()
        premise = re.search(r"Problem\.?(.*?)->\s*\[\s*\{", without_comments(text), re.DOTALL)
        assert premise is not None
        draft.before_body(f"{{{text[low:high]}}}")
        draft.assume(f"({premise[1]})")
        for section in ("Definitions", "ProgramVariables"):
            held = re.search(rf"\b{section}\b(.*?)\bEnd\.", text, re.DOTALL)
            place = re.search(rf"\b{section}\b", without_comments(draft.text))
            if held is not None and place is not None:
                draft.insert(place.end(), re.sub(r"import [^;]*;", "", held[1]))
    return None


def _long_names(draft: Draft, size: int) -> None:
    draft.text = draft.renamed("q" + "abcdefghij" * (2, 20, 150)[size])


# Names -------------------------------------------------------------------------


def _variables(draft: Draft, size: int) -> None:
    made = draft.variables((10, 50, 120)[size])
    draft.assume(" & ".join(f"{x} >= 0 & {x} <= 1" for x in made[::3]))
    draft.before_body(" ".join(f"{x} := 0.5 * {y} + 0.1;" for x, y in pairwise(made)))


def _constants(draft: Draft, size: int) -> None:
    (z,) = draft.variables(1, "[0:1000]")
    made = draft.names((10, 60, 200)[size])
    draft.define("\n".join(f"  /* @const: bound=[0:{k + 1}] */\n  Real {c};" for k, c in enumerate(made)))
    draft.before_body(f"{z} := {' + '.join(made[:150])};")


def _definitions(draft: Draft, size: int) -> None:
    (z,) = draft.variables(1)
    made = draft.names((5, 40, 80)[size])
    lines = [f"  Real {made[0]}(Real y) = y / 2;"]
    lines += [f"  Real {f}(Real y) = {g}(y) / 2 + {k};" for k, (g, f) in enumerate(pairwise(made))]
    draft.define("\n".join(lines))
    draft.before_body(f"{z} := {made[-1]}({z});")


def _annotations(draft: Draft, size: int) -> None:
    made = draft.names((20, 100, 300)[size])
    text = "what this number is " * 20
    draft.define("\n".join(f'  /* @const: bound=[0:1], unit="m", def="{text}" */\n  Real {c};' for c in made))


# Assumptions -------------------------------------------------------------------


def _assumptions(draft: Draft, size: int) -> None:
    made = draft.variables((4, 10, 20)[size], "[0:100]")
    count = (10, 50, 150)[size]
    pairs = [draft.rng.sample(made, 2) for _ in range(count)]
    draft.assume(" & ".join(f"{x} <= {y} + {50 + k}" for k, (x, y) in enumerate(pairs)))


def _alternatives(draft: Draft, size: int) -> None:
    made = draft.variables((2, 4, 8)[size], "[0:10]")
    draft.assume(" & ".join(f"({x} <= {k + 1} | {x} >= {9 - k / 10:g})" for k, x in enumerate(made)))


def _equalities(draft: Draft, size: int) -> None:
    """Linear ones that hold in the middle of the bounds."""
    count = (4, 8, 16)[size]
    made = draft.variables(count)
    lines: list[str] = []
    for _ in range(count // 2):
        factors = [draft.rng.randint(-3, 3) for _ in made]
        factors[draft.rng.randrange(count)] = 4
        sides = " + ".join(f"({f}) * {x}" for f, x in zip(factors, made, strict=True))
        lines.append(f"{sides} = {sum(factors) / 2:g}")
    draft.assume(" & ".join(lines))


# Programs ----------------------------------------------------------------------


def _wide_choice(draft: Draft, size: int) -> None:
    (z,) = draft.variables(1, "[0:1000]")
    draft.before_body(f"{{ {' ++ '.join(f'{z} := {k};' for k in range((5, 30, 150)[size]))} }}")


def _deep_choice(draft: Draft, size: int) -> None:
    (z,) = draft.variables(1, "[0:1000]")
    count = (5, 20, 35)[size]
    text = "".join(f"{{ {z} := {k}; ++ " for k in range(count))
    draft.before_body(f"{text}{z} := {count};{' }' * count}")


def _choices_in_a_row(draft: Draft, size: int) -> None:
    made = draft.variables((2, 3, 5)[size])
    draft.before_body(" ".join(f"{{ {z} := 0; ++ {z} := 0.5; ++ {z} := 1; }}" for z in made))


def _tests(draft: Draft, size: int) -> None:
    (z,) = draft.variables(1)
    draft.assume(f"{z} = 0")
    draft.before_body(" ".join(f"?{z} <= {k + 1} & {z}^2 <= {k + 2}.5;" for k in range((10, 50, 150)[size])))


def _repeated(draft: Draft, size: int) -> None:
    begin, end = draft.loop()
    body = draft.text[begin:end]
    draft.before_body(" ".join([f"{{{body}}}"] * (1 + size)))


def _inputs(draft: Draft, size: int) -> None:
    made = draft.variables((2, 5, 10)[size])
    draft.before_body(" ".join(f"{x} := *; ?0 <= {x} & {x} <= {k + 1};" for k, x in enumerate(made)))


def _conditionals(draft: Draft, size: int) -> None:
    (z,) = draft.variables(1, "[0:100]")
    count = (3, 10, 30)[size]
    text = "".join(f"if ({z} <= {k}) {{ {z} := {k + 1}; }} else {{ " for k in range(count))
    draft.before_body(f"{text}{z} := 0;{' }' * count}")


def _parentheses(draft: Draft, size: int) -> None:
    (z,) = draft.variables(1)
    depth = (10, 40, 60)[size]
    draft.before_body(f"{z} := {'(' * depth}{z}{' / 2)' * depth};")


def _inner_loops(draft: Draft, size: int) -> None:
    made = draft.variables(1 + size, "[0:10]")
    text = ""
    for z in made:
        text = f"{{ ?{z} <= 5; {z} := {z} + 1; {text} }}*"
    draft.before_body(f"{text} ?true;")


# Numbers -----------------------------------------------------------------------


def _numbers(draft: Draft, size: int) -> None:
    (z,) = draft.variables(1)
    digits = "".join(draft.rng.choice("123456789") for _ in range((20, 100, 300)[size]))
    draft.before_body(f"{z} := {z} * 0.{digits} + {digits[:250]} - {digits[:250]};")
    draft.assume(f"{z} <= {digits}")


def _degrees(draft: Draft, size: int) -> None:
    x, y = draft.variables(2)
    power = (4, 12, 40)[size]
    draft.assume(f"{x}^{power} + {y}^{power} <= 1")
    draft.before_body(f"?{x}^{power} - 3 * {x} * {y}^{power - 1} <= 5; {x} := {x}^{power} / 2;")


# Flows -------------------------------------------------------------------------


def _domain(draft: Draft, size: int) -> None:
    (z,) = draft.variables(1)
    draft.flow(f", {z}' = 1", " & ".join(f"{z} <= {k + 10}" for k in range((5, 40, 150)[size])))


def _equations(draft: Draft, size: int) -> None:
    """A chain of integrators."""
    made = draft.variables((2, 8, 30)[size])
    draft.flow("".join(f", {x}' = {y}" for x, y in zip(made, [*made[1:], "0.1"], strict=True)))


def _flows(draft: Draft, size: int) -> None:
    x, t = draft.variables(2)
    draft.before_body(
        " ".join(
            f"{t} := 0; {{{x}' = {k} - {x}, {t}' = 1 & {t} <= 0.{k + 1}}}" for k in range((2, 4, 8)[size])
        )
    )


WAYS: dict[str, Enlarging] = {
    "product": _product,
    "repeated": _repeated,
    "variables": _variables,
    "constants": _constants,
    "definitions": _definitions,
    "annotations": _annotations,
    "assumptions": _assumptions,
    "alternatives": _alternatives,
    "equalities": _equalities,
    "wide choice": _wide_choice,
    "deep choice": _deep_choice,
    "choices in a row": _choices_in_a_row,
    "tests": _tests,
    "inputs": _inputs,
    "conditionals": _conditionals,
    "parentheses": _parentheses,
    "inner loops": _inner_loops,
    "numbers": _numbers,
    "degrees": _degrees,
    "domain": _domain,
    "equations": _equations,
    "flows": _flows,
    "long names": _long_names,
}
