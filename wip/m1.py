import math, sys, time
from dataclasses import replace
import numpy as np
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import controller_config
from spidar_gym.control.grasp.phases import *
from spidar_gym.native.plant import Plant
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import Reference


def fly(
    obj,
    task,
    preset="tuned",
    yaw_o=0.3,
    off=(0.3, 0.2, 0.5),
    drop=None,
    verbose=True,
    base=None,
    seed=None,
    way=(2.5, 0, 0),
    obj_z=None,
):
    p = Plant(replace(base or PlantConfig(), object=obj))
    c = FlightController(controller_config(preset))
    z = obj.scale[2]
    quat = np.array([math.cos(yaw_o / 2), 0, 0, math.sin(yaw_o / 2)])
    q = claw_open = np.tile([0, 0.6, 0, 1.2], 4)
    start = np.array([0, 0, z + 0.78 + 0.1]) + off
    yaw = 0.5
    rng = np.random.Generator(np.random.PCG64(seed)) if seed is not None else None
    s = p.reset(
        start,
        np.array([math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)]),
        q,
        c.rest_vectoring(q),
        np.full(8, 20.0),
        object_pose=np.array([0, 0, z, *quat]),
        rng=rng,
    )
    c.reset(s, q)
    o = p.object()
    seen = Seen(o.position_w, o.quat_wo)
    g = Grasp(task, seen, start, yaw, q)
    t = 0
    last = ""
    stats = {}
    carried = lowered = False
    worst = 0
    while t < 70 and not (g.waits and g.memory.phase == "leave"):
        if g.waits and g.memory.phase == "lift":
            g.carry(np.array(way))
        elif g.waits and g.memory.phase == "carry":
            g.lower(task.height)
        o = p.object()
        seen = Seen(o.position_w, o.quat_wo)
        r = g.step(s.position_w, s.joint_position, seen, 0.025)
        R = quat_to_matrix(s.quat_wb)
        snap = c.model.snapshot(s.joint_position, R, s.vectoring)
        v = r.velocity_w + R @ (snap.momentum_map[:3] @ s.joint_velocity) / snap.mass
        ref = Reference(
            r.torso_w + R @ snap.com_b,
            np.array([math.cos(r.yaw / 2), 0, 0, math.sin(r.yaw / 2)]),
            v,
            np.zeros(3),
            r.form,
        )
        s = p.step(c.step(s, ref, grip=r.grip))
        t += 0.025
        o = p.object()
        F = np.linalg.norm(o.foot_force_w[:, :2], axis=1)
        d = stats.setdefault(g.memory.phase, [])
        d.append(
            (
                F.min(),
                F.max(),
                s.thrust.sum(),
                s.thrust.max(),
                p.power,
                o.air_force_w[2],
                o.position_w[2] - z,
                np.linalg.norm(s.position_w - r.torso_w),
                abs(quat_to_matrix(s.quat_wb)[2, 2]),
                o.is_hit,
                t,
            )
        )
        if p.diverged:
            print("diverged")
            break
    if verbose:
        for k, d in stats.items():
            d = np.array(d)
            print(
                f"{k:8s} {len(d) * 0.025:5.1f}s foot {d[:, 0].min():6.2f} {d[:, 0].mean():6.2f} {d[:, 1].max():6.2f} Σλ {d[:, 2].mean():6.1f} λ {d[:, 3].max():5.1f} W {d[:, 4].mean():6.0f} air {d[:, 5].min():6.2f} z {d[-1, 6]:.3f} err {d[:, 7].max():.3f} tilt {np.arccos(min(1, d[:, 8].min())):.3f} hit {d[-1, 9]}"
            )
    o = p.object()
    e = o.position_w - [way[0], way[1], z]
    return dict(
        lost=g.memory.lost,
        z=max(max(x[6] for x in d) for d in stats.values()),
        off=np.linalg.norm(e) * 1e3,
        t=t,
        hit=o.is_hit,
        Wh=p.energy_wh,
    )


if __name__ == "__main__":
    obj = ObjectConfig(shape="box")
    print(fly(obj, GraspTask("box", obj.half_size, 11.0, 1.5)))
