import gymnasium, numpy as np, time, sys
import spidar_gym
for mode,sens in (("order",False),("residual",False),("residual",True)):
    a,b=(gymnasium.make("spidar_gym/Grasp-v0",action_mode=mode,control=c,sensors=sens).unwrapped for c in ("core","python"))
    oa,_=a.reset(seed=3); ob,_=b.reset(seed=3); rng=np.random.default_rng(0)
    names=[f.name for f in a.layout for _ in range(f.size)]; last=0
    for k in range(300):
        act=0.1*rng.uniform(-1,1,a.action_space.shape)
        ra=a.step(act); rb=b.step(act); d=np.abs(ra[0]-rb[0])
        if d.max()>max(1e-6,10*last):
            j=int(d.argmax()); print(mode,sens,k,d.max(),names[j],ra[0][j],rb[0][j],ra[4]["grasp_phase"],{n for n,x in zip(names,d) if x>1e-6}); last=d.max()
