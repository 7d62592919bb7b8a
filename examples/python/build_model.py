"""Builds a model, writes it, and checks that the file has the original mesh to the bit."""

import tactus

mesh = tactus.Mesh.generate("organ", faces=50_000)  # or tactus.Mesh.load("bunny.obj")
tactus.build(mesh, size=0.2).save("organ.spm")
model = tactus.Model.open("organ.spm")
print(model)
print(model.verify(mesh))
middle = model.vertices[1000]
near = model.refined_faces(model.regions_near(middle, radius=0.003))
print(f"{len(model.base_faces)} faces in the base mesh, {len(near)} when refined near a vertex, "
      f"{len(model.finest_faces)} in the finest mesh")
