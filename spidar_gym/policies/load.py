"""A policy from its name: a class of a module, the artifact of a learned one, or a zip of Stable-Baselines3."""

import inspect
from pathlib import Path

from spidar_gym.policies.artifact import LearnedPolicy, read_artifact
from spidar_gym.policies.policy import Policy
from spidar_gym.policies.source import ARTIFACT, ZIP, PolicyError, artifact_file, load_module, module_of


def load_policy(spec: str, *, trust: bool = False) -> Policy:
    """Load a policy by name.

    Args:
        spec: `module:Class`, or the path of a learned policy's artifact, `*.npz`, or of a model that Stable-Baselines3
            saved, `*.zip`. The working folder is searched for modules too, except for committed baselines. A path
            `baselines/learned/…` that the working folder lacks is that of the committed artifact. The policy's code is
            run: if the name is from a file and not from the user, call `is_own` first.
        trust: Whether a zip may be loaded, which runs any code in it.

    Raises:
        PolicyError: For a zip without trust; when a policy does not exist, raises an error, or lacks `reset` or `act`.
        SpidarError: When an artifact does not match this version of the environments.
        MissingDependencyError: For a zip without the extra `train`.
    """
    if spec.endswith(ARTIFACT):
        path = artifact_file(Path(spec))
        return LearnedPolicy(read_artifact(path), path)
    if spec.endswith(ZIP):
        return _load_zip(spec, trust)
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


def _load_zip(spec: str, trust: bool) -> Policy:
    if not trust:
        raise PolicyError(
            f"policy {spec}: a zip of Stable-Baselines3 can run code; valid: --trust, if you trust who made it, or an "
            f"artifact *{ARTIFACT}"
        )
    # Imported late so that the package works without learning frameworks.
    from spidar_gym.policies.stable import StablePolicy

    return StablePolicy(Path(spec))
