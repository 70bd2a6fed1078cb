"""Why initial states of a model cannot be drawn, as messages."""

from collections.abc import Sequence

from dl2c.diagnostics import Diagnostic, error
from dl2c.ir.model import Call, Compare, Constant, Formula, Variable
from dl2c.paths.zeros import MAX_DEGREE
from dl2c.smt.precondition import span_of, text_of
from dl2c.source import NOWHERE, Span

GIVE_STATE = 'or give the state with reset(options={"state": ...})'


def _refused(span: Span, label: str, help: str = f"rewrite the precondition, {GIVE_STATE}") -> Diagnostic:
    return error("unsampled-precondition", "initial states cannot be sampled", span, label=label, help=help)


def unbounded(items: Sequence[Variable | Constant]) -> Diagnostic:
    """Names to draw that neither a bound nor the precondition limits; at least one."""
    names = ", ".join(f"`{i.name}`" for i in items)
    places = tuple(f"`{i.name}` is declared at {i.span.place}" for i in items[1:] if i.span != NOWHERE)
    annotations = dict.fromkeys("@var" if isinstance(i, Variable) else "@const" for i in items)
    several = len(items) > 1
    return error(
        "unbounded-variable",
        f"the initial value{'s' * several} of {names} {'have' if several else 'has'} no finite limits",
        items[0].span,
        label="neither a bound nor the precondition limits it",
        help=f"annotate {'each' if several else 'it'} with `{'` or `'.join(annotations)}: bound=[lo:hi]`, "
        "or give `--default-bound`",
        notes=places,
    )


def transcendental(call: Call, atom: Compare) -> Diagnostic:
    """A function whose values doubles do not give exactly enough to prove anything."""
    return _refused(atom.span, f"`{call.function}` in `{text_of(atom)}` has no exact arithmetic")


def unsolved(atom: Compare) -> Diagnostic:
    """An equality that is not a polynomial of moderate degree in a name that no other one determines."""
    label = (
        f"`{text_of(atom)}` determines no name: it must be a polynomial of degree 1 or 2 in one, "
        f"or up to {MAX_DEGREE} in one with limits"
    )
    return _refused(atom.span, label)


def entangled(precondition: Formula, alternatives: bool) -> Diagnostic:
    """Equalities that stand in too many alternatives, or of which too many have names in common."""
    many = "stand in too many alternatives" if alternatives else "depend on each other in too many ways"
    return _refused(span_of(precondition), f"its equalities {many}")


def imprecise(atom: Formula) -> Diagnostic:
    """Numbers that no double represents."""
    return _refused(span_of(atom), "it has numbers beyond floating-point arithmetic")


def too_long(precondition: Formula) -> Diagnostic:
    """High powers, whose rounding errors take long terms to bound."""
    return _refused(span_of(precondition), "the test of a drawn state would be too long")


def unbounded_density(precondition: Formula) -> Diagnostic:
    """Equalities whose solutions have, near some point, no largest slope."""
    return _refused(
        span_of(precondition), "the states that its equalities leave are infinitely steep somewhere"
    )


def beyond_doubles(item: Variable | Constant) -> Diagnostic:
    """A name between whose limits there is no double."""
    return _refused(item.span, f"no floating-point number lies between the limits of `{item.name}`")


def without_sample(precondition: Formula) -> Diagnostic:
    """A set too thin to be hit by chance."""
    return _refused(span_of(precondition), "the states that satisfy it are too rare to be found by drawing")
