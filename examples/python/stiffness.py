"""Presses a probe onto a wall over an emulated link, and prints the stiffness that the hand felt."""

import numpy as np

import tactus

wall = tactus.build(tactus.Mesh.generate("wall", faces=8000))  # its upper side is at z = 0.01 m
probe = tactus.Probe(wall, radius=0.003, link="P4", stiffness=800)
height = np.linspace(0.025, -0.005, 3000)  # m, one position each millisecond
rows = probe.run(np.column_stack([np.full(3000, 0.01), np.full(3000, 0.01), height]))
touching = rows[rows["in_contact"] & rows["exact"]]
displacement = np.linalg.norm(touching["proxy"] - touching["position"], axis=1)
force = np.linalg.norm(touching["force"], axis=1)
print(f"{len(touching)} ms of exact contact, stiffness {np.polyfit(displacement, force, 1)[0]:.1f} N/m")
np.savetxt("curve.csv", np.column_stack([displacement, force]), delimiter=",", header="displacement,force")
