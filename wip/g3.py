import sys

sys.path.insert(0, "/tmp/w")
import gate, time

for a, h in ((0.2, 0.2), (0.3, 0.25), (0.4, 0.3)):
    r = gate.mission(a=a, h=h, target=False, n=11.0)
    print(a, h, {k: round(float(v), 2) for k, v in r.items()}, flush=True)
