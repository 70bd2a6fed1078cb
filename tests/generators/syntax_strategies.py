"""Random syntax trees: every tree that the grammar can produce, in small sizes."""

from fractions import Fraction
from functools import cache

from hypothesis import strategies as st

from dl2c.parse.tree import (
    And,
    Archive,
    Assign,
    AssignAny,
    AtomicODE,
    Box,
    Choice,
    Compare,
    Compose,
    Declaration,
    Diamond,
    Differential,
    DifferentialFormula,
    DifferentialProgramConst,
    DifferentialSymbol,
    Divide,
    Dual,
    Entry,
    Equiv,
    Exists,
    Forall,
    Formula,
    FuncOf,
    Imply,
    Loop,
    Minus,
    Neg,
    Not,
    Number,
    ODESystem,
    Or,
    Parameter,
    Plus,
    Power,
    PredicationalOf,
    PredOf,
    Program,
    ProgramConst,
    Term,
    Test,
    Times,
    Truth,
    UnitFunctional,
    UnitPredicational,
    Variable,
)

NAMES = st.sampled_from(["x", "y", "v", "A", "ep", "x_", "x_0", "K1_2", "z__1", "if", "old", "e", "forall"])
PROGRAM_NAMES = st.sampled_from(["a", "ctrl", "plant", "b_"])
TABOO = st.lists(NAMES, max_size=2).map(tuple)
DECIMALS = st.builds(lambda n, places: Fraction(n, 10**places), st.integers(0, 10**6), st.integers(0, 8))
COMPARISONS = st.sampled_from(["=", "!=", "<", "<=", ">", ">="])


@cache
def terms(depth: int = 3) -> st.SearchStrategy[Term]:
    """Terms of at most `depth` levels above the leaves."""
    leaves = [
        st.builds(Number, DECIMALS),
        st.builds(Variable, NAMES),
        st.builds(DifferentialSymbol, NAMES),
        st.builds(UnitFunctional, NAMES, TABOO),
    ]
    if depth == 0:
        return st.one_of(*leaves)
    term = st.deferred(lambda: terms(depth - 1))
    binary = [st.builds(node, term, term) for node in (Plus, Minus, Times, Divide, Power)]
    unary = [st.builds(Neg, term), st.builds(Differential, term)]
    return st.one_of(
        *leaves, *binary, *unary, st.builds(FuncOf, NAMES, st.lists(term, max_size=3).map(tuple))
    )


@cache
def formulas(depth: int = 3) -> st.SearchStrategy[Formula]:
    """Formulas of at most `depth` levels above the atoms; so are the programs in them."""
    atoms = [
        st.builds(Truth, st.booleans()),
        st.builds(Compare, COMPARISONS, terms(2), terms(2)),
        st.builds(PredOf, NAMES, st.lists(terms(1), max_size=2).map(tuple)),
        st.builds(UnitPredicational, NAMES, TABOO),
    ]
    if depth == 0:
        return st.one_of(*atoms)
    formula = st.deferred(lambda: formulas(depth - 1))
    program = st.deferred(lambda: programs(depth - 1))
    binary = [st.builds(node, formula, formula) for node in (And, Or, Imply, Equiv)]
    modal = [st.builds(node, program, formula) for node in (Box, Diamond)]
    quantified = [st.builds(node, NAMES, formula) for node in (Forall, Exists)]
    unary = [st.builds(Not, formula), st.builds(DifferentialFormula, formula)]
    return st.one_of(*atoms, *binary, *modal, *quantified, *unary, st.builds(PredicationalOf, NAMES, formula))


@cache
def programs(depth: int = 3) -> st.SearchStrategy[Program]:
    """Programs of at most `depth` levels above the statements; so are the formulas in them."""
    formula = st.deferred(lambda: formulas(max(0, depth - 1)))
    invariants = st.lists(formulas(0), max_size=2).map(tuple)
    equations = st.one_of(
        st.builds(AtomicODE, NAMES, terms(2)),
        st.builds(DifferentialProgramConst, NAMES, st.one_of(st.none(), TABOO)),
    )
    statements = [
        st.builds(Assign, NAMES, terms(2), st.booleans()),
        st.builds(AssignAny, NAMES, st.booleans()),
        st.builds(Test, formula),
        st.builds(ProgramConst, PROGRAM_NAMES),
        st.builds(ODESystem, st.lists(equations, min_size=1, max_size=3).map(tuple), formula, invariants),
    ]
    if depth == 0:
        return st.one_of(*statements)
    program = st.deferred(lambda: programs(depth - 1))
    binary = [st.builds(node, program, program) for node in (Compose, Choice)]
    unary = [st.builds(Loop, program, invariants), st.builds(Dual, program)]
    return st.one_of(*statements, *binary, *unary)


def _declarations() -> st.SearchStrategy[Declaration]:
    parameters = st.one_of(st.none(), st.lists(st.builds(Parameter, NAMES), max_size=2).map(tuple))
    return st.one_of(
        st.builds(Declaration, st.just("Real"), NAMES, parameters, st.one_of(st.none(), terms(2))),
        st.builds(Declaration, st.just("Bool"), NAMES, parameters, st.one_of(st.none(), formulas(1))),
        st.builds(Declaration, st.just("HP"), PROGRAM_NAMES, st.none(), programs(1)),
        st.builds(_implicit, NAMES, NAMES, terms(2), terms(2)),
    )


def _implicit(name: str, time: str, start: Term, rate: Term) -> Declaration:
    body = Compose(Assign(name, start), ODESystem((AtomicODE(name, rate),), Truth(True)))
    return Declaration("Real", name, (Parameter(time),), body)


def archives() -> st.SearchStrategy[Archive]:
    variables = st.builds(Declaration, st.just("Real"), NAMES, st.none(), st.none())
    entry = st.builds(
        Entry,
        st.sampled_from(["ArchiveEntry", "Theorem", "Lemma", "Exercise"]),
        st.text(
            st.characters(codec="utf-8", exclude_characters="\r", exclude_categories=["Cc", "Cf", "Cs"]),
            max_size=12,
        ),
        st.lists(st.sampled_from(["kyx.math.abs", "kyx.math.*"]), max_size=2).map(tuple),
        st.lists(_declarations(), max_size=3).map(tuple),
        st.lists(variables, max_size=3).map(tuple),
        formulas(2),
    )
    return st.builds(Archive, st.lists(entry, min_size=1, max_size=2).map(tuple))
