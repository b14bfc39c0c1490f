"""A robot whose outer links are a fifth longer, beside the original: fifty hovers and fifty crawls of each.

`python docs/examples/longer_legs.py` prints the table of the guide; two minutes on a free core.
"""

import sys

import gymnasium
import numpy as np

from spidar_gym.robot import ROBOT, RobotSpec

LONG = RobotSpec(pitch_to_foot=1.2 * ROBOT.pitch_to_foot)
SETTINGS = {
    "as described": {},
    "real sensors, drawn robot": {"sensors": True, "randomization": 1.0},
}


def hover(robot, count, **options):
    """RMS position [mm] and attitude error [mrad] of each flight with moving legs, and how many succeeded."""
    env = gymnasium.make_vec(
        "spidar_gym/Hover-v0", count, robot=robot, preset="tuned", joint_speed=0.6, autoreset_mode="Disabled", **options
    )
    env.reset(seed=list(range(count)))
    squares, ticks = np.zeros((count, 2)), np.zeros(count)
    over, fine = np.zeros(count, bool), np.zeros(count, bool)
    while not over.all():
        _, _, terminated, truncated, info = env.step(np.zeros(env.action_space.shape))
        errors = np.stack([(info[f"{name}_error"] ** 2).sum(axis=1) for name in ("position", "attitude")], axis=1)
        squares[~over] += errors[~over]
        ticks += ~over
        fine[~over] = info["is_success"][~over]
        over |= terminated | truncated
        if over.any() and not over.all():
            break  # all end at the horizon, unless one has failed
    env.close()
    return 1000 * np.sqrt(squares / ticks[:, None]), int(fine.sum())


def crawl(robot, count, **options):
    """How many crawls to a drawn goal succeeded, and the median time over the planned one."""
    fine, shares = 0, []
    for seed in range(count):
        env = gymnasium.make("spidar_gym/Crawl-v0", robot=robot, preset="robust_overlapped", **options)
        env.reset(seed=seed)
        over = False
        while not over:
            *_, terminated, truncated, info = env.step(np.zeros(env.action_space.shape))
            over = terminated or truncated or info["finished"]
        fine += bool(info["is_success"])
        shares.append(info["time_s"] / info["nominal_time_s"])
        env.close()
    return fine, float(np.median(shares))


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    for name, robot in {"original": ROBOT, "longer legs": LONG}.items():
        for setting, options in SETTINGS.items():
            errors, flown = hover(robot, count, **options)
            position, attitude = errors.mean(axis=0)
            walked, share = crawl(robot, count, **options)
            print(
                f"{name}, {robot.total_mass:.2f} kg, {setting}: hover {position:.1f} mm, {attitude:.1f} mrad, "
                f"{flown} of {count}; crawl {walked} of {count}, {share:.2f} of the planned time"
            )
