"""`dl2c train --provable`: policies that are proved, with their certificates, and what is said where not."""

import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from policy_proof.test_drawn_and_fixed import led
from policy_proof.test_verify_policy import SWITCH, TANK
from selection import quick_among
from training.test_trainings import dl2c, numbers

pytest.importorskip("stable_baselines3")

from dl2c.commands import policy as policies
from dl2c.commands.policy import Asked, checked_certificate, report_on
from dl2c.policy.files import read_policy
from dl2c.training import provable
from dl2c.training.evaluation import outcomes
from dl2c.training.provable import CERTIFICATE, PROOF, UNPROVED
from dl2c.training.saved import load_policy

pytestmark = pytest.mark.usefixtures("unoptimised")

EXAMPLES = Path(__file__).parents[2] / "examples"
FEW = ("--steps", "2048", "--n-envs", "16", "--hyper", "n_steps=32", "--hyper", "batch_size=128")


def files(tmp_path: Path) -> tuple[str, Path]:
    (tmp_path / "tank.kyx").write_text(TANK)
    return str(tmp_path / "tank.kyx"), tmp_path / "run"


def make_small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few states and short fits, enough for a model with one name."""
    small = {"DRAWN": 500, "GUARDED": 500, "SEEN": 500, "STEPS": 20, "TESTED": 2000}
    for name, value in (small | {"FIRST_FIT": 300, "MORE_FIT": 100}).items():
        monkeypatch.setattr(provable, name, value)


@pytest.mark.slow  # a policy of full size; the next tests prove small ones
def test_a_policy_is_taught_and_proved(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    """Everything that is written is about the policy that is proved, whose verification says the same."""
    folder, model = tmp_path / "run", str(EXAMPLES / "watertank.kyx")
    given = ("train", model, "--provable", *FEW, "--set", "U=0.45", "-o", str(folder), "--json")
    code, out, err = dl2c(capsys, monkeypatch, *given)
    assert code == 0, err
    proof = json.loads((folder / PROOF).read_text())
    assert proof == json.loads(out)["proof"] and proof["answer"] == "proved" and proof["rounds"] > 0
    assert proof["claims"] == {"admissible": "proved", "kept": "proved", "for ever": "proved"}
    report = report_on(model, Asked(folder), {})
    assert (report.answer, report.to_json()["boxes"]) == ("proved", proof["boxes"])
    assert checked_certificate(model, Asked(folder), {}, folder / CERTIFICATE).leaves > 0
    data, unproved = read_policy(folder / "policy.json"), read_policy(folder / UNPROVED / "policy.json")
    options = {"constants": {"U": 0.45}}
    assert report_on(model, Asked(folder / "policy.zip"), options).answer == "proved"
    assert report_on(model, Asked(folder / UNPROVED), {}).answer == "refuted"
    assert "warning: loading policy.zip" in capsys.readouterr().err
    for one, two in zip(data.network.layers, unproved.network.layers, strict=True):
        assert one.weight.shape == two.weight.shape and (one.weight != two.weight).any()
    ignored = [name for name, _, _ in data.interface.observations].index("u")
    assert not data.network.layers[0].weight[:, ignored].any()


def test_the_zip_file_is_the_policy_that_is_proved(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    """Also with exploration that depends on the state."""
    make_small(monkeypatch)
    model, folder = files(tmp_path)
    given = ("train", model, "--provable", *FEW, "--hyper", "use_sde=true", "-o", str(folder))
    code, _, err = dl2c(capsys, monkeypatch, *given)
    assert code == 0, err
    from dl2c.env.opening import source_of
    from dl2c.env.sb3 import Dl2cVecEnv

    env = Dl2cVecEnv(source_of(model), 1)
    zipped = load_policy(folder / "policy.zip", None, env.manifest)
    env.close()
    for one, two in zip(
        zipped.network.layers, read_policy(folder / "policy.json").network.layers, strict=True
    ):
        assert (one.weight == two.weight).all() and (one.bias == two.bias).all()


@pytest.mark.slow
def test_a_seed_gives_one_proved_policy(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    make_small(monkeypatch)
    model, _ = files(tmp_path)
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        given = ("train", model, "--provable", *FEW, "--seed", str(seed), "-o", str(tmp_path / name))
        assert dl2c(capsys, monkeypatch, *given)[0] == 0
    assert numbers(tmp_path / "a") == numbers(tmp_path / "b") != numbers(tmp_path / "c")
    same = [(tmp_path / name / CERTIFICATE).read_text() for name in ("a", "b")]
    assert same[0] == same[1]


def test_choices_are_taught(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    make_small(monkeypatch)
    (tmp_path / "switch.kyx").write_text(SWITCH)
    given = ("train", str(tmp_path / "switch.kyx"), "--provable", *FEW, "-o", str(tmp_path / "run"))
    code, out, err = dl2c(capsys, monkeypatch, *given)
    assert code == 0 and "admissible  proved" in out, err


def test_where_rounds_run_out_the_report_says_what_is_wrong(
    tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    monkeypatch.setattr(provable, "ROUNDS", 0)
    model, folder = files(tmp_path)
    given = ("train", model, "--provable", *FEW, "-o", str(folder))
    code, out, _ = dl2c(capsys, monkeypatch, *given)
    assert code == 3 and "admissible  refuted" in out and "which no control path admits" in out
    assert json.loads((folder / PROOF).read_text())["answer"] == "refuted"
    (folder / CERTIFICATE).write_text("of an earlier policy")
    code, out, _ = dl2c(capsys, monkeypatch, *given, "--json")
    assert (code, json.loads(out)["proof"]["rounds"]) == (3, 0)
    assert not (folder / CERTIFICATE).exists()


REFUSED = {
    ("--algo", "sac"): "--provable is for ppo without --normalize",
    ("--algo", "maskable-ppo"): "--provable is for ppo without --normalize",
    ("--normalize",): "--provable is for ppo without --normalize",
    ("--action-map", "squash"): "not shares of what is admissible (action_map=squash)",
    ("--hyper", "activation=elu"): "its network uses elu, not relu or tanh",
    ("--hyper", "net_arch=[300]"): "256",
}


@pytest.mark.parametrize("given", REFUSED, ids=" ".join)
def test_what_cannot_be_proved_is_refused_before_training(
    given: tuple[str, ...], tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    model, folder = files(tmp_path)
    code, _, err = dl2c(capsys, monkeypatch, "train", model, "--provable", *given, "-o", str(folder))
    assert code == 1 and REFUSED[given] in err and not folder.exists()


@pytest.mark.slow  # trains and proves once more; policy_proof/test_drawn_and_fixed.py proves what is observed
def test_what_the_environment_draws_is_observed(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    """A step overwrites it, but before the policy observes: without it no policy is proved."""
    make_small(monkeypatch)
    model = led(tmp_path)
    given = ("train", model, "--provable", *FEW, "-o", str(tmp_path / "run"))
    code, _, err = dl2c(capsys, monkeypatch, *given)
    assert code == 0, err
    data = read_policy(tmp_path / "run" / "policy.json")
    seen = [name for name, _, _ in data.interface.observations]
    used = data.network.layers[0].weight.any(axis=0)
    assert used[seen.index("w")] and not used[seen.index("u")]


@pytest.mark.slow  # trains once more; test_where_rounds_run_out is about an earlier certificate too
def test_another_training_leaves_no_proof_of_an_earlier_one(
    tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    model, folder = files(tmp_path)
    (folder / UNPROVED).mkdir(parents=True)
    for name in (PROOF, CERTIFICATE, f"{UNPROVED}/policy.json"):
        (folder / name).write_text("{}")
    code, _, err = dl2c(capsys, monkeypatch, "train", model, *FEW, "-o", str(folder))
    assert code == 0, err
    assert not any((folder / name).exists() for name in (PROOF, CERTIFICATE, UNPROVED))


@pytest.mark.parametrize("where", quick_among(("fit", "search"), ("fit",)))
def test_ctrl_c_while_it_is_taught_keeps_what_there_is(
    where: str, tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    """The best policy that is proved by then, else the last one that was verified."""
    make_small(monkeypatch)
    fits: list[int] = []
    original, verified, seen = provable._round, policies._verified, provable._seen

    def fit(*given: Any) -> None:
        fits.append(1)
        if where == "fit" and len(fits) == 2:
            raise KeyboardInterrupt
        original(*given)

    def searched(*given: Any) -> Any:
        found = verified(*given)
        cut = [replace(f, interrupted=where == "search" and len(fits) == 2) for f in found.found]
        return replace(found, found=tuple(cut))

    monkeypatch.setattr(provable, "_seen", lambda *given: (seen(*given)[0], -1.0 * len(fits)))
    monkeypatch.setattr(provable, "_round", fit)
    monkeypatch.setattr(policies, "_verified", searched)
    model, folder = files(tmp_path)
    code, out, err = dl2c(
        capsys, monkeypatch, "train", model, "--provable", *FEW, "-o", str(folder), "--json"
    )
    proof = json.loads(out)["proof"]
    assert len(fits) == 2 and proof["rounds"] <= 2
    assert proof["interrupted"]
    assert code == (0 if proof["answer"] == "proved" else 3), err
    report = report_on(model, Asked(folder), {})
    assert (report.answer, report.to_json()["boxes"]) == (proof["answer"], proof["boxes"])


def test_a_model_of_which_nothing_can_be_proved_is_named(
    tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    late = TANK.replace("Real t;\n", "Real t;\n  /* @var: role=env, bound=[0:1] */ Real w;\n")
    model, folder = files(tmp_path)
    Path(model).write_text(late.replace("t := 0;", "w := *; ?0 <= w & w <= 1; t := 0;"))
    code, _, err = dl2c(capsys, monkeypatch, "train", model, "--provable", "-o", str(folder))
    assert code == 1 and "after the policy" in err and f"{model}:" in err and not folder.exists()


def test_without_the_extra_the_message_says_what_to_install(
    tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    for module in ("stable_baselines3", "torch"):
        monkeypatch.setitem(sys.modules, module, None)
    model, folder = files(tmp_path)
    code, _, err = dl2c(capsys, monkeypatch, "train", model, "--provable", "-o", str(folder))
    assert code == 1 and "pip install" in err, err


# All models ----------------------------------------------------------------------------------------

SWINGING = ("--steps", "200000", "--hyper", "use_sde=true", "--hyper", "sde_sample_freq=16")
"""Without exploration that lasts for several steps a network of relu does not learn to swing up."""

MODELS: dict[str, tuple[tuple[str, ...], tuple[str, ...], list[float] | int]] = {
    "watertank": (("U=0.45",), (), [0.0]),
    "pendulum": (("Emax=23",), SWINGING, [0.0]),
    "acc": (("ep=0.2", "b=4", "A=2"), (), [-4.0, 1.0]),
    "static_safety_line": (("ep=0.2", "b=4", "A=2", "gap=2"), (), 0),
}
"""What is fixed, settings, and the action of a policy that always does the least that is safe."""

SEEDS, EPISODES, MOST_LOST, MOST_SECONDS = 5, 100, 0.1, 900.0


def returns(policy: Any, model: str, fixed: tuple[str, ...]) -> float:
    pairs = (text.split("=") for text in fixed)
    constants = {name: float(value) for name, value in pairs}
    return float(outcomes(policy, model, EPISODES, 10**6, False, constants=constants).total.mean())


def always(action: list[float] | int) -> Any:
    """One action in all states, a number where it is a choice."""
    if isinstance(action, int):
        return lambda observations, _: np.full(len(observations), action)
    return lambda observations, _: np.tile(np.float32(action), (len(observations), 1))


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_proved_policies_lose_little(name: str, tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    """At most a tenth of what unproved policies gain over always falling back: the upper end of the 95 %
    interval over seeds. What one policy gains by being taught makes up for no loss of another one.
    """
    fixed, more, action = MODELS[name]
    model = str(EXAMPLES / f"{name}.kyx")
    sets = [flag for text in fixed for flag in ("--set", text)]
    found: list[tuple[float, float, float]] = []
    for seed in range(SEEDS):
        folder, begun = tmp_path / str(seed), time.monotonic()
        given = ("train", model, "--provable", "--seed", str(seed), *sets, *more, "-o", str(folder))
        code, _, err = dl2c(capsys, monkeypatch, *given)
        assert code == 0 and time.monotonic() - begun < MOST_SECONDS, err
        assert report_on(model, Asked(folder), {}).answer == "proved"
        assert checked_certificate(model, Asked(folder), {}, folder / CERTIFICATE).leaves > 0
        low, before, after = (returns(p, model, fixed) for p in (always(action), folder / UNPROVED, folder))
        found.append((low, before, after))
    low, before, after = np.array(found).T
    lost = np.maximum(before - after, 0.0) / np.mean(before - low)
    half = 2.776 * float(np.std(lost, ddof=1)) / np.sqrt(SEEDS)  # Student's t with four degrees of freedom
    with capsys.disabled():
        print(f"{name}: lost {np.mean(lost):.1%} +- {half:.1%} of {np.mean(before - low):.3g}")
    assert np.mean(before) > np.mean(low) and np.mean(lost) + half <= MOST_LOST
