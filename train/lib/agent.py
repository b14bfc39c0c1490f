"""PPO or SAC agent with an initial mean action of zero: construction, training segments, and state as plain arrays.

In reading order: the agent, a training segment with the schedule of the actor, and the state. This module imports torch
and Stable-Baselines3. Recipes import it when a run starts, so that `--help` works without them.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from spidar_gym.errors import InvalidValueError
from spidar_gym.policies.torso import Turn
from train.lib.learner import Layers, LearnerConfig
from train.lib.symmetry import tie, tie_layers

Agent = PPO | SAC
"""A learner of Stable-Baselines3."""


class BaseFirstSAC(SAC):
    """SAC that fills its replay buffer with small noise around the zero action instead of uniform random actions."""

    noise = 0.1
    """Standard deviation of the first actions."""

    def _sample_action(self, learning_starts: int, action_noise: Any = None, n_envs: int = 1) -> Any:  # noqa: ANN401 - SB3's signature
        if self.num_timesteps >= learning_starts:
            return super()._sample_action(learning_starts, action_noise, n_envs)
        drawn = torch.randn(n_envs, *(self.action_space.shape or ())).numpy()
        action = np.clip(self.noise * drawn, -1.0, 1.0)
        return action, action


class _Past(nn.Module):
    """Layers whose output is concatenated with their input."""

    def __init__(self, layers: nn.Sequential) -> None:
        super().__init__()
        self.layers = layers

    def forward(self, shown: torch.Tensor) -> torch.Tensor:
        return torch.cat([self.layers(shown), shown], dim=-1)


class PastPolicy(ActorCriticPolicy):
    """Policy whose actor's last layer also receives the observation; its last columns are the skip matrix."""

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        extractor = self.mlp_extractor
        extractor.policy_net = _Past(extractor.policy_net)  # pyright: ignore[reportAttributeAccessIssue] - called alike
        extractor.latent_dim_pi += self.features_dim


def build(
    config: LearnerConfig, envs: VecEnv, seed: int, *, logs: str | None, hidden: np.ndarray, still: np.ndarray,
    turns: tuple[Turn, Turn] | None = None,
) -> Agent:  # fmt: skip
    """Build an agent on the CPU whose mean action is exactly zero.

    Args:
        config: Hyperparameters.
        envs: Environments.
        seed: Seed of the initial weights.
        logs: Folder for TensorBoard; None writes no log.
        hidden: Mask of the observation's entries that only the critic receives.
        still: Mask of the action's entries that stay 0.
        turns: Effects of a 90° rotation on observation and action, for an equivariant agent.
    """
    # A second torch thread would spin between these small products and occupy the core of the engine's second thread.
    torch.set_num_threads(1)
    actor, critic = [config.hidden] * 2, [config.critic_hidden] * 2
    shared: dict[str, Any] = {
        "learning_rate": config.lr, "gamma": config.gamma, "seed": seed, "device": "cpu",
        "tensorboard_log": logs, "batch_size": config.batch_size,
    }  # fmt: skip
    if config.algorithm == "ppo":
        ppo = config.ppo
        activation = nn.ReLU if config.activation == "relu" else nn.Tanh
        kwargs = {"net_arch": {"pi": actor, "vf": critic}, "activation_fn": activation, "log_std_init": config.log_std}
        policy = PastPolicy if config.skip else "MlpPolicy"
        model = PPO(
            policy, envs, n_steps=ppo.n_steps, n_epochs=ppo.epochs, gae_lambda=ppo.gae_lambda,
            clip_range=ppo.clip_range, target_kl=ppo.target_kl or None, ent_coef=ppo.entropy,
            policy_kwargs=kwargs, **shared,
        )  # fmt: skip
    else:
        sac = config.sac
        kwargs = {"net_arch": {"pi": actor, "qf": critic}, "activation_fn": nn.ReLU, "log_std_init": config.log_std}
        model = BaseFirstSAC(
            "MlpPolicy", envs, buffer_size=sac.buffer, learning_starts=sac.warmup,
            gradient_steps=sac.updates, train_freq=1, policy_kwargs=kwargs, **shared,
        )  # fmt: skip
        log_std = model.actor.log_std
        assert isinstance(log_std, nn.Linear)
        with torch.no_grad():
            log_std.weight.zero_()
            log_std.bias.fill_(config.log_std)
    first, last = _actor(model)[0], _actor(model)[-1]
    with torch.no_grad():
        last.weight.zero_()
        last.bias.zero_()
        seen, free = (torch.tensor(~mask, dtype=torch.float32) for mask in (hidden, still))
        first.weight.mul_(seen)
        # A weight that is initially zero and has a zero gradient stays zero.
        first.weight.register_hook(lambda gradient: gradient * seen)
        last.weight.register_hook(lambda gradient: gradient * free[:, None])
        last.bias.register_hook(lambda gradient: gradient * free)
        if isinstance(model, PPO) and config.log_std_end is not None:
            model.policy.log_std.register_hook(torch.zeros_like)
        for layer in _actor(model)[:-1] if config.last_layer else ():
            for parameter in layer.parameters():
                parameter.register_hook(torch.zeros_like)
    if turns is not None:
        assert isinstance(model, PPO)
        _make_symmetric(model, *turns)
    return model


def _make_symmetric(model: PPO, shown: Turn, said: Turn) -> None:
    """Make the actor equivariant and the critic invariant to rotations by 90°."""
    critic = [m for part in (model.policy.mlp_extractor.value_net, model.policy.value_net) for m in _linear(part)]
    tie_layers(_actor(model), shown, said)
    tie_layers(critic, shown, Turn.none(1))
    tie(model.policy.log_std, Turn(said.places, np.ones(len(said.places))))


def learn_segment(
    model: Agent, envs: VecEnv, schedule: "ActorSchedule", *, steps: int, seed: int, lr: float, first: bool,
    log_std: float | None = None,
) -> None:  # fmt: skip
    """Learn for `steps` decisions from new episodes; the result depends only on the state and the seed.

    PPO updates as in Stable-Baselines3. All environments run `n_steps` decisions. The advantages of generalised
    advantage estimation (λ = `gae_lambda`) are normalised in every batch of `batch_size`. Up to `epochs` passes of Adam
    optimise the clipped objective, the critic's squared error and the entropy, until `target_kl` is exceeded. Before
    and after each rollout `ActorSchedule` freezes or releases the actor and averages its weights.

    Args:
        model: The agent.
        envs: Environments of the agent.
        schedule: Schedule of the actor.
        steps: Number of decisions, summed over all environments.
        seed: Seed of all random numbers of this segment.
        lr: Learning rate.
        first: Whether this is the first segment of the run.
        log_std: PPO: logarithm of the exploration's standard deviation; None: it is learned.
    """
    model.set_env(envs, force_reset=True)
    model.set_random_seed(seed)
    model.learning_rate = lr
    model._setup_lr_schedule()
    if isinstance(model, PPO) and log_std is not None:
        with torch.no_grad():
            model.policy.log_std.fill_(log_std)
    model.learn(steps, callback=schedule, reset_num_timesteps=first, log_interval=1, tb_log_name="log")
    schedule.update_average()


class ActorSchedule(BaseCallback):
    """Callback that freezes the actor at the beginning, averages its weights and reports progress."""

    def __init__(self, config: LearnerConfig, mean: Layers, on_steps: Callable[[int], object] = lambda _: None) -> None:
        """Store the averaged actor of a run.

        Args:
            config: Settings, of which `critic_first` and `average` are used.
            mean: Current averaged actor.
            on_steps: Called with the number of new decisions.
        """
        super().__init__()
        self.mean = mean
        self._config, self._on_steps = config, on_steps
        self._reported = 0
        self._learning, self._rolled_out = 0.0, 0.0

    def _on_training_start(self) -> None:
        self._reported = self.num_timesteps
        self._free_or_freeze()

    def _on_rollout_start(self) -> None:
        # The weights now include the update from the previous rollout.
        self._learned()
        self.update_average()
        self._free_or_freeze()

    def _on_step(self) -> bool:
        self._on_steps(self.num_timesteps - self._reported)
        self._reported = self.num_timesteps
        return True

    def _on_rollout_end(self) -> None:
        self._rolled_out = time.perf_counter()

    def _learned(self) -> None:
        """Add the time since the end of the last rollout."""
        if self._rolled_out:
            self._learning += time.perf_counter() - self._rolled_out
        self._rolled_out = 0.0

    def spent(self) -> float:
        """Return the wall time of updates since the last call [s]."""
        self._learned()
        found, self._learning = self._learning, 0.0
        return found

    def _free_or_freeze(self) -> None:
        """Release the actor after the critic has learned for `critic_first` decisions, and freeze it before."""
        free = self.num_timesteps >= self._config.critic_first
        for parameter in _actor_parameters(self._agent()):
            parameter.requires_grad_(free)

    def update_average(self) -> None:
        """Update the average with the current weights."""
        keep = self._config.average
        now = actor_layers(self._agent())
        self.mean = tuple(
            (keep * w + (1.0 - keep) * v, keep * b + (1.0 - keep) * c)
            for (w, b), (v, c) in zip(self.mean, now, strict=True)
        )

    def _agent(self) -> Agent:
        assert isinstance(self.model, Agent)
        return self.model


def _actor(model: Agent) -> list[nn.Linear]:
    """Return the linear layers of the mean action."""
    if isinstance(model, PPO):
        parts = [model.policy.mlp_extractor.policy_net, model.policy.action_net]
    else:
        parts = [model.actor.latent_pi, model.actor.mu]
    return [m for part in parts for m in _linear(part)]


def _linear(part: nn.Module) -> list[nn.Linear]:
    """Return the linear layers of a module, in order."""
    return [m for m in part.modules() if isinstance(m, nn.Linear)]


def actor_layers(model: Agent) -> Layers:
    """Return copies of the weights and biases of the mean action."""
    return tuple((m.weight.detach().numpy().copy(), m.bias.detach().numpy().copy()) for m in _actor(model))


def set_actor(model: Agent, layers: Layers) -> None:
    """Set the weights and biases of the mean action, with the shapes of `actor_layers`."""
    with torch.no_grad():
        for own, (weight, bias) in zip(_actor(model), layers, strict=True):
            own.weight.copy_(torch.from_numpy(weight))
            own.bias.copy_(torch.from_numpy(bias))


def _actor_parameters(model: Agent) -> Iterator[nn.Parameter]:
    """Yield the parameters of the actor alone, which `ActorSchedule` freezes."""
    if isinstance(model, PPO):
        yield from model.policy.mlp_extractor.policy_net.parameters()
        yield from model.policy.action_net.parameters()
        yield model.policy.log_std
    else:
        yield from model.actor.parameters()


BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of Stable-Baselines3's replay buffer."""


def _tensors(model: Agent) -> Iterator[tuple[str, torch.Tensor]]:
    """Yield every tensor that training changes, by name: networks, optimiser moments, and SAC's entropy weight."""
    parts, variables = model._get_torch_save_params()
    for part in parts:
        owner: Any = model
        for name in part.split("."):
            owner = getattr(owner, name)
        if isinstance(owner, nn.Module):
            yield from ((f"{part}/{name}", tensor) for name, tensor in owner.state_dict().items())
            continue
        assert isinstance(owner, torch.optim.Adam)
        for k, parameter in enumerate(p for group in owner.param_groups for p in group["params"]):
            moments = owner.state[parameter]
            if not moments:  # Adam's initial state, for a parameter that has not been updated yet
                moments["step"] = torch.tensor(0.0)
                moments["exp_avg"], moments["exp_avg_sq"] = (torch.zeros_like(parameter) for _ in range(2))
            yield from ((f"{part}/{k}/{name}", moments[name]) for name in ("step", "exp_avg", "exp_avg_sq"))
    yield from ((name, getattr(model, name)) for name in variables or ())


def save_state(model: Agent) -> dict[str, np.ndarray]:
    """Return the complete state of the learner as copied arrays by name."""
    state = {name: tensor.detach().numpy().copy() for name, tensor in _tensors(model)}
    counters = [model.num_timesteps, model._n_updates]
    if isinstance(model, SAC):
        buffer = model.replay_buffer
        assert buffer is not None
        end = buffer.buffer_size if buffer.full else buffer.pos
        state |= {f"buffer/{name}": getattr(buffer, name)[:end] for name in BUFFER}
        counters += [buffer.pos, int(buffer.full)]
    return {**state, "counters": np.array(counters)}


def load_state(model: Agent, state: Mapping[str, np.ndarray]) -> None:
    """Restore a saved state.

    Args:
        model: Agent returned by `build`.
        state: Arrays with the names, types and shapes of `save_state`.

    Raises:
        InvalidValueError: If the counters do not match the arrays.
    """
    with torch.no_grad():
        for name, tensor in _tensors(model):
            tensor.copy_(torch.from_numpy(state[name]))
    counters = state["counters"].tolist()
    model.num_timesteps, model._n_updates = counters[:2]
    if isinstance(model, SAC):
        buffer, ends = model.replay_buffer, {len(state[f"buffer/{name}"]) for name in BUFFER}
        assert buffer is not None
        buffer.pos, buffer.full = counters[2], counters[3] == 1
        if ends != {buffer.buffer_size if buffer.full else buffer.pos} or not 0 <= buffer.pos < buffer.buffer_size:
            raise InvalidValueError("counters", counters, "those of the replay buffer")
        for name in BUFFER:
            getattr(buffer, name)[: max(ends)] = state[f"buffer/{name}"]
    if min(counters) < 0:
        raise InvalidValueError("counters", counters, "whole numbers of at least 0")
