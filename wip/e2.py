import gymnasium, numpy as np, time, sys
import spidar_gym
from gymnasium.utils.env_checker import check_env
for mode in ("residual","order","torso_forces","direct"):
    a,b=(gymnasium.make("spidar_gym/Grasp-v0",action_mode=mode,control=c,sensors=True) for c in ("core","python"))
    oa,_=a.reset(seed=3); ob,_=b.reset(seed=3); rng=np.random.default_rng(0)
    worst=np.abs(oa-ob).max(); n=0; wt=0
    steps=2200 if mode=="residual" else 60
    for k in range(steps):
        act=0.1*rng.uniform(-1,1,a.action_space.shape)
        ra=a.step(act); rb=b.step(act); n+=1
        worst=max(worst,np.abs(ra[0]-rb[0]).max()); wt=max(wt,np.abs(a.unwrapped.command.thrust-b.unwrapped.command.thrust).max())
        if ra[2] or ra[3] or rb[2]: print(k,ra[2:4],rb[2:4],ra[4]["failure"]); break
    print(mode,n,"obs",worst,"thrust",wt, ra[4]["grasp_phase"], rb[4]["grasp_phase"])
