"""The conditions of a model as a page shows them, and the places of what a path executes."""

from dl2c.emit.simulator.conditions import conditions_of
from dl2c.env.opening import compilation_of


def test_every_condition_is_made_of_listed_comparisons() -> None:
    build = compilation_of("example:watertank", {}).planned.build
    found = conditions_of(build)
    data = found.as_data()
    kinds = [(c["kind"], c["name"]) for c in data["conditions"]]
    assert kinds == [
        ("assumption", ""),
        ("safety", "inTank"),
        ("progress", "near"),
        ("domain", "0"),
        ("guard", "0"),
        ("admission", "0 0"),
    ]
    texts = [atom["text"] for atom in data["atoms"]]
    trees = {kind: c["tree"] for (kind, _), c in zip(kinds, data["conditions"], strict=True)}
    assert [texts[k] for k in trees["safety"][1:]] == ["0 <= l", "l <= m"] and trees["safety"][0] == "and"
    assert texts[trees["domain"]] == "0 <= l"
    assert [texts[k] for k in trees["admission"][1:]] == [
        *("0 <= u", "u <= U", "0 <= l + (u - q) * ep", "l + (u - q) * ep <= m"),
    ]


def test_comparisons_of_two_places_are_two() -> None:
    """That they read alike does not make them one: a page underlines the place."""
    build = compilation_of("example:watertank", {}).planned.build
    atoms = conditions_of(build).atoms
    places = [(a.span.start, a.span.end) for a in atoms if a.span.text == "0 <= l"]
    assert len(places) == len(set(places)) == 2


def test_a_path_knows_what_it_executes() -> None:
    accelerate, brake, *_ = compilation_of("example:acc", {}).paths.paths
    texts = [s.text for s in accelerate.statements]
    assert texts[1] == "{ al := -b / 2; }" and texts[3:6] == ["a := *", "?(-b <= a & a <= A)", "t := 0"]
    assert [s.text for s in brake.statements][2:4] == ["a := -b", "t := 0"]
