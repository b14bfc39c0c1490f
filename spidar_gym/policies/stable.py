"""Policies from zips of Stable-Baselines3; the only module of this folder that needs a learning framework."""

import json
import pickle
import re
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.errors import MissingDependencyError, shown
from spidar_gym.policies.policy import NAME
from spidar_gym.policies.source import PolicyError

try:
    from stable_baselines3.common.policies import BasePolicy
    from stable_baselines3.common.save_util import load_from_zip_file
    from stable_baselines3.common.vec_env import VecNormalize
except ImportError as error:
    raise MissingDependencyError(
        "torch or Stable-Baselines3, which spidar_gym.plugins is for,", "pip install 'spidar-gym[train]'"
    ) from error

STATISTICS = "vecnormalize.pkl"
"""File beside a zip with the statistics of the `VecNormalize` that its model learned through."""
PARTS = ("policy_class", "policy_kwargs", "use_sde", "observation_space", "action_space")
"""Entries of a zip from which a policy is made."""


class StablePolicy:
    """Policy of a model that Stable-Baselines3 saved, of any algorithm, without exploration noise.

    A zip does not contain the environment's wrappers; only `VecNormalize` is applied.
    """

    kind = "learned"
    """Class of its row."""

    def __init__(self, path: str | Path) -> None:
        """Load a zip. This runs any code in its pickles: load only zips from sources that you trust.

        Args:
            path: The zip that `model.save` wrote. If the model was trained with `VecNormalize`, the file of `env.save`
                must be beside it as `vecnormalize.pkl`, another pickle.

        Raises:
            PolicyError: When the zip is missing or damaged, or the statistics are missing.
        """
        self.path = Path(path)
        self.name = re.sub(r"[^\w-]", "_", self.path.stem)[:NAME]
        """Name of the file, restricted to the characters of a policy's name."""
        self._state: Any = None
        try:
            self._policy, normalised = _read_zip(self.path)
        except (Exception, SystemExit) as error:
            raise _unreadable(self.path, error, "what `model.save` of Stable-Baselines3 wrote") from error
        self.observation_space, self.action_space = self._policy.observation_space, self._policy.action_space
        self._normalise = _read_statistics(self.path.with_name(STATISTICS)) if normalised else None

    def reset(self, seed: int) -> None:
        """Reset the state of a recurrent policy; the policy is deterministic."""
        self._state = None

    def act(self, observation: Any) -> np.ndarray:  # noqa: ANN401 - an array, or a dictionary of them
        """Return the action without noise, in [−1, 1]."""
        seen = observation if self._normalise is None else self._normalise.normalize_obs(observation)
        action, self._state = self._policy.predict(seen, self._state, deterministic=True)
        return action


def _read_zip(path: Path) -> tuple[BasePolicy, bool]:
    """Return a zip's policy, and whether it was trained with `VecNormalize`; independent of the algorithm."""
    with zipfile.ZipFile(path) as archive:
        if damaged := archive.testzip():
            raise zipfile.BadZipFile(f"{damaged} is damaged")
        told = json.loads(archive.read("data"))
    # Other entries are not unpickled: schedules, for example, are code for one version of Python.
    packed = {name: None for name in told if name not in PARTS}
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "Could not deserialize")
        data, weights, _ = load_from_zip_file(path, custom_objects=packed, device="cpu")
    assert data is not None
    kind, arguments, sde, *spaces = (data[name] for name in PARTS)
    policy = kind(*spaces, lambda _: 0.0, **{**arguments, **({"use_sde": True} if sde else {})})
    policy.load_state_dict(weights["policy"])
    return policy, told.get("_last_original_obs") is not None


def _read_statistics(path: Path) -> VecNormalize:
    try:
        with path.open("rb") as file:
            found = pickle.load(file)
        if not isinstance(found, VecNormalize):
            raise TypeError(f"it holds a {type(found).__name__}")
    except (Exception, SystemExit) as error:
        valid = f"the statistics of the VecNormalize that the model learned through, `env.save({STATISTICS!r})`"
        raise _unreadable(path, error, valid) from error
    return found


def _unreadable(path: Path, error: BaseException, valid: str) -> PolicyError:
    return PolicyError(f"policy {path}: cannot be read ({shown(error)}); valid: {valid}")
