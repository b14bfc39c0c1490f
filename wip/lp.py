import math, numpy as np
from reference.holding import grips
from spidar_gym.control.grasp.claw import plan_contact
from spidar_gym.control.grasp.scene import needed_force
from spidar_gym.tasks.grasp import GraspTask
L=np.array([1.,0,0,0]); rng=np.random.default_rng(3)
task=GraspTask(mass=(0.3,6.0),friction=(0.3,0.9),most_force=(15.,45.))
turn=np.array([[1,1,0],[-1,1,0],[0,0,math.sqrt(2)]])/math.sqrt(2)
for k in range(60):
    s=task.draw_scene(rng); n=needed_force(s.mass,s.com,float(s.half_size[0]),s.friction); p=plan_contact(s.shape,s.half_size,L,math.pi/4)
    ok,least=grips(p.closed,p.height,s.mass,turn@s.com,s.friction,s.most_force)
    if not ok: print(k,s.shape,"a %.2f m %.2f mu %.2f limit %.1f need %.1f"%(s.half_size[0],s.mass,s.friction,s.most_force,n), grips(p.closed,p.height,s.mass,turn@s.com,s.friction,60.))
