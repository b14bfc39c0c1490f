import sys; sys.path.insert(0,"/tmp/w")
import gate, time
for a,h in ((.2,.2),(.3,.25),(.4,.3)):
    r=gate.mission(a=a,h=h,target=False,n=11.); print(a,h,{k:round(float(v),2) for k,v in r.items()},flush=True)
