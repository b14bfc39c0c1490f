import sys, math, time
import numpy as np
from dataclasses import replace

sys.path.insert(0, "wip")
from m2 import *
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.robot import GRAVITY

AMAX = 0.34


def draw(k, mlo=0.3, mhi=6.0, mulo=0.3, muhi=0.9, limit=(15.0, 45.0)):
    r = np.random.Generator(np.random.PCG64(k))
    while True:
        shape = ["box", "cylinder"][int(r.random() < 0.3)]
        a = r.uniform(0.18, AMAX)
        h = r.uniform(0.15, 0.28)
        m = math.exp(r.uniform(math.log(mlo), math.log(mhi)))
        mu = r.uniform(mulo, muhi)
        com = np.array([a, a, h]) * r.uniform(-0.2, 0.2, 3)
        F = r.uniform(*limit)
        need = 1.15 * m * GRAVITY / (4 * mu)
        yaw = r.uniform(-0.8, 0.8)
        yg = r.uniform(-0.8, 0.8)
        ang = r.uniform(-0.6, 0.6)
        d = r.uniform(2, 3)
        if need <= min(F, 33):
            break
    return (
        ObjectConfig(shape=shape, half_size=np.array([a, a, h]), mass=m, friction=mu, com=com),
        F,
        need,
        yaw,
        yg,
        (d * math.cos(ang), d * math.sin(ang), 0),
        r.normal(0, 0.005, 3),
    )


def run(k, base=None, **kw):
    obj, F, need, yaw, yg, way, bias = draw(k)
    r = fly(obj, verbose=False, yaw_o=yaw, most=F, way=way, yaw_g=yg, seed=k, bias=bias, base=base, **kw)
    return obj, F, need, r


if __name__ == "__main__":
    base = None
    n0, n1 = int(sys.argv[1]), int(sys.argv[2])
    kw = {}
    if len(sys.argv) > 3:
        kw["preset"] = sys.argv[3]
    good = 0
    for k in range(n0, n1):
        obj, F, need, r = run(k, **kw)
        good += r["ok"]
        print(
            k,
            obj.shape,
            "a %.2f h %.2f m %.2f mu %.2f F %.0f need %.0f |"
            % (obj.half_size[0], obj.half_size[2], obj.mass, obj.friction, F, need),
            line(r),
            "" if r["ok"] else r["order"][-6:],
            flush=True,
        )
    print(good, "of", n1 - n0)
