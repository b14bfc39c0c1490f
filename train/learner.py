"""The learner: a Stable-Baselines3 agent that starts as its base, and what of it becomes an artifact."""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

if TYPE_CHECKING:
    from train.residual import Args

ALGORITHMS = ("ppo", "sac")
"""Learners by name."""
Layers = tuple[tuple[np.ndarray, np.ndarray], ...]
"""W (out, in) and b (out,) of every layer of an actor."""


class BaseFirstSAC(SAC):
    """SAC whose buffer is first filled by its base with a little noise, instead of by actions drawn evenly."""

    noise = 0.1
    """Standard deviation of the first actions."""

    def _sample_action(self, learning_starts: int, action_noise: Any = None, n_envs: int = 1) -> Any:  # noqa: ANN401 - SB3's signature
        if self.num_timesteps >= learning_starts:
            return super()._sample_action(learning_starts, action_noise, n_envs)
        drawn = torch.randn(n_envs, *(self.action_space.shape or ())).numpy()
        action = np.clip(self.noise * drawn, -1.0, 1.0)
        return action, action


def build(args: "Args", envs: VecEnv, logs: str | None, hidden: np.ndarray, still: np.ndarray) -> PPO | SAC:
    """An agent on the CPU whose mean action is exactly zero.

    Args:
        args: Hyperparameters.
        envs: Environments.
        logs: Folder for TensorBoard; none if None.
        hidden: Which numbers of the observation the actor does not see, though the critic does.
        still: Which entries of the action stay 0.
    """
    pi, vf = [args.hidden] * 2, [args.critic_hidden] * 2
    shared: dict[str, Any] = {
        "learning_rate": args.lr, "gamma": args.gamma, "seed": args.seed, "device": "cpu",
        "tensorboard_log": logs, "batch_size": args.batch_size,
    }  # fmt: skip
    if args.algorithm == "ppo":
        kwargs = {"net_arch": {"pi": pi, "vf": vf}, "activation_fn": nn.Tanh, "log_std_init": args.log_std}
        model = PPO(
            "MlpPolicy", envs, n_steps=args.n_steps, n_epochs=args.epochs, gae_lambda=args.gae_lambda,
            clip_range=args.clip_range, target_kl=args.target_kl or None, ent_coef=args.entropy,
            policy_kwargs=kwargs, **shared,
        )  # fmt: skip
    else:
        kwargs = {"net_arch": {"pi": pi, "qf": vf}, "activation_fn": nn.ReLU, "log_std_init": args.log_std}
        model = BaseFirstSAC(
            "MlpPolicy", envs, buffer_size=args.buffer, learning_starts=args.warmup,
            gradient_steps=args.updates, train_freq=1, policy_kwargs=kwargs, **shared,
        )  # fmt: skip
        log_std = model.actor.log_std
        assert isinstance(log_std, nn.Linear)
        with torch.no_grad():
            log_std.weight.zero_()
            log_std.bias.fill_(args.log_std)
    first, last = _actor(model)[0], _actor(model)[-1]
    with torch.no_grad():
        last.weight.zero_()
        last.bias.zero_()
        seen, free = (torch.tensor(~mask, dtype=torch.float32) for mask in (hidden, still))
        first.weight.mul_(seen)
        first.weight.register_hook(lambda gradient: gradient * seen)
        last.weight.register_hook(lambda gradient: gradient * free[:, None])
        last.bias.register_hook(lambda gradient: gradient * free)
    return model


def _actor(model: PPO | SAC) -> list[nn.Linear]:
    """The layers of the mean action."""
    if isinstance(model, PPO):
        parts = [model.policy.mlp_extractor.policy_net, model.policy.action_net]
    else:
        parts = [model.actor.latent_pi, model.actor.mu]
    return [m for part in parts for m in part.modules() if isinstance(m, nn.Linear)]


def actor_layers(model: PPO | SAC) -> Layers:
    """Weights and biases of the mean action, copied."""
    return tuple((m.weight.detach().numpy().copy(), m.bias.detach().numpy().copy()) for m in _actor(model))


def _actor_parameters(model: PPO | SAC) -> Iterator[nn.Parameter]:
    """Everything that only the actor has."""
    if isinstance(model, PPO):
        yield from model.policy.mlp_extractor.policy_net.parameters()
        yield from model.policy.action_net.parameters()
        yield model.policy.log_std
    else:
        yield from model.actor.parameters()


class Coach(BaseCallback):
    """Keeps the actor still while the critic learns first, averages the actor's weights, and reports progress."""

    def __init__(
        self, average: float, critic_first: int, mean: Layers, on_steps: Callable[[int], object] = lambda _: None
    ) -> None:
        """Take the state of a run.

        Args:
            average: Share of the old average that a rollout leaves; 0 is the present weights.
            critic_first: Steps in which only the critic learns.
            mean: The averaged actor so far.
            on_steps: Called with the number of new steps.
        """
        super().__init__()
        self.mean = mean
        self._average, self._critic_first, self._on_steps = average, critic_first, on_steps
        self._told = 0

    def _agent(self) -> PPO | SAC:
        assert isinstance(self.model, PPO | SAC)
        return self.model

    def _on_training_start(self) -> None:
        self._told = self.num_timesteps
        self._free()

    def _free(self) -> None:
        free = self.num_timesteps >= self._critic_first
        for parameter in _actor_parameters(self._agent()):
            parameter.requires_grad_(free)

    def _on_rollout_start(self) -> None:
        # What was learned from the rollout before is in the weights now.
        self.mix()
        self._free()

    def mix(self) -> None:
        """Take the present weights into the average."""
        keep = self._average
        now = actor_layers(self._agent())
        self.mean = tuple(
            (keep * w + (1.0 - keep) * v, keep * b + (1.0 - keep) * c)
            for (w, b), (v, c) in zip(self.mean, now, strict=True)
        )

    def _on_step(self) -> bool:
        self._on_steps(self.num_timesteps - self._told)
        self._told = self.num_timesteps
        return True


def save_state(model: PPO | SAC) -> dict[str, Any]:
    """All that the learner has learned and remembers."""
    _, variables = model._get_torch_save_params()
    state: dict[str, Any] = {"parameters": model.get_parameters(), "num_timesteps": model.num_timesteps,
                             "updates": model._n_updates}  # fmt: skip
    state["variables"] = {name: getattr(model, name).detach().clone() for name in variables or ()}
    if isinstance(model, SAC):
        buffer = model.replay_buffer
        assert buffer is not None
        end = buffer.buffer_size if buffer.full else buffer.pos
        state["buffer"] = {name: getattr(buffer, name)[:end] for name in BUFFER}
        state["position"] = (buffer.pos, buffer.full)
    return state


BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of SB3's replay buffer."""


def load_state(model: PPO | SAC, state: Mapping[str, Any]) -> None:
    """Become what was saved."""
    model.set_parameters(state["parameters"], exact_match=True, device="cpu")
    model.num_timesteps, model._n_updates = state["num_timesteps"], state["updates"]
    for name, value in state["variables"].items():
        getattr(model, name).data.copy_(value)
    if isinstance(model, SAC):
        buffer = model.replay_buffer
        assert buffer is not None
        for name, array in state["buffer"].items():
            getattr(buffer, name)[: len(array)] = array
        buffer.pos, buffer.full = state["position"]


def learn_segment(
    model: PPO | SAC, envs: VecEnv, coach: Coach, *, steps: int, seed: int, lr: float, first: bool
) -> None:
    """Learn for `steps` steps from fresh episodes: what comes out depends on the state, the seed and nothing else.

    Args:
        model: The agent.
        envs: Its environments.
        coach: Callback.
        steps: How many steps.
        seed: Of everything that is drawn in this segment.
        lr: Learning rate.
        first: Whether it is the run's first segment.
    """
    model.set_env(envs, force_reset=True)
    model.set_random_seed(seed)
    model.learning_rate = lr
    model._setup_lr_schedule()
    model.learn(steps, callback=coach, reset_num_timesteps=first, log_interval=1, tb_log_name="log")
    coach.mix()
