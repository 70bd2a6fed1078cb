"""Predicates, rewards and the end of episodes in plain Python (semantics 6)."""

from collections.abc import Iterator
from dataclasses import replace

from dl2c.emit.cfile import place
from dl2c.emit.names import python_attribute, python_predicate
from dl2c.emit.plan import BuildPlan
from dl2c.emit.python.expr import AND, OR, Bracketed, Expression, Writer, joined, statement
from dl2c.emit.python.parts import condition, function
from dl2c.flows.watch import watches_of
from dl2c.ir.model import (
    TRUE,
    And,
    Compare,
    Comparison,
    Formula,
    Model,
    Or,
    Predicate,
    Rank,
    Symbol,
    Trigger,
    rank,
)
from dl2c.ir.printer import print_formula
from dl2c.ir.slack import relaxed, terms_of

JUDGEMENT = '''\
class Judgement(NamedTuple):
    """What the predicates say of a step."""

    reward: float
    cost: int
    ends: str
    status: str
    reason: str
    undefined: bool
'''


def judge_functions(build: BuildPlan, writer: Writer) -> Iterator[str]:
    """One function for each predicate, then what they say together."""
    model = build.model
    for predicate in model.predicates:
        yield _holds(predicate, model, writer)
        if predicate.due is not None:
            about = f"When {predicate.name} must hold at the latest."
            yield condition(python_predicate(predicate.name, "due"), about, predicate.due, writer)
    about = "What the model proves of every state."
    yield condition("postcondition", about, model.postcondition or TRUE, writer)
    yield from _watched(model)
    yield _judged(model, writer)
    yield _unmoved(model, writer)


def _holds(predicate: Predicate, model: Model, writer: Writer) -> str:
    """The predicate within its tolerance: `at_most(a, b, slack(a, b))` for a <= b, where that says the same.
    Along motion slacks are those of the state `start` in which it begins.
    """
    about = (
        f"{place(predicate.span)}  @{predicate.category} {predicate.name}: {print_formula(predicate.formula)}"
    )
    watched = any(model.predicates[w.predicate] is predicate for w in watches_of(model))
    begins = ", start: State | None = None" if watched else ""
    head = f"def {python_predicate(predicate.name)}(s: State{begins}) -> bool:"
    before = replace(writer, name=_at_start) if watched else writer
    lines = ["    start = s if start is None else start"] if watched and predicate.slacks else []
    if relaxed(predicate.formula, model.tolerance) == predicate.relaxed and model.tolerance > 0:
        within = _tolerant(predicate.formula, writer, before)
    elif not watched or predicate.along is None:
        within = writer.formula(predicate.relaxed)
    else:
        for symbol, term in predicate.slacks:
            value = Bracketed("defined", (before.term(term),))
            lines += statement(f"{symbol.name} = ", value, "", 4)

        def named(symbol: Symbol) -> str:
            return symbol.name if symbol.kind == "start" else writer.name(symbol)

        within = replace(writer, name=named).formula(predicate.along)
    return function(head, about, [*lines, *statement("return ", within, "", 4)])


def _at_start(symbol: Symbol) -> str:
    return f"start.{python_attribute(symbol.name)}"


NEAR: dict[Comparison, str] = {"=": "equal", "<": "less", ">": "less", "<=": "at_most", ">=": "at_most"}


def _tolerant(formula: Formula, writer: Writer, before: Writer) -> Expression:
    match formula:
        case And(children):
            return joined(AND, "and", [_tolerant(c, writer, before) for c in children])
        case Or(children):
            return joined(OR, "or", [_tolerant(c, writer, before) for c in children])
        case Compare(op, left, right) if op != "!=":
            sides = (right, left) if op in (">", ">=") else (left, right)
            slack = Bracketed("slack", tuple(before.term(t) for t in terms_of(formula)))
            return Bracketed(NEAR[op], (*map(writer.term, sides), slack))
        case _:
            return writer.formula(formula)


def _watched(model: Model) -> Iterator[str]:
    """What is watched along motion: safety with whether a violation cuts it; obligations."""
    safety: list[Expression] = []
    obligations: list[Expression] = []
    for watch in watches_of(model):
        name = model.predicates[watch.predicate].name
        holds = python_predicate(name)
        if watch.kind == "safety":
            safety.append(f'"{name}": ({holds}, {watch.cuts})')
        else:
            obligations.append(f'"{name}": ({python_predicate(name, "due")}, {holds})')
    for table, entries in (("SAFETY", safety), ("OBLIGATIONS", obligations)):
        head = f"{table}: dict[str, Any] = "
        yield "\n".join(statement(head, Bracketed("", tuple(entries), "{}"))) + "\n"


def _judged(model: Model, writer: Writer) -> str:
    lines = ["    pays: list[float] = []"]
    for predicate in model.predicates:
        lines += _facts(predicate, model)
        lines += _pays(predicate, writer)
    costs = [f"(not {p.name}_holds)" for p in model.predicates if p.category == "safety"]
    lines += [
        f"    cost = {' + '.join(costs) if len(costs) > 1 else f'int{costs[0]}' if costs else '0'}",
        "    reward = sum((x for x in pays if math.isfinite(x)), 0.0)",
        "    undefined = not all(map(math.isfinite, pays))",
        '    status = "none"',
    ]
    for condition_, _, trigger in reversed(_triggers(model, ending=False)):
        lines += [f"    if {condition_}:", f'        status = "{trigger.status}"']
    for condition_, name, trigger in _triggers(model, ending=True):
        result = f'Judgement(reward, cost, "{trigger.action}", "{trigger.status}", "{name}", undefined)'
        lines += [f"    if {condition_}:", f"        return {result}"]
    lines.append('    return Judgement(reward, cost, "", status, "", undefined)')
    head = "def judged(s: State, failed: set[str], met: set[str], late: bool) -> Judgement:"
    about = "Reward and end after a step; `failed` and `met` are what happened on the way."
    return function(head, about, lines)


def _unmoved(model: Model, writer: Writer) -> str:
    """What a step without a run earns: the shapes of the state that it leaves, in a loop."""
    shapes = [writer.term(p.shape) for p in model.predicates if p.shape is not None and model.loops]
    lines = ['    return Judgement(0.0, 0, "", "none", "", False)']
    if shapes:
        pays = statement("pays = ", Bracketed("", tuple(shapes), "[]"), "", 4)
        reward = "sum((x for x in pays if math.isfinite(x)), 0.0)"
        lines = [*pays, f"    reward = {reward}", lines[0].replace("0.0", "reward")]
    about = "What a step earns that has no run, and so changes nothing."
    return function("def unmoved(s: State) -> Judgement:", about, lines)


def _facts(predicate: Predicate, model: Model) -> Iterator[str]:
    name, holds = predicate.name, f"{python_predicate(predicate.name)}(s)"
    watched = any(model.predicates[w.predicate] is predicate for w in watches_of(model))
    on_the_way = f' and "{name}" not in failed' if predicate.category == "safety" and watched else ""
    matters = (predicate.reward, predicate.penalty, predicate.on_success, predicate.on_failure)
    if predicate.category == "safety" or any(part is not None for part in matters):
        yield f"    {name}_holds = {holds}{on_the_way}"
    if predicate.category == "progress" and predicate.on_failure is not None:
        due = "late" if predicate.due is None else f"{python_predicate(name, 'due')}(s)"
        yield f"    {name}_fails = not {name}_holds and {due}"
        if watched:
            yield f'    if "{name}" in failed | met:'
            yield f'        {name}_fails = "{name}" in failed'


def _pays(predicate: Predicate, writer: Writer) -> Iterator[str]:
    for term, when in (
        (predicate.reward, f"{predicate.name}_holds"),
        (predicate.penalty, f"not {predicate.name}_holds"),
        (predicate.shape, ""),
    ):
        if term is not None:
            if when:
                yield f"    if {when}:"
            indent = 8 if when else 4
            yield from statement("", Bracketed("pays.append", (writer.term(term),)), "", indent)


def _fails(predicate: Predicate) -> str:
    return f"{predicate.name}_fails" if predicate.category == "progress" else f"not {predicate.name}_holds"


def _triggers(model: Model, ending: bool) -> list[tuple[str, str, Trigger]]:
    """What predicates may bring, ends or what goes on, the most important first."""
    found: list[tuple[Rank, str, str, Trigger]] = []
    for k, p in enumerate(model.predicates):
        for trigger, when in ((p.on_success, f"{p.name}_holds"), (p.on_failure, _fails(p))):
            if trigger is not None and (trigger.action != "continue") == ending:
                found.append((rank(k, p, trigger), when, p.name, trigger))
    return [(when, name, trigger) for _, when, name, trigger in sorted(found, key=lambda f: f[0])]
