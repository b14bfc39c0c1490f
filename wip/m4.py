"""Core manager beside the Python manager over a mission, each fed the Python one's states."""

import sys

sys.path.insert(0, "wip")
from m3 import *
from spidar_gym.native.core_manager import CoreManager

obj = ObjectConfig(shape=sys.argv[1] if len(sys.argv) > 1 else "box")
p, m, s, rng = start(obj)
c = CoreManager(ManagerConfig(flight=controller_config("tuned")))
c.reset(s)
cmds = [
    TakeOff(1.5),
    FlyTo((1.5, 0, 1.6)),
    Grasp(obj.shape, obj.half_size),
    CarryTo((3.0, 1.0, 1.0), 0.8),
    Place(0.0),
    Release(),
    FlyTo((5.0, 1.0, 1.6)),
    Land(),
]
m.command(cmds)
c.command(cmds)
t = 0
worst = {}
while t < 120 and not m.done:
    o = p.object()
    seen = Seen(o.position_w + 0.001 * rng.standard_normal(3), o.quat_wo)
    a = m.step(s, seen=seen)
    b = c.step(s, seen=seen)
    t += 0.025
    assert m.phase == c.phase and m.grasp_phase == c.grasp_phase, (t, m.phase, c.phase, m.grasp_phase, c.grasp_phase)
    k = (m.phase, m.grasp_phase)
    d = worst.setdefault(k, [0, 0, 0])
    for i, n in enumerate(("thrust", "vectoring", "joint_position")):
        d[i] = max(d[i], float(np.abs(getattr(a, n) - getattr(b, n)).max()))
    s = p.step(a)
for k, v in worst.items():
    print(k, ["%.1e" % x for x in v])
print(t, m.done, c.done, m.phase, c.phase)
