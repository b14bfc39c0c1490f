import gymnasium, numpy as np
import spidar_gym
from spidar_gym.native.core_manager import CoreManager
a,b=(gymnasium.make("spidar_gym/Grasp-v0",action_mode="order",control=c,hold=1).unwrapped for c in ("core","python"))
oa,_=a.reset(seed=3); ob,_=b.reset(seed=3)
for k in range(3):
    act=np.array([.1,0,0,0,.2,.3]); ra=a.step(act); rb=b.step(act)
    ga=a.controller._manager["grasper"]["grip"]; gb=b.controller.grip
    print(k,"grip",np.array(ga["position_w"])-gb.position_w, float(ga["force"])-gb.force, float(ga["payload"])-gb.payload, float(ga["radius"])-gb.radius, float(ga["top"])-gb.top)
    fa=a.controller.flight; fb=b.controller.flight
    print(" wrench", np.abs(fa.last_step.wrench_desired-fb.last_step.wrench_desired).max(), "tau",np.abs(fa.last_step.allocation.joint_torques-fb.last_step.allocation.joint_torques).max(), "cmd",{n:np.abs(getattr(a.command,n)-getattr(b.command,n)).max() for n in ("thrust","vectoring","joint_position")})
    print(" state", np.abs(a.state.joint_position-b.state.joint_position).max())
    for f in (fa,fb):
        L=f.last_step; print("  ",L.allocation.status,L.allocation.iterations,L.allocation.slack,L.restricted.astype(int), L.allocation.joint_torques.round(3)[:8])
    D=a.controller._manager["flight"]["demand"]; d=fb.last_step.demand
    for n in D.dtype.names:
        if hasattr(d,n):
            x=np.asarray(D[n],float).reshape(-1); y=np.asarray(getattr(d,n),float).reshape(-1)
            if x.shape==y.shape:
                z=np.nan_to_num(x-y); print("   D",n,np.abs(z).max())
