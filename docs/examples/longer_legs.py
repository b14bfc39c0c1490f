"""A custom robot with outer links a fifth longer, compared with the original in the air and on the ground.

`python docs/examples/longer_legs.py 50` runs fifty hovers and fifty crawls of each, and prints the results.
"""

import sys

import gymnasium
import numpy as np

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.robot import ROBOT, RobotSpec

LONG = RobotSpec(pitch_to_foot=1.2 * ROBOT.pitch_to_foot)
HARD = {"sensors": True, "randomization": 1.0}


def played(name, seed, **arguments):
    """Return `info` of every step of an episode without a policy; a crawl ends when it is finished."""
    env = gymnasium.make(name, **arguments)
    env.reset(seed=seed)
    infos, over = [], False
    while not over:
        *_, terminated, truncated, info = env.step(np.zeros(env.action_space.shape))
        infos.append(info)
        over = terminated or truncated or info.get("finished", False)
    env.close()
    return infos


def hover(robot, count, **arguments):
    """Return mean RMS errors of position [mm] and attitude [mrad] with moving legs, and the number of successes."""
    flights = [
        played("spidar_gym/Hover-v0", seed, robot=robot, preset="tuned", joint_speed=0.6, **arguments)
        for seed in range(count)
    ]
    errors = [[[info["position_error"], info["attitude_error"]] for info in infos] for infos in flights]
    rms = [1000 * np.sqrt((np.array(each) ** 2).sum(axis=2).mean(axis=0)) for each in errors]
    return (*np.mean(rms, axis=0), sum(bool(infos[-1]["is_success"]) for infos in flights))


def crawl(robot, count, **arguments):
    """Return the number of successful crawls to a random goal, and their median time over the planned one."""
    last = [
        played("spidar_gym/Crawl-v0", seed, robot=robot, preset="robust_retuned", **arguments)[-1]
        for seed in range(count)
    ]
    share = np.median([info["time_s"] / info["nominal_time_s"] for info in last])
    return sum(bool(info["is_success"]) for info in last), share


def compare(count):
    """Yield a line of text for each robot and setting."""
    for name, robot in {"original": ROBOT, "longer legs": LONG}.items():
        for setting, options in {"as described": {}, "sensors and randomised robots": HARD}.items():
            position, attitude, flown = hover(robot, count, **options)
            walked, share = crawl(robot, count, **options)
            yield (
                f"{name} ({robot.total_mass:.2f} kg), {setting}: hover {position:.1f} mm, {attitude:.1f} mrad, "
                f"{flown} of {count}; crawl {walked} of {count}, {share:.2f} of the planned time"
            )


if __name__ == "__main__":
    for line in compare(int(sys.argv[1]) if len(sys.argv) > 1 else 50):
        print(line, flush=True)
