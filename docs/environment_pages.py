"""The pages of environments as Markdown, below what is written by hand: ```` ```{dl2c} environment acc ````.

Spaces, rewards, ends, constants and what is proved come from the model when the pages are built. What
policies achieve is read from `docs/environments/NAME.json`, which `measure.py` writes.
"""

import hashlib
import json
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dl2c.commands.describe import MASKS
from dl2c.env.actions import encoding
from dl2c.env.encodings import NoDecision
from dl2c.env.opening import compilation_of, examples_dir, source_of
from dl2c.env.registration import EXAMPLES as IDS
from dl2c.env.spaces import observation_space
from dl2c.experiments.studies.page import problem
from dl2c.ir.printer import print_model
from dl2c.native.manifest import ChoiceSpec, InputSpec, Manifest
from dl2c.options import Options, as_words
from dl2c.parse import tree
from dl2c.parse.printer import print_formula, print_term
from dl2c.pipeline import Compilation
from dl2c.resolve.predicates import AnnotatedPredicate
from dl2c.source import Source
from dl2c.training.run import Estimate
from dl2c.verify.prove import Limits, prove
from dl2c.verify.report import Report

EXAMPLES = examples_dir()
TUNED = EXAMPLES / "tuned"
NUMBERS = Path(__file__).parent / "environments"
STUDIES = Path(__file__).parent / "studies"

LIMITS = Limits(3.0, 30.0, jobs=1)
"""Of a proof: what can be proved of the examples takes a third of that."""


@dataclass(frozen=True)
class Page:
    """The model of a page, and what is known of it."""

    name: str

    @cached_property
    def compilation(self) -> Compilation:
        """Its stages."""
        return compilation_of(EXAMPLES / f"{self.name}.kyx", {})

    @cached_property
    def manifest(self) -> Manifest:
        """Its spaces."""
        return self.compilation.manifest()

    @cached_property
    def report(self) -> Report:
        """The answer of `dl2c verify`."""
        return prove(self.source, Options(), LIMITS)

    @property
    def source(self) -> Source:
        """Its text."""
        return source_of(EXAMPLES / f"{self.name}.kyx")

    @cached_property
    def numbers(self) -> dict[str, Any]:
        """What was measured."""
        return json.loads((NUMBERS / f"{self.name}.json").read_text(encoding="utf-8"))


def files(name: str) -> list[Path]:
    """What a page is made of besides the code."""
    return [EXAMPLES / f"{name}.kyx", NUMBERS / f"{name}.json"]


def model_digest(compilation: Compilation) -> str:
    """SHA-256 of what a model means: comments, texts of annotations and the scene do not change it."""
    lines = print_model(compilation.lowered.model).splitlines()
    meant = [line for line in lines if not line.startswith("@scene")]
    plain = as_words(Options())
    chosen = [(k, v) for k, v in sorted(as_words(compilation.resolved.options).items()) if v != plain[k]]
    return hashlib.sha256("\n".join([*meant, repr(chosen)]).encode()).hexdigest()


def environment(name: str) -> str:
    """A page below its first two sentences."""
    page = Page(name)
    parts = (described, proof, achieved, _train)
    return "\n\n".join(text for part in parts for text in part(page))


def film(name: str) -> str:
    """What stands below a film: who acts in it, and the name of the environment."""
    said = Page(name).numbers["film"]
    acting = {"trained": "A trained policy", "random": "Random actions", "first": "What happens"}
    rate = "in real time" if said["speed"] == 1 else f"{said['speed']:g} times as fast as it is"
    id = next(key for key, value in IDS.items() if value == name)
    return f'*{acting[said["policy"]]}, shown {rate}.*\n\n```text\ngymnasium.make("dl2c:dl2c/{id}-v0")\n```'


def cards() -> str:
    """A picture of each environment that leads to its page."""
    entries = [_card(path.stem) for path in sorted(EXAMPLES.glob("*.kyx"))]
    return "\n".join(["```{container} cards", *entries, "```"])


def _card(name: str) -> str:
    about = first_sentence(source_of(EXAMPLES / f"{name}.kyx").text)
    return f"- [![](/environments/{name}.png) **{name}**](/environments/{name}.md)<br>{about}"


def first_sentence(text: str) -> str:
    """The first sentence of the comment with which an example begins."""
    found = re.match(r"/\*\s*(.*?[.])\s", text, re.DOTALL)
    assert found is not None, "examples begin with a comment"
    return re.sub(r"\s*\n \*\s*", " ", found[1])


# From the model ---------------------------------------------------------------------------------


def _table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [titles, ["---"] * len(titles), *rows]
    cells = ([cell.replace("|", "\\|") for cell in line] for line in lines)
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)


def _code(text: str) -> str:
    return f"`{' '.join(text.split())}`" if text else ""


def _meaning(text: str, unit: str) -> str:
    return f"{text}, {unit}" if text and unit else text or unit


def _number(value: float) -> str:
    return f"{value:.5g}" if math.isfinite(value) else "∞" if value > 0 else "-∞"


def described(page: Page) -> Iterator[str]:
    """Spaces, rewards, ends and constants."""
    for part in (_observations, _actions, _rewards, _constants):
        yield from part(page)


def _observations(page: Page) -> Iterator[str]:
    box = observation_space(page.manifest)
    yield "## Spaces"
    yield f"**Observation**: a `Box` of {len(page.manifest.observations)} numbers of type `{box.dtype}`."
    yield _table(
        ("entry", "meaning", "low", "high"),
        [
            (_code(q.name), _meaning(q.description, q.unit), _number(q.low), _number(q.high))
            for q in page.manifest.observations
        ],
    )


def _actions(page: Page) -> Iterator[str]:
    manifest = page.manifest
    code = encoding(manifest)
    if isinstance(code, NoDecision):
        yield "**Action**: there is nothing to decide. The action space is `Discrete(1)`, whose 0 goes on."
    else:
        yield f"**Action**: `{' '.join(str(code.space()).split())}`."
    yield from _decisions(page, manifest.choices, manifest.inputs)
    if manifest.choices:
        yield f'`info["action_mask"]` says which alternatives have a run, {MASKS["flow"]}.'
    if manifest.inputs:
        yield "A value that is not admissible becomes the nearest one that is."
    if manifest.drawn_choices or manifest.drawn_inputs:
        yield "Chance decides this, uniformly:"
        yield from _decisions(page, manifest.drawn_choices, manifest.drawn_inputs)


def _decisions(page: Page, choices: Sequence[ChoiceSpec], inputs: Sequence[InputSpec]) -> Iterator[str]:
    for choice in choices:
        title = f"`{choice.key}`" + (f", {choice.name}" if choice.name else "")
        rows = [(str(k), _code(text)) for k, text in enumerate(choice.alternatives)]
        yield _table((title, "alternative"), rows)
    if inputs:
        about = {v.name: _meaning(v.description, v.unit) for v in page.manifest.variables}
        rows = [(_code(i.key), about[i.variable], _number(i.low), _number(i.high)) for i in inputs]
        yield _table(("value", "meaning", "low", "high"), rows)


def _rewards(page: Page) -> Iterator[str]:
    yield "## Rewards and ends"
    yield "\n".join(_predicate(p) for p in page.compilation.resolved.problem.predicates)
    limit = page.manifest.options["max_episode_steps"]
    every = "[All ends](../semantics.md#6-rewards-and-episode-ends)"
    yield f"After {limit} steps an episode is truncated. {every}."


def _predicate(predicate: AnnotatedPredicate) -> str:
    declaration, said = predicate.declaration, predicate.annotation
    assert isinstance(declaration.body, tree.Formula)
    names = ", ".join(p.name for p in declaration.parameters or ())
    pays = {
        "pays {} where it holds": said.reward,
        "pays {} where it does not": said.penalty,
        "pays {} after every step": said.shape,
    }
    facts = [form.format(_code(_printed(term))) for form, term in pays.items() if term is not None]
    fails = "fails when it is due" if said.category == "progress" else "fails"
    ends = {"holds": said.on_success, fails: said.on_failure}
    facts += [
        f"where it {word}, the episode {ENDS[end.action]}, with status `{end.status}`"
        for word, end in ends.items()
        if end is not None
    ]
    head = f"- **{declaration.name}** (`@{said.category}`), {_code(f'{declaration.name}({names})')} being"
    lines = [f"{head} {_code(print_formula(declaration.body))}:", *(f"  - {fact}" for fact in facts)]
    return "\n".join(lines)


ENDS = {"terminate": "is terminated", "truncate": "is truncated", "continue": "goes on"}


def _printed(term: tree.Term | tree.Formula) -> str:
    return print_formula(term) if isinstance(term, tree.Formula) else print_term(term)


def _constants(page: Page) -> Iterator[str]:
    drawn = [
        (_code(q.name), _meaning(q.description, q.unit), f"{_number(q.low)} to {_number(q.high)}")
        for q in page.manifest.constants
    ]
    text = page.source.text
    defined = [
        (_code(d.name), _comment(text, d.body), _code(print_term(d.body)))
        for d in page.compilation.resolved.problem.entry.definitions
        if d.parameters is None and isinstance(d.body, tree.Term)
    ]
    if drawn or defined:
        yield "## Constants"
        yield _table(("constant", "meaning", "value"), [*drawn, *defined])
    if drawn:
        yield "A range is drawn from at every reset, as far as the assumptions of the model allow."


def _comment(text: str, body: tree.Term) -> str:
    """What stands on the line of a definition after it."""
    found = re.match(r"[^\S\n]*;[^\S\n]*/\*(?!\s*@)\s*(.*?)\s*\*/", text[body.span.end :], re.DOTALL)
    return " ".join(found[1].split()) if found else ""


def proof(page: Page) -> Iterator[str]:
    """The theorem, and what is known of it."""
    report = page.report
    yield "## What is proved"
    yield f"```text\n{problem(page.source.text)}\n```"
    command = f"`dl2c verify examples/{page.name}.kyx`"
    yield f"{command} says of this theorem, as it is written: **{report.answer}**."
    if report.within_bounds != report.answer:
        yield f"Where all names begin inside their bounds: **{report.within_bounds}**."
    left = [o for o in report.obligations if o.answer != "proved"]
    if left:
        done = ", ".join(f"*{o.title}*" for o in report.obligations if o.answer == "proved")
        yield "\n".join(
            [*(f"- *{o.title}*: {o.answer}" + (f", {o.reason}" if o.reason else "") for o in left)]
            + ([f"- proved: {done}"] if done else [])
        )


# From what was measured -------------------------------------------------------------------------

POLICIES = {
    "random": "random",
    "first": "first enabled",
    "trained": "trained, {seeds} seeds",
    "best": "best known",
}

ACTING = """\
*Random* draws uniformly among enabled alternatives and between the limits of values; *first enabled* takes
the first alternative that is, and 0 for values."""


def achieved(page: Page) -> Iterator[str]:
    """What policies achieve."""
    numbers, rows = page.numbers, page.numbers["rows"]
    shown = ["return", *(["success"] if has_goal(page) else []), "violations"]
    named = {key: text.format(**numbers) for key, text in POLICIES.items() if key in rows}
    if "trained" not in rows:
        named = {"first": "nothing to decide"}
    yield "## Results"
    yield _table(
        ("policy", *shown),
        [(text, *(_estimate(rows[key].get(what), what) for what in shown)) for key, text in named.items()],
    )
    yield (
        f"Means of {numbers['episodes']} episodes of each policy, with 95 % intervals. "
        "A violation is an episode in which a `@safety` predicate failed."
    )
    if "trained" in rows:
        yield f"{ACTING} {_origin(rows['best'])}"


def has_goal(page: Page) -> bool:
    """Whether an episode can succeed."""
    ends = [p.annotation.on_success for p in page.compilation.resolved.problem.predicates]
    return any(end is not None and end.action != "continue" for end in ends)


def _origin(best: dict[str, Any]) -> str:
    """Where the best known policy is from."""
    again = "measured again in other episodes"
    match best["from"]:
        case "study":
            return f"*Best known* is the policy of the study, trained for {best['steps']:,} steps."
        case "trained":
            return f"*Best known* is the best of the trained policies, {again}."
        case other:
            return f"*Best known* is what none that was trained does better than: {POLICIES[other]}, {again}."


def _estimate(found: dict[str, float] | None, what: str) -> str:
    if found is None:
        return ""
    return Estimate(**found).shown(".4g" if what == "return" else ".1%")


def _train(page: Page) -> Iterator[str]:
    yield "## Train and play"
    if page.numbers["command"]:
        yield f"<!-- needs: stable_baselines3 -->\n```sh\n{page.numbers['command']}\n```"
    else:
        yield "There is nothing to train."
    yield f'<a href="../play/{page.name}.html">Drive it yourself</a> in the browser.'
    if (STUDIES / page.name / "page.md").exists():
        yield f"[The study](../studies/{page.name}/page.md) trains it with its guards and without."
