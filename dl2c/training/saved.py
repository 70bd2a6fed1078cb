"""Policies of Stable-Baselines3 as data: PPO and MaskablePPO with a multilayer perceptron.

Torch and Stable-Baselines3 are imported when called. Loading a zip file or the statistics of VecNormalize
executes code that they contain.
"""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from dl2c.env.interface import interface_of
from dl2c.native.manifest import Manifest
from dl2c.policy.files import JSON, read_policy
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

STATISTICS = ("vecnormalize.pkl", "vec_normalize.pkl")
"""What VecNormalize's statistics are called beside a zip file."""

MODULES = {
    "stable_baselines3.common.policies": False,
    "sb3_contrib.common.maskable.policies": True,
}
"""Where the policies that are understood come from, and whether they are masked."""

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
    return path, next((p for p in (path.with_name(n) for n in STATISTICS) if p.exists()), None)


def load_policy(path: Path, statistics: Path | None, manifest: Manifest) -> NetworkPolicy:
    """A policy from its file. That of a zip file is taken to be one of the environments of `manifest`.

    Raises `PolicyError`, `OSError`.
    """
    if path.suffix == ".json":
        return read_policy(path)
    masked = _masked(path)
    model: Any = _loaded(path, masked)
    scalings = [] if statistics is None else [_normalisation(statistics, len(manifest.observations))]
    return policy_data(
        model, interface_of(manifest), manifest, [s for s in scalings if s is not None], masked
    )


def policy_data(
    model: Any, interface: Interface, manifest: Manifest, scalings: list[Scaling], masked: bool
) -> NetworkPolicy:
    """What a model of Stable-Baselines3 does, as data. Raises `PolicyError`."""
    _fits(model, interface)
    own, layers, bounded = _network(model.policy)
    network = Network((*scalings, *own), layers, bounded)
    return checked(NetworkPolicy(manifest.name, interface, network, masked, manifest.options))


def _masked(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            data = json.loads(archive.read("data"))
        module = str(data["policy_class"]["__module__"])
    except (KeyError, TypeError, ValueError, zipfile.BadZipFile):
        raise PolicyError(f"{path} is not a policy that Stable-Baselines3 saved") from None
    if module not in MODULES:
        raise PolicyError(f"{path} is of {module}; only PPO and MaskablePPO are understood")
    return MODULES[module]


def _loaded(path: Path, masked: bool) -> Any:
    if masked:
        from sb3_contrib import MaskablePPO as Algorithm
    else:
        from stable_baselines3 import PPO as Algorithm
    algorithm: Any = Algorithm
    try:
        return algorithm.load(path, device="cpu")
    except Exception as problem:  # whatever the pickles inside raise
        raise PolicyError(f"{path} cannot be loaded: {type(problem).__name__}: {problem}") from None


def _normalisation(path: Path, size: int) -> Scaling | None:
    """The statistics of VecNormalize; None where it leaves observations as they are."""
    from stable_baselines3.common.save_util import load_from_pkl

    try:
        load: Any = load_from_pkl
        saved: Any = load(path)
        if not saved.norm_obs:
            return None
        mean, variance = (np.asarray(a, np.float64) for a in (saved.obs_rms.mean, saved.obs_rms.var))
        scale = np.sqrt(variance + saved.epsilon)
        clip = float(saved.clip_obs)
    except OSError:
        raise
    except Exception as problem:
        raise PolicyError(f"{path} holds no statistics of VecNormalize: {problem}") from None
    if mean.shape != (size,):
        raise PolicyError(f"{path} normalises {mean.shape} numbers; the model shows {size} observations")
    return Scaling(mean, scale, clip)


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

    shared = getattr(policy, "share_features_extractor", True)
    extractor = policy.features_extractor if shared else policy.pi_features_extractor
    scalings = _extracted(extractor)
    body = getattr(getattr(policy, "mlp_extractor", None), "policy_net", None)
    if not isinstance(body, nn.Sequential) or not isinstance(policy.action_net, nn.Linear):
        raise PolicyError(f"{type(policy).__name__} is no multilayer perceptron")
    layers: list[Layer] = []
    for module in (*body, policy.action_net):
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

    from dl2c.training.ppo import Standardised

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
