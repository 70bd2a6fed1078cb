"""Policies of Stable-Baselines3 as data: PPO, MaskablePPO and SAC with a multilayer perceptron.

Torch and Stable-Baselines3 are imported when called. Loading a zip file or the statistics of VecNormalize
executes code that they contain.
"""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from dl2c.env.interface import interface_of
from dl2c.inputs import MALFORMED, open_input
from dl2c.native.manifest import Manifest
from dl2c.policy.files import BROKEN, JSON, read_policy
from dl2c.policy.network import (
    Activation,
    Interface,
    Layer,
    Network,
    NetworkPolicy,
    PolicyError,
    Scaling,
    checked,
)
from dl2c.training.hyper import constructor
from dl2c.training.run import Algorithm

STATISTICS = ("vecnormalize.pkl", "vec_normalize.pkl")
"""What VecNormalize's statistics are called beside a zip file."""

MODULES: dict[str, Algorithm] = {
    "stable_baselines3.common.policies": "ppo",
    "sb3_contrib.common.maskable.policies": "maskable-ppo",
    "stable_baselines3.sac.policies": "sac",
}
"""Where the policies that are understood come from."""

ACTIVATION: dict[str, Activation] = {
    "Identity": "identity",
    "Tanh": "tanh",
    "ReLU": "relu",
    "ELU": "elu",
    "Sigmoid": "sigmoid",
}


def found_policy(path: Path) -> tuple[Path, Path | None]:
    """The file of a policy, of a folder that holds one; and the statistics of VecNormalize beside it.

    Raises `PolicyError`, `OSError`.
    """
    if path.is_dir():
        zips = sorted(path.glob("*.zip"))
        named = [p for p in (path / JSON, path / "policy.zip") if p.exists()]
        if not named and len(zips) != 1:
            raise PolicyError(f"{path} holds {'several' if zips else 'no'} policies: {JSON} or a zip file")
        path = (named or zips)[0]
    if not path.exists():
        raise PolicyError(f"there is no policy {path}")
    if path.suffix == ".json":
        return path, None
    return path, statistics_beside(path)


def statistics_beside(path: Path) -> Path | None:
    """The statistics of VecNormalize that stand beside a zip file."""
    return next((p for p in (path.with_name(n) for n in STATISTICS) if p.exists()), None)


def load_policy(path: Path, statistics: Path | None, manifest: Manifest) -> NetworkPolicy:
    """A policy from its file. That of a zip file is taken to be one of the environments of `manifest`.

    Raises `PolicyError`, `OSError`.
    """
    if path.suffix == ".json":
        return read_policy(path)
    algo, model = load_learner(path)
    scalings = [] if statistics is None else [scaling_saved(statistics, len(manifest.observations))]
    return policy_data(
        model,
        interface_of(manifest),
        manifest,
        [s for s in scalings if s is not None],
        algo == "maskable-ppo",
    )


def policy_data(
    model: Any, interface: Interface, manifest: Manifest, scalings: list[Scaling], masked: bool
) -> NetworkPolicy:
    """What a model of Stable-Baselines3 does, as data. Raises `PolicyError`."""
    _fits(model, interface)
    own, layers, bounded = _network(model.policy)
    network = Network((*scalings, *own), layers, bounded)
    return checked(NetworkPolicy(manifest.name, interface, network, masked, manifest.options))


def load_learner(path: Path) -> tuple[Algorithm, Any]:
    """What Stable-Baselines3 saved to a zip file. Raises `PolicyError`, `OSError`."""
    try:
        with open_input(path) as file, zipfile.ZipFile(file) as archive:
            data = json.loads(archive.read("data"))
        module = str(data["policy_class"]["__module__"])
    except (*MALFORMED, *BROKEN):
        raise PolicyError(f"{path} is not a policy that Stable-Baselines3 saved") from None
    if module not in MODULES:
        raise PolicyError(f"{path} is of {module}; only PPO, MaskablePPO and SAC are understood")
    algo = MODULES[module]
    try:
        return algo, constructor(algo).load(path, device="cpu")
    except Exception as problem:  # whatever the pickles inside raise
        raise PolicyError(f"{path} cannot be loaded: {type(problem).__name__}: {problem}") from None


def scaling_of(normaliser: Any) -> Scaling | None:
    """What VecNormalize does to observations; None where it leaves them as they are."""
    if not normaliser.norm_obs:
        return None
    mean, variance = (np.asarray(a, np.float64) for a in (normaliser.obs_rms.mean, normaliser.obs_rms.var))
    return Scaling(mean, np.sqrt(variance + normaliser.epsilon), float(normaliser.clip_obs))


def scaling_saved(path: Path, size: int) -> Scaling | None:
    """That of saved statistics, for so many observations. Raises `PolicyError`, `OSError`."""
    from stable_baselines3.common.save_util import load_from_pkl

    try:
        load: Any = load_from_pkl
        scaling = scaling_of(load(path))
    except OSError:
        raise
    except Exception as problem:
        raise PolicyError(f"{path} holds no statistics of VecNormalize: {problem}") from None
    if scaling is not None and scaling.center.shape != (size,):
        shape = scaling.center.shape
        raise PolicyError(f"{path} normalises {shape} numbers; the model shows {size} observations")
    return scaling


def _fits(model: Any, interface: Interface) -> None:
    """Raises `PolicyError` unless the spaces of a model are those of the environment."""
    size = len(interface.observations)
    if model.observation_space.shape != (size,):
        shape = model.observation_space.shape
        raise PolicyError(f"the policy observes numbers of shape {shape}; the model shows {size}")
    space = model.action_space
    match interface.kind:
        case "none" | "choice" | "runs":
            found = (type(space).__name__, getattr(space, "n", None))
            wanted: tuple[Any, ...] = ("Discrete", interface.outputs)
        case "choices":
            counts = getattr(space, "nvec", np.zeros(0))
            found, wanted = (type(space).__name__, *counts.tolist()), ("MultiDiscrete", *interface.counts)
        case "box":
            ends = [getattr(space, e, np.zeros(0)).tolist() for e in ("low", "high")]
            found = (type(space).__name__, *ends)
            wanted = ("Box", list(interface.low), list(interface.high))
    if found != wanted:
        advice = (
            "; another action_format or action_map?" if found[0] != wanted[0] or found[0] == "Box" else ""
        )
        raise PolicyError(f"the policy acts in {_shown(found)}; the model takes {_shown(wanted)}{advice}")


def _shown(space: tuple[Any, ...]) -> str:
    return f"{space[0]}({', '.join(map(str, space[1:]))})"


def _network(policy: Any) -> tuple[list[Scaling], tuple[Layer, ...], bool]:
    """Scalings and layers of a policy, and whether its actions are squashed."""
    from torch import nn

    actor = getattr(policy, "actor", None)
    if actor is not None:
        extractor, body, last = actor.features_extractor, actor.latent_pi, actor.mu
    else:
        shared = getattr(policy, "share_features_extractor", True)
        extractor = policy.features_extractor if shared else policy.pi_features_extractor
        body, last = getattr(getattr(policy, "mlp_extractor", None), "policy_net", None), policy.action_net
    scalings = _extracted(extractor)
    if not isinstance(body, nn.Sequential) or not isinstance(last, nn.Linear):
        raise PolicyError(f"{type(policy).__name__} is not a multilayer perceptron")
    layers: list[Layer] = []
    for module in (*body, last):
        name = type(module).__name__
        if isinstance(module, nn.Linear):
            layers.append(Layer(_numbers(module.weight), _numbers(module.bias), "identity"))
        elif name not in ACTIVATION or (name == "ELU" and module.alpha != 1) or not layers:
            raise PolicyError(f"no layer {name} can be exported; there is Linear, {', '.join(ACTIVATION)}")
        else:
            layers[-1] = Layer(layers[-1].weight, layers[-1].bias, ACTIVATION[name])
    return scalings, tuple(layers), bool(policy.squash_output)


def _extracted(extractor: Any) -> list[Scaling]:
    from stable_baselines3.common.torch_layers import FlattenExtractor

    from dl2c.training.standardised import Standardised

    match extractor:
        case Standardised():
            center, scale = extractor.moments
            return [Scaling(_numbers(center), _numbers(scale), np.inf)]
        case FlattenExtractor():
            return []
        case _:
            name = type(extractor).__name__
            raise PolicyError(f"features are extracted by {name}; only flat observations can be exported")


def _numbers(tensor: Any) -> Any:
    return tensor.detach().cpu().numpy().astype(np.float64)
