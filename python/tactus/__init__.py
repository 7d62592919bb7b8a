"""Tactus for Python: models, local refinement, probes, recordings and sessions as NumPy arrays.

docs/tutorials/first-script.md is a first program, docs/reference/python.md lists everything.
"""

from tactus._tactus import (
    LinkError,
    LocalRefinement,
    McapError,
    Mesh,
    Model,
    ModelError,
    Probe,
    Recording,
    ScenarioError,
    SchemaError,
    Session,
    Study,
    StudyResult,
    Summary,
    WireError,
    YamlError,
    build,
    id_of,
)

__all__ = [
    "LinkError",
    "LocalRefinement",
    "McapError",
    "Mesh",
    "Model",
    "ModelError",
    "Probe",
    "Recording",
    "ScenarioError",
    "SchemaError",
    "Session",
    "Study",
    "StudyResult",
    "Summary",
    "WireError",
    "YamlError",
    "build",
    "id_of",
]
