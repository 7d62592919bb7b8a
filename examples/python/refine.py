"""Moves a sphere into a model, and prints how much of the mesh is refined."""

import numpy as np

import tactus

model = tactus.build(tactus.Mesh.generate("organ", faces=50_000))
refinement = tactus.LocalRefinement(model, radius=0.003, memory=16 << 20)
path = np.linspace(1.5, 1.0, 500)[:, None] * model.vertices[1000]
rows = refinement.follow(path)
touching = rows[rows["contacts"] > 0]
print(f"{len(touching)} contact cycles, {touching['exact'].sum()} of them exact, depth {rows['depth'][-1]:.4f} m")
contacts, first = refinement.find_contacts(path[-10:])
print(f"{np.diff(first)} contacts at the last positions, nearest: {refinement.nearest(path[-1:], 0.01)}")
