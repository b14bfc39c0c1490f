import gymnasium, numpy as np, time, sys
import spidar_gym
for mode in ("residual","order","torso_forces"):
    env=gymnasium.make("spidar_gym/Grasp-v0",action_mode=mode)
    o,i=env.reset(seed=0); print(mode,o.shape,env.unwrapped.scene)
    t=time.time(); R=0; ph=[]
    for k in range(5000):
        o,r,te,tr,i=env.step(np.zeros(env.action_space.shape)); R+=r
        if not ph or ph[-1]!=(i["phase"],i["grasp_phase"]): ph.append((i["phase"],i["grasp_phase"]))
        if te or tr: break
    print(k,R,te,tr,i["failure"],i["is_success"],i["time_s"],i["way_m"],i["most_force_n"],time.time()-t); print(ph)
