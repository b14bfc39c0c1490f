import gymnasium, numpy as np
import spidar_gym
from spidar_gym.control.grasp.scene import GraspScene
from spidar_gym.control.crawl.pose2 import Pose2
ball = GraspScene(start=Pose2(0.6, 0.1, 0.2), goal=Pose2(1.6, 0.0, 0.4), mass=1.2, stand=0.3, floor=0.2)
env=gymnasium.make("spidar_gym/Grasp-v0",scene=ball).unwrapped
env.reset(seed=0); last=None
for k in range(3000):
    o,r,te,tr,i=env.step(np.zeros(35))
    if i["grasp_phase"]!=last: last=i["grasp_phase"]; print(round(k*.025,1),last,env.plant.object().position_w.round(3),env.plant.object().velocity_w.round(3),i["failure"])
    if te: break
print(k,i["failure"],i["lost"],i["refused"],i["tries"],env.plant.object(),env.plant.violated)
