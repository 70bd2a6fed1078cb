"""Random step models, states and actions: what interpreter and compiled code must agree on.

Models use every kind of IR node. Numbers come from a coarse grid, so that values meet
bounds, ties and zeros often.
"""

from dataclasses import dataclass, field, replace
from fractions import Fraction
from random import Random

from generators.random_slack import relaxations

from dl2c.ir.logic import conjunction, disjunction, negation
from dl2c.ir.model import (
    FALSE,
    ONE,
    TRUE,
    Add,
    Alternative,
    Assign,
    AssignAny,
    Block,
    Bound,
    Call,
    Choice,
    Compare,
    Comparison,
    Constant,
    Div,
    Evolve,
    Flow,
    Formula,
    Horizon,
    If,
    Model,
    Mul,
    Neg,
    Number,
    Pow,
    Predicate,
    Repeat,
    Role,
    Statement,
    Sub,
    Symbol,
    Term,
    Test,
    Trigger,
    Variable,
    While,
)
from dl2c.lower.leading import leading

VARIABLES = ("x", "y", "z", "u")
CLOCK = "t"
CONSTANTS = ("c", "d")
COMPARISONS: tuple[Comparison, ...] = ("=", "!=", "<", "<=", ">", ">=")
ORDERS: tuple[Comparison, ...] = ("<", "<=", ">", ">=")
TOLERANCE = Fraction(1, 10**9)


def variable(name: str) -> Symbol:
    return Symbol(name, "variable")


def grid(rng: Random, span: int = 4) -> Fraction:
    """A number of the grid, sometimes one that no double holds."""
    value = Fraction(rng.randint(-2 * span, 2 * span), 2)
    return value + Fraction(1, 10) if rng.random() < 0.15 else value


@dataclass
class Builder:
    """One random model in the making. `forms` adds loops and what the agent does not decide."""

    rng: Random
    forms: bool = False
    role: Role = "agent"
    loops: int = 0
    flows: list[Flow] = field(default_factory=list)
    choices: int = 0
    assigned: dict[str, int] = field(default_factory=dict)
    inputs: list[str] = field(default_factory=list)

    def atom(self) -> Term:
        r = self.rng.random()
        if r < 0.3:
            return Number(grid(self.rng))
        if r < 0.45:
            return Symbol(self.rng.choice(CONSTANTS), "constant")
        return variable(self.rng.choice(VARIABLES))

    def term(self, depth: int = 2) -> Term:
        if depth == 0 or self.rng.random() < 0.25:
            return self.atom()
        left, right = self.term(depth - 1), self.term(depth - 1)
        kind = self.rng.randrange(12)
        match kind:
            case 0 | 1:
                return Add(left, right)
            case 2 | 3:
                return Sub(left, right)
            case 4 | 5:
                return Mul(left, right)
            case 6:
                return Div(left, right)
            case 7:
                return Neg(left)
            case 8:
                return Pow(left, self.rng.randint(1, 5))
            case 9:
                return Call(self.rng.choice(("min", "max")), (left, right))
            case 10:
                return Call(self.rng.choice(("abs", "sqrt")), (left,))
            case _:
                name = self.rng.choice(("exp", "sin", "cos", "tan", "arcsin", "arctan", "tanh", "pow"))
                return Call(name, (left, right) if name == "pow" else (left,))

    def compare(self, depth: int = 1, ops: tuple[Comparison, ...] = COMPARISONS) -> Compare:
        return Compare(self.rng.choice(ops), self.term(depth), self.term(self.rng.randint(0, depth)))

    def formula(self, depth: int = 2) -> Formula:
        r = self.rng.random()
        if depth == 0 or r < 0.55:
            return self.compare(ops=ORDERS if self.rng.random() < 0.8 else COMPARISONS)
        parts = [self.formula(depth - 1) for _ in range(2)]
        return conjunction(parts) if r < 0.8 else disjunction(parts)

    def block(self, depth: int, last: bool) -> Block:
        """Statements; `last` ends every path with a flow."""
        statements: list[Statement] = []
        for _ in range(self.rng.randint(1, 3 if depth else 2)):
            statements += self.statement(depth)
        if last:
            statements.append(self.flow())
            if self.rng.random() < 0.25:
                statements += self.after_flow()
        return tuple(statements)

    def statement(self, depth: int) -> list[Statement]:
        if self.forms and self.rng.random() < 0.45:
            return self.form(depth)
        r = self.rng.random()
        if r < 0.4 or (depth == 0 and r < 0.75):
            return [Assign(self.rng.choice(VARIABLES), self.term())]
        if r < 0.55:
            return [Test(self.formula())] if self.rng.random() < 0.6 else self.input()
        if r < 0.7 or depth == 0:
            condition = self.formula()
            if condition in (TRUE, FALSE):
                return []
            then, orelse = self.block(0, False), self.block(0, False) if self.rng.random() < 0.6 else ()
            return [If(condition, negation(condition), then, orelse)]
        return [self.choice(depth)]

    def key(self, name: str) -> str:
        return f"prefix_{name}" if self.role == "reset" else name

    def form(self, depth: int) -> list[Statement]:
        """A loop, or a decision of the environment; nested in `depth` others at most."""
        kind = self.rng.randrange(5 if self.role == "agent" else 2)
        if kind == 0:
            return [self.while_loop()]
        if kind in (1, 4):
            self.loops += 1
            key = self.key(f"loop_{self.loops - 1}")
            role = "env" if kind == 4 else self.role
            return [Repeat(key, self.inner(), self.rng.randint(1, 2), role)]
        role, self.role = self.role, "env"
        made: list[Statement] = [self.choice(min(depth, 1) or 1)] if kind == 2 else self.input()
        self.role = role
        return made

    def while_loop(self) -> While:
        """Counts a variable down; or not, now and then."""
        name = self.rng.choice(VARIABLES)
        condition = Compare(">", variable(name), Number(grid(self.rng)))
        less = Assign(name, Sub(variable(name), Number(Fraction(self.rng.randint(1, 4), 2))))
        body = (*self.inner(), less) if self.rng.random() < 0.9 else self.inner()
        return While(condition, negation(condition), body)

    def inner(self) -> Block:
        """The body of a loop; sometimes time passes in it."""
        forms, self.forms = self.forms, self.rng.random() < 0.15
        body = self.block(0, False) if self.rng.random() < 0.8 else (self.choice(1),)
        self.forms = forms
        return (*body, self.flow()) if self.rng.random() < 0.2 else body

    def choice(self, depth: int, last: bool = False) -> Choice:
        key = self.key(f"choice_{self.choices}")
        self.choices += 1
        fallback = self.rng.randrange(4)
        alternatives: list[Alternative] = []
        for k in range(self.rng.randint(2, 4)):
            body = self.block(depth - 1, last)
            if self.rng.random() < 0.7:
                body = (Test(self.formula(1)), *body)
            alternatives.append(Alternative(body, fallback == k))
        return Choice(key, tuple(alternatives), self.role)

    def input(self, variable_name: str = "") -> list[Statement]:
        """`v := *` with tests linear in v."""
        name = variable_name or self.rng.choice(VARIABLES)
        count = self.assigned.get(name, 0)
        self.assigned[name] = count + 1
        key = self.key(f"assign_{name}" if count == 0 else f"assign_{name}_{count}")
        if len(self.inputs) >= 3:
            return []
        self.inputs.append(key)
        tests: list[Formula] = []
        for op in (">=", "<=") if self.rng.random() < 0.7 else (">", "<"):
            if self.rng.random() < 0.8:
                scaled: Term = variable(name)
                if self.rng.random() < 0.5:
                    scaled = Mul(scaled, self.rng.choice((Number(Fraction(3)), Symbol("c", "constant"))))
                if self.rng.random() < 0.5:
                    scaled = Add(variable(self.rng.choice([v for v in VARIABLES if v != name])), scaled)
                other = [v for v in VARIABLES if v != name]
                limit = self.rng.choice((Number(grid(self.rng)), variable(self.rng.choice(other))))
                tests.append(Compare(op, scaled, limit))
        return [AssignAny(name, key, self.role), Test(conjunction(tests))]

    def with_inputs(self) -> Block:
        """Alternatives that each take an input and flow, and perhaps a second input before them."""
        first = self.input("u") if self.rng.random() < 0.4 else []
        alternatives = tuple(
            Alternative((Test(self.compare(0, ORDERS)), *self.input("z"), self.flow()), k == 1)
            for k in range(2)
        )
        self.choices += 1
        return (*first, Choice("choice_0", alternatives))

    def after_flow(self) -> list[Statement]:
        if self.rng.random() < 0.5:
            return [Assign(self.rng.choice(VARIABLES), self.term())]
        return [Test(self.compare(ops=ORDERS))]

    def flow(self) -> Evolve:
        """x' = y, y' = z or a constant, with a clock and conditions of degree at most 2 in time."""
        rng = self.rng
        rate_y: Term = rng.choice(
            (variable("z"), Symbol("c", "constant"), Number(grid(rng)), Mul(variable("z"), variable("u")))
        )
        equations: tuple[tuple[str, Term], ...] = (("x", variable("y")), ("y", rate_y))
        if rng.random() < 0.2:
            equations = (("y", Div(Symbol("d", "constant"), variable("z"))), ("x", Number(grid(rng))))
        clocked = rng.random() < 0.8
        bound: Term = rng.choice((Symbol("d", "constant"), Number(Fraction(4)), Number(Fraction(9))))
        watched = [
            self.wide() if rng.random() < 0.85 else self.condition()
            for _ in range(rng.choice((0, 1, 2, 3, 3)))
        ]
        horizon = Compare("<=", variable(CLOCK), bound)
        domain = conjunction([horizon, *watched] if clocked else watched)
        if clocked:
            equations = (*equations, (CLOCK, ONE))
        self.flows.append(
            Flow(
                equations,
                domain,
                conjunction(watched),
                (Horizon(CLOCK, bound),) if clocked else (),
                None if clocked and rng.random() < 0.9 else rng.choice((Fraction(2, 5), Fraction(5))),
            )
        )
        return Evolve(len(self.flows) - 1)

    def wide(self) -> Formula:
        """A condition that most states satisfy and that a motion soon leaves."""
        name, limit = self.rng.choice((("x", Fraction(17, 4)), ("y", Fraction(17, 4)), ("x", Fraction(6))))
        op, sign = self.rng.choice((("<=", 1), ("<", 1), (">=", -1), (">", -1)))
        return Compare(op, variable(name), Number(sign * limit))

    def condition(self) -> Formula:
        rng = self.rng
        left: Term = rng.choice(
            (variable("x"), variable("y"), variable("y"), Add(variable("x"), variable("y")))
        )
        right: Term = rng.choice(
            (Number(Fraction(0)), Number(grid(rng, 6)), Symbol("c", "constant"), variable("u"))
        )
        op = rng.choice(("<=", ">=", ">=", "<", ">", "!=")) if rng.random() < 0.97 else "="
        return Compare(op, left, right) if rng.random() < 0.8 else Compare(op, right, left)

    def predicates(self) -> tuple[Predicate, ...]:
        rng = self.rng
        made: list[Predicate] = []
        for k in range(rng.randint(0, 3)):
            formula = self.formula(1)
            category = rng.choice(("safety", "progress", "stability"))
            triggers = [
                Trigger(
                    rng.choice(("terminate", "truncate", "continue")),
                    rng.choice(("success", "failure", "none")),
                )
                if rng.random() < 0.5
                else None
                for _ in range(2)
            ]
            due = self.formula(1) if category == "progress" and rng.random() < 0.6 else None
            values = [self.term() if rng.random() < 0.5 else None for _ in range(3)]
            made.append(
                Predicate(
                    f"p{k}q",
                    category,
                    formula,
                    reward=values[0],
                    penalty=values[1],
                    shape=values[2],
                    on_success=triggers[0],
                    on_failure=triggers[1],
                    due=due,
                    **relaxations(f"p{k}q", formula, TOLERANCE),
                )
            )
        return tuple(made)


def random_model(seed: int) -> Model:
    """Model number `seed`."""
    rng = Random(seed)
    builder = Builder(rng)
    shape = rng.random()
    if shape < 0.5:
        body: Block = (builder.choice(1), *builder.block(0, True))
    elif shape < 0.7:
        body = (builder.choice(1, last=True),)
    elif shape < 0.8:
        body = builder.block(2, True)
    elif shape < 0.85:
        body = (builder.choice(2), builder.choice(1), builder.flow())
    elif shape < 0.95:
        body = builder.with_inputs()
    else:
        body = builder.block(1, False)
    if rng.random() < 0.85:
        body = (Assign(CLOCK, Number(Fraction(0))), *body)
    return finished(builder, f"random{seed}", body)


def random_program(seed: int) -> Model:
    """Model number `seed` of those with loops inside a step, programs before the loop and decisions
    of the environment."""
    rng = Random(seed)
    builder = Builder(rng, forms=True)
    body: list[Statement] = [builder.choice(1)] if rng.random() < 0.35 else []
    for _ in range(rng.randint(1, 2)):
        body += builder.form(0) if rng.random() < 0.7 else builder.statement(0)
    if rng.random() < 0.8:
        body.append(builder.flow())
        body += builder.after_flow() if rng.random() < 0.3 else []
    prefix: Block = ()
    if rng.random() < 0.4:
        builder.role, builder.inputs = "reset", []
        prefix = (*builder.block(0, False), *((builder.flow(),) if rng.random() < 0.5 else ()))
    lead, rest = leading((Assign(CLOCK, Number(Fraction(0))), *body))
    model = finished(builder, f"program{seed}", rest)
    return replace(model, lead=lead, prefix=prefix, max_loop=rng.choice((2, 5, 12)))


def finished(builder: Builder, name: str, body: Block) -> Model:
    """The model around a body."""
    rng = builder.rng
    bound = Bound(Fraction(-5), Fraction(5))
    return Model(
        name=name,
        source=f"{name}.kyx",
        variables=tuple(Variable(v, bound, observed=True) for v in (*VARIABLES, CLOCK)),
        constants=tuple(Constant(c, Bound(Fraction(1, 2), Fraction(2))) for c in CONSTANTS),
        precondition=TRUE,
        prefix=(),
        body=body,
        loops=rng.random() < 0.9,
        flows=tuple(builder.flows),
        predicates=builder.predicates(),
        postcondition=builder.formula() if rng.random() < 0.7 else None,
        tolerance=TOLERANCE,
    )


def random_state(rng: Random) -> tuple[dict[str, float], dict[str, float]]:
    """Values of variables and constants; now and then extreme ones."""

    def value() -> float:
        r = rng.random()
        if r < 0.7:
            return float(grid(rng))
        return rng.uniform(-4, 4) if r < 0.97 else rng.choice((1e90, -1e90, 1e-300, 5e-324, -0.0))

    state = {v: value() for v in VARIABLES} | {CLOCK: rng.choice((0.0, 0.0, 0.25, 0.5, 1.0))}
    return state, {c: rng.choice((0.5, 1.0, 2.0, rng.uniform(0.5, 2.0))) for c in CONSTANTS}
