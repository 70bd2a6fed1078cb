"""`dl2c verify --policy --picture`: what is written, when, and what is refused before any search."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands.test_cli import run
from policy_proof.questions import onnx_file
from policy_proof.test_planes import is_progress
from policy_proof.test_resumed_searches import BENT, interrupting
from policy_proof.test_verify_policy import TANK, tank_network
from selection import quick_among

from dl2c.commands.policy import Asked, questions_of
from dl2c.env.opening import compilation_of
from dl2c.policy.network import Interface, Layer, Network
from dl2c.policy_proof import verdict
from dl2c.policy_proof.search import Found, Limits, search
from dl2c.version import install

pytestmark = pytest.mark.usefixtures("unoptimised")

pytest.importorskip("onnx")
pytest.importorskip("matplotlib")

SPIKE = tank_network(((0.5, 4.9, 0.25),))


def verified(capsys: Any, folder: Path, network: Network, *words: str) -> tuple[int, str, str]:
    (folder / "tank.kyx").write_text(TANK)
    file = onnx_file(network, folder / "net.onnx")
    given = ("--policy", str(file), "--takes", "l", "--gives", "u=0:0.6")
    return run(capsys, "verify", str(folder / "tank.kyx"), *given, *words)


BEGIN = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.mark.parametrize("suffix", quick_among(BEGIN, ("png", "svg")))
def test_pictures_are_written(suffix: str, tmp_path: Path, capsys: Any) -> None:
    for network, code in ((tank_network(), 0), (SPIKE, 1)):
        file = tmp_path / "new" / f"{code}.{suffix}"
        assert verified(capsys, tmp_path, network, "--picture", str(file))[0] == code
        assert file.read_bytes().startswith(BEGIN[suffix])
    assert len([*(tmp_path / "new").iterdir()]) == 2


def test_a_search_that_is_not_finished_has_one(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    file = tmp_path / "picture.png"
    with monkeypatch.context() as patched:
        interrupting(patched, 2)
        patched.setattr("dl2c.policy_proof.plane.Judge", Quiet)
        with pytest.raises(KeyboardInterrupt):
            verified(capsys, tmp_path, BENT, "--picture", str(file))
    assert file.read_bytes().startswith(BEGIN["png"])
    file.unlink()
    monkeypatch.setattr("dl2c.policy_proof.search.MOST_LEVELS", 2)
    assert verified(capsys, tmp_path, BENT, "--picture", str(file))[0] == 3
    assert file.read_bytes().startswith(BEGIN["png"])


class Quiet:
    """A judge of points that suspects none."""

    def __init__(self, tables: Any) -> None:
        self.dimensions = tables.dimensions

    def verdicts(self, boxes: np.ndarray, threads: int) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros(len(boxes), np.uint8), np.zeros(len(boxes), np.uint8)

    def middle(self, box: np.ndarray) -> np.ndarray:
        return box.mean(axis=1)


WRONG = {
    ("--over", "l,u"): "--over says what --picture FILE shows",
    ("--picture", "p.png", "--over", "l"): "--over takes two names, X,Y, not 'l'",
    ("--picture", "p.png", "--over", "l,"): "--over takes two names",
    ("--picture", "p.png", "--over", "l,u,t"): "--over takes two names",
    ("--picture", "p.png", "--over", "l,l"): "--over names `l` twice",
    ("--picture", "p.png", "--over", "l,w"): "`w` is not a dimension of the states; these are l",
    ("--picture", "p.png", "--over", "u,l"): "`u` is not a dimension of the states; these are l",
    ("--picture", "p.png", "--fix", "l=1"): "there is no picture: every name that matters has one value",
    ("--picture", "p.jpeg2"): "Not one of the formats of pictures",
    ("--picture", "p"): "Not one of the formats of pictures",
    ("--picture", "p.png", "--check", "certificate.json"): "--picture are for a search, not for --check",
}


@pytest.mark.parametrize("given", WRONG, ids=" ".join)
def test_mistakes_are_named_before_the_search(
    given: tuple[str, ...], tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(verdict, "search", lambda *_: pytest.fail("it searches"))
    code, out, err = verified(capsys, tmp_path, tank_network(), *given)
    assert (code, out) == (1, "") and WRONG[given] in err and len(err.splitlines()) == 1
    assert not [*tmp_path.glob("p*")]


def test_pictures_need_a_policy(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "tank.kyx").write_text(TANK)
    code, _, err = run(capsys, "verify", str(tmp_path / "tank.kyx"), "--picture", "p.png")
    assert code == 1 and "goes with --policy" in err


class Missing:
    """As if matplotlib were not installed."""

    def find_spec(self, name: str, *_: Any) -> None:
        if name == "matplotlib":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def test_the_extra_is_needed_for_pictures_alone(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    for name in [n for n in sys.modules if n.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Missing(), *sys.meta_path])
    assert verified(capsys, tmp_path, tank_network())[0] == 0
    code, _, err = verified(capsys, tmp_path, tank_network(), "--picture", str(tmp_path / "p.png"))
    assert code == 1 and f"this needs matplotlib; install it with `{install('train')}`" in err


def test_the_report_has_the_progress(tmp_path: Path, capsys: Any) -> None:
    code, out, _ = verified(capsys, tmp_path, BENT, "--json")
    data = json.loads(out)
    (records,) = data["progress"]
    assert code == 0 and len(data["questions"]) == 1
    assert records[-1]["decided"] == data["decided"] == 1.0
    assert records[-1]["boxes"] == data["boxes"] and records[-1]["open"] == 0
    for name in ("seconds", "boxes", "decided"):
        values = [r[name] for r in records]
        assert values == sorted(values)


def test_a_resumed_search_goes_on_with_its_progress(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    words = ("--resume", str(tmp_path / "search.json"), "--json")
    with monkeypatch.context() as patched:
        patched.setattr("dl2c.policy_proof.search.MOST_LEVELS", 3)
        first = json.loads(verified(capsys, tmp_path, BENT, *words)[1])["progress"][0]
    again = json.loads(verified(capsys, tmp_path, BENT, *words)[1])["progress"][0]
    assert len(first) == 3 < len(again) and again[:3] == first
    kept = json.loads((tmp_path / "search.json").read_text())["proofs"][0]
    assert [round(s, 3) for s in kept["seconds"]] == [r["seconds"] for r in again]
    for wrong in ([], [*kept["seconds"][:-1], -1.0], ["a"] * len(kept["seconds"]), None):
        data = json.loads((tmp_path / "search.json").read_text())
        data["proofs"][0]["seconds"] = wrong
        (tmp_path / "wrong.json").write_text(json.dumps(data))
        code, _, err = verified(capsys, tmp_path, BENT, "--resume", str(tmp_path / "wrong.json"))
        assert code == 1 and "no unfinished search" in err


# What is drawn -------------------------------------------------------------------------------------


def zeros(interface: Interface) -> Network:
    """A network that always gives zeros."""
    size = interface.outputs, len(interface.observations)
    return Network((), (Layer(np.zeros(size), np.zeros(size[0]), "relu"),))


@pytest.fixture(scope="module")
def train() -> Any:
    """The questions about a train that never asks for anything, one for each alternative of the radio."""
    _, questions = questions_of("example:etcs", Asked(Path()), {}, zeros)
    found = [search(q, Limits(3.0, 2)) for q in questions]
    for one in found:
        is_progress(one)
    return compilation_of("example:etcs", {}).unbounded, questions, found


def texts(figure: Any) -> str:
    """All that can be read on a figure."""
    from matplotlib.text import Text

    return "\n".join(t.get_text() for t in figure.findobj(Text) if t.get_text())


def test_the_title_names_what_the_environment_takes(train: Any) -> None:
    from dl2c.picture.boxes import proof_figure

    model, questions, found = train
    assert found[0].answer == "refuted"
    shown = texts(proof_figure(model, questions, found[:1]))
    for part in ("European Train Control System: refuted", "radio = 0 (?true)", "violation", "vr"):
        assert part in shown, shown
    shown = texts(proof_figure(model, questions, found[:1], ("assign_m", "z")))
    for part in ("radio = 1", "end of the authority\nm / m, as drawn", "position\nz / m", "not searched"):
        assert part in shown, shown


def test_leaves_are_few_collections(train: Any) -> None:
    """However many there are, and the legend says what there is."""
    from matplotlib.collections import PolyCollection

    from dl2c.picture.boxes import proof_figure

    model, questions, _ = train
    z, v = ([s.name for s in questions[0].dimensions].index(n) for n in ("z", "v"))
    tree = [bytes([(z, v)[k % 2]]) * 2**k for k in range(17)] + [bytes([252, 253, 250, 251]) * 2**15]
    figure = proof_figure(model, questions[:1], [Found("unknown", 0, 0, 0.0, 0.0, tree=tuple(tree))])
    drawn = [c for c in figure.axes[0].collections if isinstance(c, PolyCollection)]
    assert sum(len(c.get_paths()) for c in drawn[:4]) == 2**17 and len(drawn) <= 5
    shown = texts(figure)
    for part in ("proved by bounds", "proved by Z3", "no state is assumed", "open (not decided)"):
        assert part in shown
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == (
        "position\nz / m",
        "velocity\nv / (m/s)",
    )
