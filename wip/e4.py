import gymnasium, numpy as np
import spidar_gym
a,b=(gymnasium.make("spidar_gym/Grasp-v0",action_mode="order",control=c,hold=1).unwrapped for c in ("core","python"))
oa,_=a.reset(seed=3); ob,_=b.reset(seed=3)
for k in range(3):
    act=np.array([.1,0,0,0,.2,.3]); ra=a.step(act); rb=b.step(act)
    g=a.controller._manager["grasper"]["memory"]; m=b.controller.grasper.memory
    print(k, np.abs(ra[0]-rb[0]).max())
    for n in ("begin","end"):
        s=getattr(m,n); print(n, np.abs(np.array(g[n]["pose_w"])-s.pose_w).max(), np.abs(np.array(g[n]["form"])-s.form).max(), float(g[n]["force"])-s.force)
    r=a.controller._manager["reference"]; 
    print(g["time"],m.time,g["seconds"],m.seconds, np.array(r["position_w"]), np.array(r["velocity_w"]),np.array(r["joint_target"])[:4], g["end"]["form"][:4], m.end.form[:4])
