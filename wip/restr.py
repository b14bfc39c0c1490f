import sys

sys.path.insert(0, "wip")
import m2
from draw import *
from spidar_gym.sim.randomize import Randomization, randomize

how = Randomization.parse({"world": "calibrated_1"})
import collections

orig = CoreFlightController.step
log = []


def step(self, s, ref, grip=None, **k):
    c = orig(self, s, ref, grip=grip, **k)
    L = self.last_step
    log.append(
        (
            tuple(int(x) for x in L.restricted),
            L.allocation.status,
            float(np.linalg.norm(L.allocation.slack)) if L.allocation.slack is not None else 0,
            c.thrust.max(),
            grip.position_w[2] + grip.top - s.position_w[2],
        )
    )
    return c


m2.CoreFlightController.step = step
k = int(sys.argv[2])
rng = np.random.Generator(np.random.PCG64(10_000 + k))
base, d = randomize(PlantConfig(), rng, how)
if len(sys.argv) > 3:
    base = None
obj, F, need, yaw, yg, way, bias = draw(k)
r = m2.fly(obj, verbose=False, yaw_o=yaw, most=F, way=way, yaw_g=yg, seed=k, bias=bias, base=base, preset=sys.argv[1])
last = None
for i, x in enumerate(log):
    if i > (999 if len(sys.argv) > 3 else 360):
        break
    key = (x[0], x[1])
    if key != last:
        print(f"{i * 0.025:.2f}", x)
        last = key
print(line(r))
