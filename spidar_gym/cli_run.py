"""`spidar run`: episodes of a controller alone or of a policy, shown or recorded."""

import math
import sys
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro
from tqdm import tqdm

from spidar_gym import viz
from spidar_gym.benchmark.episode import ACT_LIMIT_S
from spidar_gym.benchmark.policy import Actor, Policy, PresetPolicy, defined_on, load_policy, policy_arguments
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS, SCHEDULES
from spidar_gym.description import CAMERAS
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.hover import HoverEnv
from spidar_gym.envs.hover_task import SEQUENCES
from spidar_gym.envs.registry import Entry, environment
from spidar_gym.errors import InvalidValueError, require_least, require_name
from spidar_gym.files import output_folder
from spidar_gym.sim.disturbances import FAULTS

PresetArg = Annotated[str | None, tyro.conf.arg(metavar="{" + ",".join((*PRESETS, *CRAWL_PRESETS)) + "}")]
FormsArg = Annotated[str | None, tyro.conf.arg(metavar="{" + ",".join(SEQUENCES) + "}")]
ScheduleArg = Annotated[str | None, tyro.conf.arg(metavar="{" + ",".join(SCHEDULES) + "}")]
FaultArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(FAULTS) + "}")]
CameraArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(CAMERAS) + "}")]


def run(
    env_id: tyro.conf.Positional[str] = "spidar_gym/Hover-v0",
    policy: str | None = None,
    episodes: int = 1,
    seed: int = 0,
    preset: PresetArg = None,
    joint_speed: float | None = None,
    forms: FormsArg = None,
    distance: float | None = None,
    direction: float | None = None,
    turn: float | None = None,
    schedule: ScheduleArg = None,
    friction: float | None = None,
    slope: float | None = None,
    steps: float | None = None,
    seconds: float | None = None,
    wake: bool = True,
    sensors: tyro.conf.FlagCreatePairsOff[bool] = False,
    randomization: float = 0.0,
    wind: float = 0.0,
    push: float = 0.0,
    lost_rotor: int = 0,
    fault: FaultArg = "thrust",
    camera: CameraArg = "chase",
    out: Path | None = None,
    show: tyro.conf.FlagCreatePairsOff[bool] = False,
) -> None:
    """Run episodes with the zero action, which is the controller alone, or with a policy; show them or record them.

    Args:
        env_id: Environment.
        policy: module:Class, or the path of a learned policy's artifact; it chooses its own controller.
        episodes: How many episodes.
        seed: Seed of the first episode; the next ones follow it.
        preset: Controller; the environment's own if not given.
        joint_speed: Joint speed [rad/s].
        forms: Form sequence (hover).
        distance: How far the goal is [m] (crawl); drawn if not given, like the next two.
        direction: Where it is, 0 straight ahead, 90 to the left [degrees] (crawl).
        turn: How far the heading turns [degrees] (crawl).
        schedule: Phases one after the other or overlapped (crawl).
        friction: Sliding friction of the feet (crawl).
        slope: Angle of the floor [degrees] (crawl).
        steps: The floor is of tiles with random heights up to this [m] (crawl).
        seconds: Length of an episode [s]; the environment's own if not given.
        wake: Air between the rotors.
        sensors: The controller sees real sensors through the estimator.
        randomization: Strength of the domain randomisation, 0 … 1.
        wind: Mean wind [m/s].
        push: Force of pushes on the torso [N].
        lost_rotor: Module that fails after 2 s, 1 … 8; 0 for none.
        fault: What it loses.
        camera: Camera of the video.
        out: Video file to write (.mp4).
        show: Open a window.
    """
    entry = _check_run(env_id, episodes, seed, camera, seconds, out)
    horizon = entry.horizon if seconds is None else round(seconds * CONTROL_RATE)
    given: dict[str, Any] = {
        "preset": preset, "joint_speed": joint_speed, "forms": forms, "distance": distance, "schedule": schedule,
        "friction": friction, "steps": steps,
        **{name: None if angle is None else math.radians(angle)
           for name, angle in (("direction", direction), ("turn", turn), ("slope", slope))},
    }  # fmt: skip
    given = {name: value for name, value in given.items() if value is not None}
    flier = None if policy is None else load_policy(policy)
    env = gymnasium.make(
        env_id, **given, **_chosen(flier, policy, env_id, given),
        horizon_s=horizon / CONTROL_RATE, max_episode_steps=horizon,
        wake=wake, sensors=sensors, randomization=randomization,
        disturbances={"wind": wind, "push": push, "lost_rotor": lost_rotor, "fault": fault},
        render_mode="human" if show else None,
    )  # fmt: skip
    inner = env.unwrapped
    assert isinstance(inner, SpidarEnv)
    actor = Actor(flier or PresetPolicy(), env.action_space.shape or (), env_id, limit_s=ACT_LIMIT_S)
    film = None
    if out is not None:
        output_folder(out.parent)
        film = viz.FlightVideo(out, camera=camera, ground=inner.plant.config.ground)
    finished, survived, succeeded, finite = False, 0, 0, 0
    try:
        for episode in range(episodes):
            infos, rewards, healthy = _episode(env, inner, actor, seed + episode, episode, horizon, film)
            last = infos[-1]
            finite += healthy
            survived += not last["failure"]
            succeeded += last["is_success"]
            print(
                f"episode {episode + 1} (seed {seed + episode}): {len(rewards) / CONTROL_RATE:.1f} s, "
                f"mean reward {np.mean(rewards):.3f}, {_errors(infos)}, "
                + (f"failure: {last['failure']}" if last["failure"] else f"success: {last['is_success']}")
                + (f" ({last['shortfalls']})" if last.get("shortfalls") else "")
            )
        if episodes > 1:
            stayed = "stayed in the air" if isinstance(inner, HoverEnv) else "went on without failure"
            print(f"{survived} of {episodes} {stayed}, {succeeded} with success, {finite} in finite numbers")
        finished = True
    finally:
        if film is not None:
            film.close(keep=finished)
        env.close()


def _episode(
    env: gymnasium.Env, inner: SpidarEnv, actor: Actor, seed: int, number: int, horizon: int,
    film: viz.FlightVideo | None,
) -> tuple[list[dict[str, Any]], list[float], bool]:  # fmt: skip
    """Infos and rewards of one episode, and whether its last observation is finite; a crawl ends when it is done."""
    observation, _ = env.reset(seed=seed)
    actor.reset(seed)
    if film is not None:
        film.lay(inner.plant.config.ground)
    infos: list[dict[str, Any]] = []
    rewards: list[float] = []
    ended = False
    with tqdm(total=horizon, unit="tick", desc=f"episode {number + 1}", file=sys.__stderr__, leave=False) as bar:
        while not ended:
            observation, reward, terminated, truncated, info = env.step(actor.act(observation))
            ended = terminated or truncated or info.get("finished", False)
            rewards.append(float(reward))
            infos.append(info)
            bar.update()
            if film is not None:
                caption = f"{len(rewards) / CONTROL_RATE:5.1f} s   {info.get('phase', '')}"
                contacts = inner.plant.contact_forces() if inner.plant.in_contact else None
                film.film(len(rewards), inner.plant.data.qpos, caption, info["thrust"], contacts)
    return infos, rewards, bool(np.isfinite(observation).all())


def _chosen(policy: Policy | None, spec: str | None, env_id: str, given: dict[str, Any]) -> dict[str, Any]:
    """What a policy asks `gym.make` for; nobody else chooses that."""
    if policy is None:
        return {}
    chosen = policy_arguments(policy, env_id)
    if chosen is None:
        found = ", ".join(defined_on(policy)) or "none"
        raise InvalidValueError("policy", spec, f"one for {env_id}; this one is for {found}")
    for name in chosen:
        if name in given:
            raise InvalidValueError(name, given[name], f"nothing beside this policy, which chooses {chosen[name]}")
    return chosen


def _errors(infos: list[dict[str, Any]]) -> str:
    """What an episode's errors come to, in words."""
    last = infos[-1]
    if "goal_error" in last:
        x, y, yaw = (1e3 * last["goal_error"]).tolist()
        slip = 1e3 * last["foot_slip_m"]
        return f"goal off by {x:.1f}, {y:.1f} mm, {yaw:.1f} mrad, worst foot slid {slip:.0f} mm"
    errors = np.array([np.concatenate([info["position_error"], info["attitude_error"]]) for info in infos])
    rms = np.sqrt((errors**2).sum(axis=0) / len(errors))
    position, attitude = 1e3 * np.linalg.norm(rms[:3]), 1e3 * np.linalg.norm(rms[3:])
    return f"RMS position {position:.1f} mm, attitude {attitude:.1f} mrad"


def _check_run(env_id: str, episodes: int, seed: int, camera: str, seconds: float | None, out: Path | None) -> Entry:
    """The environment's entry, where the arguments of `run` make sense."""
    entry = environment(env_id)
    require_least(1, episodes=episodes)
    require_least(0, seed=seed)
    require_name("camera", camera, CAMERAS)
    if seconds is not None and not 1.0 / CONTROL_RATE <= seconds < math.inf:
        raise InvalidValueError("seconds", seconds, f"at least one tick, {1 / CONTROL_RATE:g} s, and finite")
    if out is not None and (out.suffix != ".mp4" or out.is_dir()):
        raise InvalidValueError("out", str(out), "a path of a file that ends in .mp4")
    return entry
