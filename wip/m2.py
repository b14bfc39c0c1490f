"""Missions with Grasper."""

import math, sys, time
from dataclasses import replace
import numpy as np
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import controller_config
from spidar_gym.control.grasp.phases import *
from spidar_gym.native.core_flight import CoreFlightController
from spidar_gym.native.plant import Plant
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import Reference


def fly(
    obj,
    preset="tuned",
    yaw_o=0.3,
    off=(0.3, 0.2, 0.5),
    verbose=True,
    base=None,
    seed=0,
    way=(2.5, 0.3, 0),
    yaw_g=0.5,
    most=33.0,
    core=True,
    config=None,
    noise=0.001,
    bias=(0, 0, 0),
    target=None,
):
    p = Plant(replace(base or PlantConfig(), object=obj))
    c = CoreFlightController(controller_config(preset)) if core else FlightController(controller_config(preset))
    from spidar_gym.model.dynamics import Model

    model = Model()
    z = obj.scale[2]
    quat = np.array([math.cos(yaw_o / 2), 0, 0, math.sin(yaw_o / 2)])
    q = np.tile([0, 0.6, 0, 1.2], 4)
    start = np.array([0, 0, z + 0.78 + 0.1]) + off
    yaw = 0.5
    rng = np.random.Generator(np.random.PCG64(seed))
    vec = FlightController(controller_config(preset)).rest_vectoring(q)
    s = p.reset(
        start,
        np.array([math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)]),
        q,
        vec,
        np.full(8, 20.0),
        object_pose=np.array([0, 0, z, *quat]),
        rng=rng,
    )
    c.reset(s, q)
    noise_rng = np.random.Generator(np.random.PCG64(seed + 1000))

    def look():
        o = p.object()
        return Seen(o.position_w + bias + noise * noise_rng.standard_normal(3), o.quat_wo)

    g = Grasper(config)
    tgt = Grasp(obj.shape, obj.half_size, most)
    com_b = lambda s: model.snapshot(s.joint_position, quat_to_matrix(s.quat_wb), s.vectoring)
    g.begin(tgt, look(), np.append(start, yaw), q)
    t = 0
    stats = {}
    goal = np.array([way[0], way[1], z])
    stage = 0
    order = []
    lift = p.config.robot.weight
    tests = 0
    while t < 90:
        m = g.memory
        if m.lost and m.phase == "none":
            break
        if g.waits and stage == 0 and m.held:
            g.carry(goal + (0, 0, 0.7), yaw_g, 0.5)
            stage = 1
        elif g.waits and stage == 1 and m.held:
            g.place(0.0)
            stage = 2
        elif g.waits and stage == 2 and m.placed and m.phase == "hold":
            g.release()
            stage = 3
        elif g.waits and m.phase == "none":
            break
        elif g.waits and stage == 2 and m.held and m.phase == "hold" and t > 80:
            break
        R = quat_to_matrix(s.quat_wb)
        y = math.atan2(R[1, 0], R[0, 0])
        r = g.step(s.position_w, y, s.joint_position, lift, look(), 0.025)
        snap = com_b(s)
        v = r.velocity_w + R @ (snap.momentum_map[:3] @ s.joint_velocity) / snap.mass
        ref = Reference(
            r.position_w + R @ snap.com_b,
            np.array([math.cos(r.yaw / 2), 0, 0, math.sin(r.yaw / 2)]),
            v,
            np.array([0, 0, r.turning]),
            r.form,
        )
        s = p.step(c.step(s, ref, grip=r.grip))
        t += 0.025
        lift = float((R @ c.last_step.wrench_desired[:3])[2])
        o = p.object()
        F = np.linalg.norm(o.foot_force_w[:, :2], axis=1)
        if not order or order[-1] != g.memory.phase:
            order.append(g.memory.phase)
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
                np.linalg.norm(s.position_w - r.position_w),
                abs(quat_to_matrix(s.quat_wb)[2, 2]),
                o.is_hit,
                t,
            )
        )
        if p.diverged or o.is_hit or p.violated & 2:
            order.append("VIOLATED")
            break
    if verbose:
        for k, d in stats.items():
            d = np.array(d)
            print(
                f"{k:8s} {len(d) * 0.025:5.1f}s foot {d[:, 0].min():6.2f} {d[:, 0].mean():6.2f} {d[:, 1].max():6.2f} Σλ {d[:, 2].mean():6.1f} λ {d[:, 3].max():5.1f} W {d[:, 4].mean():6.0f} air {d[:, 5].min():6.2f} z {d[-1, 6]:.3f} err {d[:, 7].max():.3f} tilt {np.arccos(min(1, d[:, 8].min())):.3f} hit {d[-1, 9]}"
            )
    o = p.object()
    e = o.position_w - goal
    yo = heading_of(o.quat_wo)
    F99 = np.percentile(np.concatenate([[x[1] for x in d] for d in stats.values()]), 99)
    return dict(
        ok=bool(np.linalg.norm(e) < 0.1 and order[-1] == "none" and not g.memory.lost),
        lost=g.memory.lost,
        refused=g.memory.refused,
        z=max(max(x[6] for x in d) for d in stats.values()),
        off=np.linalg.norm(e) * 1e3,
        yaw=math.remainder(yo - yaw_g, 2 * math.pi if obj.shape != "box" else math.pi / 2),
        t=t,
        hit=o.is_hit,
        Wh=p.energy_wh,
        m=g.memory.mass,
        n=g.memory.force,
        tests=order.count("test"),
        F99=F99,
        order=order,
    )


def line(r):
    return " ".join(f"{k} {v:.2f}" if isinstance(v, float) else f"{k} {v}" for k, v in r.items() if k != "order")


if __name__ == "__main__":
    obj = ObjectConfig(shape="box")
    t = time.time()
    r = fly(obj)
    print(line(r))
    print(r["order"], time.time() - t)
