"""Gate: grasp missions in the engine."""

import math, sys, time
from dataclasses import dataclass, replace
import numpy as np
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import controller_config
from spidar_gym.control.rotors import flight_demand
from spidar_gym.model.interference import Disc
from spidar_gym.model.dynamics import Model
from spidar_gym.native.plant import Plant
from spidar_gym.robot import GRAVITY, ROBOT, N_LEGS
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import Reference

L1, L2 = ROBOT.pitch_to_yaw + ROBOT.yaw_to_pitch, ROBOT.pitch_to_foot


def feet_of(model, q):
    return model.stance(q, np.eye(3), np.zeros((8, 2)))[1].position_b


def claw(r, z, hip):
    """Joint angles of all legs with feet at (r, z), torso axes."""
    x, y = r - hip[0], -(z - hip[1])
    d2 = x * x + y * y
    c = (d2 - L1**2 - L2**2) / (2 * L1 * L2)
    q4 = math.acos(c)
    q2 = math.atan2(y, x) - math.atan2(L2 * math.sin(q4), L1 + L2 * math.cos(q4))
    return np.tile([0, q2, 0, q4], 4)


@dataclass
class Grip:
    force: float = 0.0  # N per foot
    payload: float = 0.0  # kg
    contact: np.ndarray | None = None
    object_w: np.ndarray | None = None
    avoid: Disc | None = None


class Grasp(FlightController):
    grip = Grip()
    obj_w = None  # measured object position
    radius = 0.3
    half_height = 0.25
    target = True
    in_qp = True
    feed = True
    share = True

    def _terms(self, snapshot, R_wb, position_w):
        feet = self._feet
        up = R_wb.T @ (0, 0, 1.0)
        centre_b = R_wb.T @ (self.obj_w - position_w)
        n = centre_b - feet.position_b
        n -= np.outer(n @ up, up)
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        F = self.grip.force * n + self.grip.payload * GRAVITY / 4 * up
        return F, centre_b, up

    def step(self, state, reference, *a, **k):
        self._seen = state
        return super().step(state, reference, *a, **k)

    def compute_state(self, state, reference):
        out = super().compute_state(state, reference)
        self._feet = self.model.stance(state.joint_position, out.R_wb, state.vectoring)[1]
        return out

    def compute_wrench(self, state, reference, control_state, joints):
        wrench, i, c = super().compute_wrench(state, reference, control_state, joints)
        if self.grip.payload and self.feed:
            F, centre_b, up = self._terms(control_state.snapshot, control_state.R_wb, self._seen.position_w)
            w = self.grip.payload * GRAVITY * up
            wrench[:3] += w
            wrench[3:] += np.cross(centre_b - control_state.snapshot.com_b, w)
        return wrench, i, c

    def _demand(self, memory, snapshot, reference, vectoring, wrench):
        R_wb = quat_to_matrix(self._seen.quat_wb)
        disc = None
        if self.target and self.obj_w is not None:
            centre_b = R_wb.T @ (self.obj_w + np.array([0, 0, self.half_height]) - self._seen.position_w)
            disc = Disc(centre_b - snapshot.com_b, self.radius)
        demand, lock, bounds = flight_demand(
            memory,
            self.allocator.mode(reference.mode),
            snapshot,
            vectoring,
            wrench,
            lost_thrust=reference.lost_thrust,
            lost_vectoring=reference.lost_vectoring,
            interference_config=self.config.interference,
            lock_config=self.config.lock,
            thrust_limit=self.thrust_limit,
            disc=disc,
        )
        if self.in_qp and (self.grip.force or self.grip.payload):
            F, *_ = self._terms(snapshot, R_wb, self._seen.position_w)
            demand = replace(demand, gravity_torque=demand.gravity_torque + np.einsum("kij,ki->j", self._feet.J, F))
        return demand, lock, bounds


def quintic(s):
    s = min(1, max(0, s))
    return s**3 * (10 - 15 * s + 6 * s * s)


def mission(
    shape="box",
    a=0.3,
    h=0.25,
    mass=1.5,
    mu=0.7,
    n=11.0,
    preset="tuned",
    target=True,
    in_qp=True,
    feed=True,
    pressure=2.0,
    com=(0, 0, 0),
    off=(0, 0),
    zc=None,
    inside=0.0,
    carry_speed=None,
    verbose=False,
    joints_only=False,
    told=None,
    lift=0.7,
    plant=None,
    seconds=None,
):
    config = plant or PlantConfig()
    half = np.array([a, a, h])
    obj = ObjectConfig(shape=shape, half_size=half, mass=mass, friction=mu, pressure=pressure, com=np.array(com, float))
    p = Plant(replace(config, object=obj))
    c = Grasp(controller_config(preset))
    c.target, c.in_qp, c.feed = target, in_qp and not joints_only, feed
    c.radius, c.half_height = a, obj.scale[2]
    model = c.model
    hip = None
    f0 = feet_of(model, np.zeros(16))
    hip_r = math.hypot(*f0[0][:2]) - L1 - L2
    hip = (hip_r, f0[0][2])
    zfoot = -0.86 if a < 0.26 else -0.78
    z_contact = obj.scale[2] if zc is None else zc
    top = 2 * obj.scale[2]
    open_, q_c = claw(a + 0.16 + 0.04, zfoot, hip), claw(a + 0.04, zfoot, hip)
    q_press = claw(a + 0.035, zfoot, hip)
    yaw = math.pi / 4
    quat = np.array([math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)])
    goal_xy = np.array([2.5, 0.0])
    start = np.array([off[0], off[1], z_contact - zfoot + 0.35])
    com_b = model.snapshot(open_, np.eye(3), np.zeros((8, 2))).com_b
    v0 = c.rest_vectoring(open_)
    s = p.reset(
        start.copy(), quat, open_, v0, np.full(8, 20.0), object_pose=np.array([0, 0, obj.scale[2], 1, 0, 0, 0.0])
    )
    c.reset(s, open_)
    T = [
        ("hover", 2.0),
        ("descend", 3.0),
        ("close", 1.5),
        ("press", 0.5),
        ("grip", 1.5),
        ("load", 1.0),
        ("lift", 6.0),
        ("carry", 10.0 if carry_speed is None else 2.5 * 1.9 / carry_speed),
        ("hold", 1.0),
        ("lower", 7.0),
        ("unload", 1.0),
        ("release", 1.5),
        ("raise", 1.0),
        ("open", 3.0),
        ("leave", 3.0),
    ]
    log = dict(foot=[], lam=[], W=[], air=[], z=[], slip=[], fz=[], soft=[])
    base = z_contact - zfoot
    torso = start.copy()
    q_t = open_
    t_all = 0.0
    told = mass if told is None else told
    out = {}
    lost = False
    rel0 = None
    for name, dur in T:
        ticks = round(dur * 40)
        tor0, q0 = torso.copy(), q_t.copy()
        for k in range(ticks):
            u = quintic((k + 1) / ticks)
            if name == "descend":
                torso = tor0 + u * (np.array([off[0], off[1], base]) - tor0)
            if name == "close":
                q_t = q0 + u * (q_c - q0)
            if name == "press":
                q_t = q0 + u * ((q_press if not joints_only else claw(a + 0.04 - inside, zfoot, hip)) - q0)
            if name == "grip" and not joints_only:
                c.grip = replace(c.grip, force=n * (k + 1) / ticks)
            if name == "load":
                c.grip = replace(c.grip, payload=told * (k + 1) / ticks)
            if name == "lift":
                torso = tor0 + u * np.array([0, 0, lift])
            if name == "carry":
                torso = tor0 + u * np.array([2.5, 0, 0])
            if name == "lower":
                torso = tor0 - u * np.array([0, 0, lift])
            if name == "unload":
                c.grip = replace(c.grip, payload=told * (1 - (k + 1) / ticks))
            if name == "release":
                c.grip = replace(c.grip, force=(n if not joints_only else 0) * (1 - (k + 1) / ticks))
            if name == "raise":
                torso = tor0 + u * np.array([0, 0, 0.03])
            if name == "open":
                q_t = q0 + u * (open_ - q0)
            if name == "leave":
                torso = tor0 + u * np.array([0, 0, 0.4])
            o = p.object()
            c.obj_w = o.position_w
            R = quat_to_matrix(s.quat_wb)
            cs = None
            q_cmd = q_t.copy()
            if (
                name in ("grip", "load", "lift", "carry", "hold", "lower", "unload", "release")
                and c.last_step is not None
                and not joints_only
            ):
                q_cmd = q_c + c.last_step.allocation.joint_torques / ROBOT.joint_kp
            com_b = model.snapshot(s.joint_position, np.eye(3), s.vectoring).com_b
            snap = model.snapshot(s.joint_position, R, s.vectoring)
            v = R @ (snap.momentum_map[:3] @ s.joint_velocity) / snap.mass
            ref = Reference(torso + R @ com_b, quat, v, np.zeros(3), q_cmd)
            cmd = c.step(s, ref)
            s = p.step(cmd)
            o = p.object()
            F = np.linalg.norm(o.foot_force_w, axis=1)
            normal = np.array(
                [
                    abs(f[:2] @ np.array([math.cos(yaw + az), math.sin(yaw + az)]))
                    for f, az in zip(o.foot_force_w, [math.pi / 4 + k * math.pi / 2 for k in range(4)])
                ]
            )
            R_ = quat_to_matrix(s.quat_wb)
            out.setdefault(name, []).append(
                [
                    np.linalg.norm(o.foot_force_w[:, :2], axis=1).min(),
                    np.linalg.norm(o.foot_force_w[:, :2], axis=1).max(),
                    s.thrust.sum(),
                    s.thrust.max(),
                    p.power,
                    o.air_force_w[2],
                    o.position_w[2] - obj.scale[2],
                    *(R_.T @ (o.position_w - s.position_w)),
                    np.linalg.norm(s.position_w - torso),
                    p.violated,
                    o.is_hit,
                ]
            )
            if p.diverged or np.linalg.norm(s.position_w - torso) > 1.0:
                lost = True
                break
            if (
                name in ("lift", "carry")
                and np.abs(o.position_w[:2] - s.position_w[:2]).max() > 0.15
                and c.grip.force + c.grip.payload > 0
            ):
                c.grip = Grip()
                lost = True
        if verbose:
            z = np.array(out[name])
            print(
                f"{name:8s} foot min {z[:, 0].min():6.2f} mean {z[:, 0].mean():6.2f} max {z[:, 1].max():6.2f} Σλ {z[:, 2].mean():6.1f} λmax {z[:, 3].max():5.1f} W {z[:, 4].mean():6.0f} air {z[:, 5].mean():7.2f} obj z {z[-1, 6]:.3f} torso err {z[:, 10].max():.3f} hit {z[-1, 12]} viol {int(z[-1, 11])} status",
                flush=True,
            )
        if lost:
            break
    ln = lambda nm, col, f: float(f(np.array(out[nm])[:, col])) if nm in out else float("nan")
    o = p.object()
    return dict(
        lifted=max(ln("lift", 6, np.max), 0),
        off_mm=1e3 * np.linalg.norm(o.position_w - [2.5, 0, obj.scale[2]]),
        foot_min=min(ln("lift", 0, np.min), ln("carry", 0, np.min)),
        lam=ln("carry", 2, np.mean),
        W=ln("carry", 4, np.mean),
        air=ln("press", 5, np.mean),
        err=ln("lift", 10, np.max),
        lost=lost,
        hit=bool(o.is_hit),
    )


if __name__ == "__main__":
    t = time.time()
    r = mission(verbose=True)
    print(r, time.time() - t)
