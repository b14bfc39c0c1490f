"""A policy from its name: a class of a module, or the artifact of a learned one."""

import inspect
from pathlib import Path

from spidar_gym.policies.artifact import LearnedPolicy, read_artifact
from spidar_gym.policies.policy import Policy
from spidar_gym.policies.source import ARTIFACT, PolicyError, load_module, module_of


def load_policy(spec: str) -> Policy:
    """The policy that a name stands for.

    Args:
        spec: `module:Class`, or the path of a learned policy's artifact, `*.npz`. Modules are looked for in the working
            folder too, but for the committed baselines. Its code runs: where the name is from a file and not from the
            user, the caller asks `is_own` first.

    Raises:
        PolicyError: When there is none, it does not start, or it lacks `reset` or `act`.
        SpidarError: When an artifact does not match this version of the environments.
    """
    if spec.endswith(ARTIFACT):
        return LearnedPolicy(read_artifact(Path(spec)), Path(spec))
    module, name = module_of(spec)
    try:
        found = getattr(load_module(module), name)
        policy = found() if inspect.isclass(found) else found
    except PolicyError as error:
        raise PolicyError(f"{spec}: {error}") from error
    except (Exception, SystemExit) as error:
        raise PolicyError(f"policy {spec}: {type(error).__name__}: {error}; valid: module:Class, importable") from error
    if not isinstance(policy, Policy):
        raise PolicyError(f"policy {spec}: lacks reset or act; valid: reset(seed), act(observation) -> action")
    return policy
