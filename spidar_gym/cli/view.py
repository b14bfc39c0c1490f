"""`spidar view`: the robot in MuJoCo's viewer, or live in a browser."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from spidar_gym.arguments import Flag, choice
from spidar_gym.cli.evaluate import BASELINES
from spidar_gym.cli.run import UNDISTURBED, TaskOptions, chosen_arguments
from spidar_gym.committed import committed_artifacts
from spidar_gym.envs.registry import HOVER, environment
from spidar_gym.errors import InvalidValueError, require_least, require_name
from spidar_gym.native.plant import Plant
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import policy_arguments, policy_name
from spidar_gym.robot import FORMS
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.scene import scene
from spidar_gym.tasks.hover import hover_height
from spidar_gym.viz.live.serve import HOST, PORT, is_loopback, keep_time, require_viser, served
from spidar_gym.viz.live.session import ALONE, Session


@dataclass(frozen=True)
class WebOptions:
    """Options of the page."""

    policy: str | None = None
    """module:Class, a learned policy's artifact, or with --trust a zip of Stable-Baselines3.
    The policy selects its controller."""
    trust: Flag = False
    """Load zips saved by Stable-Baselines3. They can run any code: use only files that you trust."""
    seed: int = 0
    """Seed of the first episode; it increases by 1 per episode."""
    wake: bool = True
    """Simulate the rotors' wakes, which reduce the thrust of other rotors."""
    sensors: Flag = False
    """Pass the controller estimates from noisy sensors instead of the true state."""
    randomization: float | Path = 0.0
    """Strength of the domain randomisation, 0 … 1, a TOML file of ranges, or a calibrated world by name."""
    host: str = HOST
    """Address to listen on: 127.0.0.1 for this machine only; any other is open to the network, with a token."""
    port: int = PORT
    """Port to listen on, 1 … 65535; 0 selects a free port."""


TASK, PAGE = TaskOptions(), WebOptions()


def view(
    env_id: tyro.conf.Positional[str] = HOVER,
    form: Annotated[str, choice(FORMS)] = "form1",
    web: Flag = False,
    task: Annotated[TaskOptions, tyro.conf.arg(name="")] = TASK,
    page: Annotated[WebOptions, tyro.conf.arg(name="")] = PAGE,
    disturbances: Annotated[Disturbances, tyro.conf.arg(name="")] = UNDISTURBED,
) -> None:
    """Show the robot in a form in MuJoCo's viewer, or with --web simulate it live on a page for a browser.

    The viewer requires a display. The page requires the extra web and a browser, on this machine or at the other end
    of `ssh -L 8080:localhost:8080`, but no OpenGL on this machine. It shows thrusts, jets, contact forces and errors;
    form, reference, wind, faults, preset and policy can be changed in flight. Requests of other web pages are refused.
    Ctrl-C ends it.

    Args:
        env_id: Environment of the page.
        form: Initial form of the robot.
        web: Serve the page; all other options except --form apply only to the page.
    """
    require_name("form", form, FORMS)
    if not web:
        _refuse_page(env_id, task, page, disturbances)
        _open_window(form)
        return
    require_viser()
    environment(env_id)
    require_least(0, seed=page.seed)
    options = task.given | {name: getattr(page, name) for name in ("wake", "sensors", "randomization")}
    if page.policy is not None:  # arguments that the policy selects must not be given as well
        chosen_arguments(load_policy(page.policy, trust=page.trust), page.policy, env_id, task.given)
    session = Session(
        env_id, options, policy=page.policy or ALONE, trust=page.trust, seed=page.seed, form=form,
        disturbances=disturbances,
    )  # fmt: skip
    try:
        with served(session, dict(policies(env_id, page)), host=page.host, port=page.port) as (shown, address):
            print(f"{address} shows {env_id}; Ctrl-C ends it", flush=True)
            if not is_loopback(page.host):
                print(
                    "spidar: warning: this address and its token are all that is needed to control the robot",
                    file=sys.__stderr__,
                )
            keep_time(shown, lambda: False)
    finally:
        session.close()


def policies(env_id: str, page: WebOptions) -> Iterator[tuple[str, str]]:
    """Yield name and specification of each policy for an environment: the requested one, then the committed ones.

    A committed policy with the name of the requested one, usually the same policy, is omitted.
    """
    requested = None
    if page.policy is not None:
        requested = policy_name(load_policy(page.policy, trust=page.trust))
        yield requested, page.policy
    learned = [name for name in committed_artifacts() if name.endswith("/seed0.npz")]
    for spec in (*BASELINES, *learned):
        policy = load_policy(spec)
        if policy_name(policy) != requested and policy_arguments(policy, env_id) is not None:
            yield policy_name(policy), spec


def _refuse_page(env_id: str, task: TaskOptions, page: WebOptions, disturbances: Disturbances) -> None:
    """Refuse options of the page without --web."""
    given: dict[str, Any] = {"env_id": env_id} if env_id != HOVER else {}
    for options, none in ((task, TASK), (page, PAGE), (disturbances, UNDISTURBED)):
        values = {f.name: getattr(options, f.name) for f in fields(none)}
        given |= {name: value for name, value in values.items() if value != getattr(none, name)}
    for name, value in given.items():
        raise InvalidValueError(name, value, "--web with it: MuJoCo's viewer only shows the robot in a form")


def _open_window(form: str) -> None:
    """Open MuJoCo's viewer with the robot in a form."""
    import mujoco
    import mujoco.viewer

    from spidar_gym.sim.renderer import require_display

    require_display()
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, hover_height()]), joint_position=FORMS[form])
    model = scene(visual=True)
    data = mujoco.MjData(model)  # pyright: ignore[reportAttributeAccessIssue] - compiled, without stubs
    data.qpos[:], data.act[:], data.ctrl[:] = plant.data.qpos, plant.data.act, plant.data.ctrl
    mujoco.viewer.launch(model, data)
