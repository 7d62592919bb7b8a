"""Tactus for Python: models, local refinement, probes, recordings and sessions as NumPy arrays.

docs/tutorials/first-script.md is a first program, docs/reference/python.md lists everything.
"""

from tactus._tactus import LocalRefinement, Mesh, Model, ModelError, Summary, build

__all__ = ["LocalRefinement", "Mesh", "Model", "ModelError", "Summary", "build"]
