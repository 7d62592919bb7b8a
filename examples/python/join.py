"""Joins a session, presses onto an object from above, and plots force over displacement: join.py SESSION [DOMAIN]"""

import sys

import numpy as np

import tactus

with tactus.Session(sys.argv[1], domain=int(sys.argv[2]) if len(sys.argv) > 2 else 20) as session:
    hrtcs = lambda: [name for name, one in session.participants.items() if one["role"] == "hrtc"]
    session.wait(lambda: session.objects and hrtcs())
    name, thing = next(iter(session.objects.items()))
    session.join("zoe", hrtcs()[0])
    low, high = thing["scale"] * thing["bounds"] + thing["position"]
    path = np.tile((low + high) / 2, (3000, 1))
    path[:, 2] = high[2] + np.linspace(0.02, -0.02, 3000)  # m, one position each millisecond
    states = session.drive("zoe", path)

touching = states[states["in_contact"] & states["exact"]]
displacement = np.linalg.norm(touching["proxy"] - touching["position"], axis=1)
force = np.linalg.norm(touching["force"], axis=1)
slope = np.polyfit(displacement, force, 1)[0]
print(f"{len(touching)} states on {name}, stiffness {slope:.1f} N/m, material {thing['stiffness']:.1f} N/m")
try:
    import matplotlib.pyplot as plt
    plt.plot(1e3 * displacement, force, ".")
    plt.savefig("touch.png")
except ImportError:
    print("no plot: Debian's package python3-matplotlib is missing")
