"""Tactus for Python: models, local refinement, probes, recordings and sessions as NumPy arrays.

docs/tutorials/first-script.md is a first program, docs/reference/python.md lists everything.
"""

from tactus._tactus import LinkError, LocalRefinement, Mesh, Model, ModelError, Probe, Summary, build

__all__ = ["LinkError", "LocalRefinement", "Mesh", "Model", "ModelError", "Probe", "Summary", "build"]
