"""What `dl2c check` may warn of: the codes, what each means, which `--fix` can mend."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Lint:
    """A kind of warning. `fixable` where `--fix` knows what to write instead."""

    code: str
    meaning: str
    fixable: bool = False


LINTS = (
    Lint("agent-moves-world", "the agent chooses among alternatives that only test and evolve"),
    Lint("constant-test", "a test or condition is always true, always false, or a domain never holds"),
    Lint("dead-alternative", "an alternative of a choice has no run from any state"),
    Lint("deadlock", "a state that satisfies the loop's @invariant has no run"),
    Lint("decision-in-loop", "a decision inside a loop of a step is made only once"),
    Lint("default-dt", "nothing but the default of 0.1 s limits how long a flow lasts"),
    Lint("deprecated-option", "`@episode` gives an option a value that has a new name"),
    Lint(
        "existential-constant", "a constant stands for some value of an existential quantifier, not for all"
    ),
    Lint("if-in-choice", "the branches of an `if` become alternatives of a choice around it"),
    Lint("keymaera-rejects", "KeYmaera X 5 does not read this; an error with `--portable`", fixable=True),
    Lint("minus-in-quotient", "`x/-y/z` means `x/(-(y/z))` to KeYmaera X", fixable=True),
    Lint("no-annotations", "every variable is observed without limits; `dl2c annotate` suggests some"),
    Lint("non-potential-shaping", "a shape can be positive, so it pays to put off success"),
    Lint("positive-penalty", "a penalty rewards"),
    Lint("postcondition-not-safe", "a state may satisfy every @safety predicate, but not the postcondition"),
    Lint("safety-after-steps", "@safety is not watched along a flow after which the step goes on"),
    Lint("strict-clock", "`t < e` is not a clock, so the default of 0.1 s limits the flow; `t <= e` is one"),
    Lint("truncate-on-failure", "learners take a truncated failure for an episode that goes on"),
    Lint("unbounded", "an observed name has no finite bound"),
    Lint("undecided-precondition", "it is not known whether there is an initial state"),
    Lint("undeclared-names", "names are used that nothing declares", fixable=True),
    Lint("unit-mismatch", "units given by `unit=` do not fit together"),
    Lint("unknown-lint", "`allow` names a code that does not exist"),
    Lint("unobserved-variable", "a step depends on a variable that is not observed"),
    Lint("unsampled-precondition", "initial states cannot be drawn, so resets need one"),
    Lint("zero-duration", "a step that takes no time can be repeated for ever"),
)
"""In alphabetical order."""

CODES = tuple(lint.code for lint in LINTS)
