import sys

sys.path.insert(0, "wip")
from draw import *
from spidar_gym.sim.randomize import Randomization, randomize

how = Randomization.parse({"world": "calibrated_1"}) if len(sys.argv) < 5 else None
n0, n1 = int(sys.argv[1]), int(sys.argv[2])
preset = sys.argv[3]
good = 0
for k in range(n0, n1):
    rng = np.random.Generator(np.random.PCG64(10_000 + k))
    base, d = randomize(PlantConfig(), rng, how)
    obj, F, need, r = run(k, base=base, preset=preset)
    good += r["ok"]
    print(
        k,
        "D%.1f" % float(np.mean(base.actuators.joint_kd)),
        obj.shape,
        "a %.2f h %.2f m %.2f mu %.2f F %.0f need %.0f |"
        % (obj.half_size[0], obj.half_size[2], obj.mass, obj.friction, F, need),
        line(r),
        "" if r["ok"] else r["order"][-6:],
        flush=True,
    )
print(preset, good, "of", n1 - n0)
