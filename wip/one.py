import sys

sys.path.insert(0, "wip")
from draw import *
from spidar_gym.sim.randomize import Randomization, randomize

how = Randomization.parse({"world": "calibrated_1"})
for k in map(int, sys.argv[2:]):
    rng = np.random.Generator(np.random.PCG64(10_000 + k))
    base, d = randomize(PlantConfig(), rng, how)
    obj, F, need, yaw, yg, way, bias = draw(k)
    print(k, obj)
    print(
        line(
            fly(
                obj,
                verbose=True,
                yaw_o=yaw,
                most=F,
                way=way,
                yaw_g=yg,
                seed=k,
                bias=bias,
                base=base,
                preset=sys.argv[1],
            )
        )
    )
