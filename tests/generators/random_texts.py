"""Random models as text, with definitions in definitions, and the same models without any."""

import re
from random import Random

from dl2c.options import Options
from dl2c.pipeline import emit
from dl2c.source import Source

OPERATORS = ("+", "-", "*")
ORDERS = ("<", "<=", ">", ">=", "=")


class Writer:
    """Writes terms, formulas and programs that use the functions, predicates and programs defined so far."""

    def __init__(self, rng: Random) -> None:
        self.rng = rng
        self.functions: list[str] = []
        self.predicates: list[str] = []
        self.programs: list[str] = []

    def term(self, names: tuple[str, ...], depth: int = 2) -> str:
        rng = self.rng
        if depth == 0 or rng.random() < 0.3:
            return rng.choice((*names, "A", str(rng.randint(0, 9)), "0.5"))
        if self.functions and rng.random() < 0.4:
            return f"{rng.choice(self.functions)}({self.term(names, depth - 1)})"
        left, right = self.term(names, depth - 1), self.term(names, depth - 1)
        return f"({left} {rng.choice(OPERATORS)} {right})"

    def formula(self, names: tuple[str, ...], depth: int = 1) -> str:
        rng = self.rng
        if self.predicates and rng.random() < 0.4:
            return f"{rng.choice(self.predicates)}({self.term(names, 1)})"
        if depth == 0 or rng.random() < 0.4:
            return f"{self.term(names, 1)} {rng.choice(ORDERS)} {self.term(names, 1)}"
        parts = [self.formula(names, depth - 1) for _ in range(2)]
        return rng.choice((f"!({parts[0]})", f"({parts[0]} & {parts[1]})", f"({parts[0]} | {parts[1]})"))

    def program(self, depth: int = 2) -> str:
        rng, names = self.rng, ("x", "v")
        if self.programs and rng.random() < 0.3:
            return f"{rng.choice(self.programs)};"
        if depth == 0 or rng.random() < 0.3:
            assign = f"{rng.choice(names)} := {self.term(names)};"
            return rng.choice((assign, f"?{self.formula(names)};", "v := *; ?0 <= v & v <= A;"))
        first, second = self.program(depth - 1), self.program(depth - 1)
        branch = f"if ({self.formula(names)}) {{ {first} }} else {{ {second} }}"
        return rng.choice((f"{first} {second}", f"{{ {first} ++ {second} }}", branch))


def random_text(seed: int) -> str:
    """A model without annotations but the bounds that it needs."""
    writer = Writer(Random(seed))
    lines = ["/* @const: bound=[1:2] */", "Real A;"]
    for k in range(writer.rng.randint(1, 5)):
        match writer.rng.randrange(3):
            case 0:
                lines.append(f"Real f{k}(Real y) = {writer.term(('y',))};")
                writer.functions.append(f"f{k}")
            case 1:
                lines.append(f"Bool p{k}(Real y) <-> {writer.formula(('y',))};")
                writer.predicates.append(f"p{k}")
            case _:
                lines.append(f"HP a{k} ::= {{ {writer.program(1)} }};")
                writer.programs.append(f"a{k}")
    body, after = writer.program(), writer.formula(("x", "v"))
    flow = "t := 0; {x' = v, t' = 1 & t <= 1}"
    start = f"0 <= x & x <= 1 & 0 <= v & v <= 1 & t = 0 & {writer.formula(('x', 'v'))}"
    return model("\n".join(f"  {line}" for line in lines), f"{start} -> [{{ {body} {flow} }}*]({after})")


def model(definitions: str, problem: str) -> str:
    return (
        f'Theorem "random"\nDefinitions\n{definitions}\nEnd.\nProgramVariables\n  Real x, v; Real t;\nEnd.\n'
        f"Problem\n  {problem}\nEnd.\nEnd.\n"
    )


def without_definitions(text: str) -> str:
    """The same model, its problem expanded."""
    problem = emit(Source("random.kyx", text), "expanded", Options())
    kept = re.match(r".*?Definitions\n(.*?Real A;\n)", text, re.DOTALL)
    assert kept is not None
    return model(kept.group(1).rstrip("\n"), problem.strip())
