"""Adapters to learning frameworks: a vector and policies for Stable-Baselines3, torch tensors over robots' memory."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.envs.vector_options import copied
from spidar_gym.errors import InvalidValueError, MissingDependencyError
from spidar_gym.policies.stable import StablePolicy as StablePolicy  # re-exported for clients

try:
    import torch
    from stable_baselines3.common.policies import MultiInputActorCriticPolicy
    from stable_baselines3.common.torch_layers import CombinedExtractor
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise MissingDependencyError(
        "torch or Stable-Baselines3, which spidar_gym.plugins is for,", "pip install 'spidar-gym[train]'"
    ) from error

REWARDING = ("compute_reward", "compute_terminated", "compute_truncated")
"""Goal methods, which are the same for all robots."""


class StableVecEnv(VecEnv):
    """Robots of a native vector with the interface of a Stable-Baselines3 vector.

    An `info` is a dictionary that is empty until an episode ends. Then it holds `terminal_observation`,
    `TimeLimit.truncated`, the final values of a single environment's `info`, such as `is_success`, `failure` ("" if
    there is none) and `energy_wh` [Wh], and `time_s`, the duration of the episode [s]. These names can be passed to
    `VecMonitor(…, info_keywords=…)`. The `info` of every step is in the vector: `vector.buffers["infos"]`.
    """

    def __init__(self, vector: NativeVectorEnv) -> None:
        """Wrap a vector and switch it to same-step autoreset.

        Args:
            vector: From `gymnasium.make_vec(…)`, before its first reset.
        """
        if vector.autoreset_mode is not AutoresetMode.SAME_STEP:
            vector.set_autoreset_mode(AutoresetMode.SAME_STEP)
        self.vector = vector
        self._actions = np.zeros(0)
        self._steps = np.zeros(vector.num_envs, int)
        super().__init__(vector.num_envs, vector.single_observation_space, vector.single_action_space)

    def reset(self) -> Any:  # noqa: ANN401 - an array, or a dictionary of them
        """Reset every robot, with the seeds of `seed` and the options of `set_options`, which are used once."""
        robots = range(self.num_envs)
        names = {name for each in self._options for name in each}
        options = {name: [each.get(name) for each in self._options] for name in sorted(names)}
        for name, values in options.items():
            if any(name not in self._options[k] for k in robots):
                raise InvalidValueError("options", name, "an option that all robots have, or none")
            options[name] = values
        observations, _ = self.vector.reset(seed=self._seeds, options=options)
        self._steps[:] = 0
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [{} for _ in robots]
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions of all robots for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Simulate one control period; return observations, rewards in single precision, dones and infos."""
        self.vector.advance(self._actions)
        now = self.vector.buffers
        done = now["terminated"] | now["truncated"]
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self._steps += 1
        last = now["final_observations"]
        for k in np.flatnonzero(done).tolist():
            ended = {name: rows[k] for name, rows in last.items()} if isinstance(last, dict) else last[k]
            infos[k] = {
                "terminal_observation": copied(ended),
                "TimeLimit.truncated": bool(now["truncated"][k] and not now["terminated"][k]),
                "time_s": float(self._steps[k] / self.vector.metadata["render_fps"]),
                **self.vector.ended(k),
            }
        self._steps[done] = 0
        return copied(now["observations"]), now["rewards"].astype(np.float32), done, infos

    def close(self) -> None:
        """Stop the threads; a second call does nothing."""
        self.vector.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Render every robot."""
        return self.vector.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:  # noqa: ANN401 - Stable-Baselines3's signature
        """Return an attribute of the vector, the same for every robot."""
        value = self.num_envs if attr_name == "num_envs" else getattr(self.vector, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ANN401 - as above
        """Raise an error: robots of a vector are alike; options are set when the vector is made or reset."""
        raise InvalidValueError(attr_name, value, "an option of make_vec or of reset: robots of a vector are alike")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:  # noqa: ANN401 - SB3's signature
        """Call a goal method or `render`; other methods raise an error, because a robot has no environment object."""
        chosen = list(self._get_indices(indices))
        if method_name in REWARDING:
            return [getattr(self.vector, method_name)(*args, **kwargs) for _ in chosen]
        if method_name != "render":
            valid = f"render, {', '.join(REWARDING)}; every other method is one of the vector"
            raise InvalidValueError("env_method", method_name, valid)
        return list(self.vector.render(chosen, *args, **kwargs) or [None] * len(chosen))

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: Any = None) -> list[bool]:  # noqa: ANN401 - SB3's signature
        """Return False for every robot: robots have no wrappers."""
        return [False for _ in self._get_indices(indices)]


class ActorsShare(CombinedExtractor):
    """Features of an asymmetric observation for the actor, with the privileged part replaced by zeros."""

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Concatenate both parts of the observation, the privileged part as zeros."""
        return super().forward({**observations, "privileged": torch.zeros_like(observations["privileged"])})


class AsymmetricPolicy(MultiInputActorCriticPolicy):
    """Policy for PPO or A2C with `observation="asymmetric"`: the critic sees both parts, the actor only the first."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - Stable-Baselines3's
        """Take the arguments of Stable-Baselines3's `MultiInputActorCriticPolicy`."""
        super().__init__(*args, share_features_extractor=False, **kwargs)
        self.pi_features_extractor = self.features_extractor = ActorsShare(self.observation_space)  # pyright: ignore[reportArgumentType] - a dictionary


class TorchVector:
    """Robots of a native vector as tensors that share its memory: nothing is copied between simulator and learner.

    Every tick overwrites the tensors; a learner that keeps the values of a tick must clone them.
    """

    def __init__(self, vector: NativeVectorEnv) -> None:
        """Wrap a vector with any autoreset mode."""
        self.vector = vector
        buffers = vector.buffers
        tensors = {name: _tensors(held) for name, held in buffers.items() if name not in ("infos", "final_infos")}
        self.observations: Any = tensors["observations"]
        """Observations, (robots, size) float32; a dictionary of such tensors if the vector's observation is one."""
        self.rewards: torch.Tensor = tensors["rewards"]
        """Rewards, (robots,) float64."""
        self.terminated: torch.Tensor = tensors["terminated"]
        """Whether an episode ended in a failure, (robots,)."""
        self.truncated: torch.Tensor = tensors["truncated"]
        """Whether an episode ended by its time limit, (robots,)."""
        self.begun: torch.Tensor = tensors["begun"]
        """Whether the step began an episode, (robots,)."""
        self.final_observations: Any = tensors["final_observations"]
        """Last observations of episodes that ended in this step, with same-step autoreset; as `observations`."""

    def __reduce__(self) -> tuple[type["TorchVector"], tuple[NativeVectorEnv]]:
        """Pickle the vector; the copy's tensors share the memory of the copied vector."""
        return type(self), (self.vector,)

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None) -> None:
        """Reset the robots; arguments as of `NativeVectorEnv.reset`."""
        self.vector.reset(seed=seed, options=options)

    def step(self, actions: torch.Tensor) -> None:
        """Simulate one control period.

        Args:
            actions: In [−1, 1], (robots, size), on the CPU; values outside are clipped.

        Raises:
            InvalidValueError: For actions of the wrong shape or with a NaN, before any robot is stepped.
        """
        self.vector.advance(actions.detach().numpy())

    def close(self) -> None:
        """Stop the threads; a second call does nothing."""
        self.vector.close()


def _tensors(held: Any) -> Any:  # noqa: ANN401 - an array, or a dictionary of them
    """Return tensors that share the memory of the arrays."""
    if isinstance(held, dict):
        return {name: torch.from_numpy(array) for name, array in held.items()}
    return torch.from_numpy(held)
