"""Whole missions through the manager, from the floor to the floor."""

import math, sys, time
from dataclasses import replace
import numpy as np
from spidar_gym.control.locomotion.commands import *
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.control.locomotion.orders import ManagerConfig
from spidar_gym.control.grasp.phases import Seen, heading_of
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.native.plant import Plant
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.robot import ROBOT


def start(obj, base=None, seed=0, preset="tuned", place=(2.0, 0.3), yaw_o=0.4, kind=Manager):
    p = Plant(replace(base or PlantConfig(), object=obj))
    m = kind(ManagerConfig(flight=controller_config(preset)))
    z = obj.scale[2]
    rng = np.random.Generator(np.random.PCG64(seed))
    s = p.reset(
        np.array([0, 0, ROBOT.peg_depth]),
        np.array([1.0, 0, 0, 0]),
        m.lying,
        np.zeros((8, 2)),
        np.zeros(8),
        object_pose=np.array([*place, z, math.cos(yaw_o / 2), 0, 0, math.sin(yaw_o / 2)]),
        rng=rng,
    )
    m.reset(s)
    return p, m, s, rng


def run(p, m, s, seconds, log=None, noise=0.001, rng=None, blind=lambda t: False, stop=lambda: False):
    t = 0
    while t < seconds and not m.done and not stop():
        o = p.object()
        seen = (
            None if blind(t) else Seen(o.position_w + (0 if rng is None else noise * rng.standard_normal(3)), o.quat_wo)
        )
        s = p.step(m.step(s, seen=seen))
        t += 0.025
        if log is not None:
            log.append(
                (
                    m.phase,
                    m.grasper.memory.phase if hasattr(m, "grasper") else "",
                    s,
                    p.object(),
                    m.grasper.memory.force if hasattr(m, "grasper") else 0,
                )
            )
        if p.diverged:
            break
    return s, t


if __name__ == "__main__":
    obj = ObjectConfig(shape="box")
    p, m, s, rng = start(obj)
    log = []
    m.command(
        [
            TakeOff(1.5),
            FlyTo((1.5, 0, 1.6)),
            Grasp("box", obj.half_size),
            CarryTo((4.0, 1.0, 1.0), 0.8),
            Place(0.0),
            Release(),
            FlyTo((5.5, 1.0, 1.6)),
            Land(),
        ]
    )
    t0 = time.time()
    s, t = run(p, m, s, 120, log, rng=rng)
    ph = []
    k0 = 0
    for k, x in enumerate(log):
        if not ph or ph[-1][0] != x[:2]:
            ph.append((x[:2], round(k * 0.025, 2)))
    print(ph)
    o = p.object()
    print(
        t,
        s.position_w,
        o.position_w,
        heading_of(o.quat_wo),
        m.phase,
        m.commands,
        o.is_hit,
        p.violated,
        time.time() - t0,
    )
