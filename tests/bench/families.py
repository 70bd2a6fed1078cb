"""Families of models that grow in one respect: variables, alternatives of a choice, degree of conditions.

Each function gives the text of one member; what differs between the members of a family follows from the
size alone.
"""

GEAR_BOX = 16
"""Alternatives that stand together in braces."""


def variables(size: int) -> str:
    """`size` / 2 cars in a row, each with a position and a velocity. The controller accelerates all of them
    while the first has room in front, lets them roll, or brakes; no car may reach the one before it.
    """
    cars = range(1, size // 2 + 1)
    assert size == 2 * len(cars) >= 2
    end = 20 * len(cars) + 500
    apart = [f"x{k} + 1 <= x{k + 1}" for k in cars[:-1]] + [f"x{cars[-1]} <= {end}"]
    initial = [f"{20 * k} <= x{k} & x{k} <= {20 * k + 10} & v{k} = 2" for k in cars]
    motion = ", ".join(f"x{k}' = v{k}, v{k}' = a" for k in cars)
    moving = " & ".join(f"v{k} >= 0" for k in cars)
    declared = "".join(_declared(f"x{k}", f"0:{end}", "m") + _declared(f"v{k}", "0:9", "m/s") for k in cars)
    room = f"x{cars[-1]} + 50 <= {end}"
    control = f"{{ ?{room} & v1 <= 8; a := 1; ++ ?{room}; a := 0; ++ a := -1; }}"
    return _model("", declared, initial, control, f"{motion}, t' = 1 & t <= 0.5 & {moving}", apart)


def paths(size: int) -> str:
    """A car with `size` alternatives: gears that accelerate it up to a velocity of their own, while it could
    still stop before an obstacle, and at last the brake.
    """
    gears = [
        f"{{ ?v <= {30 * k} / {size} & x + v^2 / 4 + (a{k} / 2 + 1) * (a{k} / 2 + v) <= 1000; a := a{k}; }}"
        for k in range(1, size)
    ]
    boxes = [gears[k : k + GEAR_BOX] for k in range(0, size - 1, GEAR_BOX)]
    control = " ++\n".join(f"      {{ {' ++ '.join(box)} }}" for box in boxes)
    given = "".join(f"  Real a{k} = {5 * size - 4 * k} / {size};\n" for k in range(1, size))
    declared = _declared("x", "0:1000", "m") + _declared("v", "0:30", "m/s")
    initial = ["0 <= x & 0 <= v & v <= 20 & x + v^2 / 4 <= 500"]
    motion = "x' = v, v' = a, t' = 1 & t <= 1 & v >= 0"
    return _model(given, declared, initial, f"{{\n{control} ++ a := -2;\n    }}", motion, ["x <= 1000"])


def degree(size: int) -> str:
    """A robot beside a wall whose edge is a polynomial of degree `size`: it drives along or towards the wall
    where the point ahead is inside, or away from it.
    """
    edge = " + ".join(f"x^{k} / {10**k}" for k in range(1, size + 1))
    declared = _declared("x", "0:10", "m") + _declared("y", "0:10", "m")
    control = (
        "{ ?x <= 9.5 & y <= edge(x + 0.5); v := 1; w := 0; ++ ?y + 0.5 <= edge(x); v := 0; w := 1;\n"
        "      ++ ?x >= 0.5 & y <= edge(x - 0.5); v := -1; w := 0; ++ ?y >= 0.5; v := 0; w := -1; }"
    )
    motion = "x' = v, y' = w, t' = 1 & t <= 0.5"
    initial = ["0 <= x & x <= 10 & 0 <= y & y <= edge(x)"]
    given = f"  Real edge(Real x) = 1 + {edge};\n"
    return _model(given, declared, initial, control, motion, ["y <= edge(x)"], "  Real w;\n  Real v;\n")


def _model(
    given: str,
    declared: str,
    initial: list[str],
    control: str,
    motion: str,
    safe: list[str],
    set_by_control: str = "  Real a;\n",
) -> str:
    return (
        f'Theorem "Growth"\n\nDefinitions\n{given}End.\n\n'
        f"ProgramVariables\n{declared}{set_by_control}  Real t;\nEnd.\n\n"
        f"/* @episode: max_steps=100 */\nProblem\n  {' & '.join(initial)}\n  -> [{{\n    {control}\n"
        f"    t := 0; {{ {motion} }}\n  }}*] ({' & '.join(safe)})\nEnd.\n\nEnd.\n"
    )


def _declared(name: str, bound: str, unit: str) -> str:
    return f'  /* @var: bound=[{bound}], unit="{unit}" */\n  Real {name};\n'
