import gymnasium, numpy as np, sys
import spidar_gym
from PIL import Image
env=gymnasium.make("spidar_gym/Grasp-v0",render_mode="rgb_array",camera="side" if len(sys.argv)<2 else sys.argv[1],width=640,height=480)
env.reset(seed=2); want={"down":0,"grip":0,"carry":100,"open":20}; shots=[]
for k in range(2600):
    o,r,te,tr,i=env.step(np.zeros(35)); g=i["grasp_phase"]
    if g in want:
        want[g]-=1
        if want[g]<0: shots.append(env.render()); del want[g]
    if te or tr or not want: break
Image.fromarray(np.vstack([np.hstack(shots[:2]),np.hstack(shots[2:4])])).save("/tmp/w/l49/grasp.png")
