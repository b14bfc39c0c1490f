import sys

sys.path.insert(0, "/tmp/w")
from gate import mission

rows = [
    ("base 11 N (0.70, 10.4 N, 189 N, 4100 W)", {}),
    ("jets inwards 11 N (no; -39 N closed)", dict(target=False)),
    ("jets inwards, c_p 1.1, 20 N (0.69, 18.9, 237, 5790)", dict(target=False, pressure=1.1, n=20.0)),
    ("jets inwards, no jets on object (0.70, 10.7, 179, 3860)", dict(target=False, pressure=0.0)),
    ("joints only .10 inside 1.5 kg (yes 9.6, 188, 4136)", dict(joints_only=True, inside=0.10)),
    ("joints only 3 kg (no)", dict(joints_only=True, inside=0.10, mass=3.0)),
    ("0.3 kg n 1.5mg/2 (foot 1.8, 175, 3550)", dict(mass=0.3, n=2.2)),
    ("3 kg n 22 (foot 21, 222, 5356)", dict(mass=3.0, n=22.1)),
    ("5 kg n 33 (foot 26, 319, 8820, off 4 mm)", dict(mass=5.0, n=33.0)),
    ("mu .3 (no)", dict(mu=0.3)),
    ("grip 30 N (29, 235, 5876)", dict(n=30.0)),
    ("off 6 cm along a leg (24 mm)", dict(off=(0.06, 0))),
    ("box .8x.8x.6 c(-, yes)", dict(a=0.4, h=0.3)),
    ("box .4, h .2", dict(a=0.2, h=0.2)),
    ("cylinder r .3", dict(shape="cylinder")),
    ("no feed-forward of payload (10.4;189;4100)", dict(feed=False)),
    ("retuned", dict(preset="retuned")),
]
for name, kw in rows:
    r = mission(**kw)
    print(f"{name:60s}", {k: (round(float(v), 2) if not isinstance(v, bool) else v) for k, v in r.items()}, flush=True)
