"""compare_regions.py RECORDING MODEL...: compares each region that a recording has completely with the same region of
the .spm file: its list, and the mesh that its records make of the base mesh."""
import sys

from spm_reader import Mesh, Model, numbers
from stream_reader import Recording


def mesh_of(base, records, intervals):
    mesh = Mesh(base)
    for number in numbers(intervals):
        mesh.apply(number, records[number])
    return mesh.positions.tobytes(), mesh.corners, mesh.present, mesh.is_finest, mesh.applied


def main(path, *models):
    recording = Recording(path)
    for model in map(Model, models):
        digest = model.base.digest
        if digest not in recording.bases:
            sys.exit(f'digest {digest:016x}: the recording has no base mesh')
        base = recording.bases[digest]
        if base.data != model.base.data:
            sys.exit('the base meshes differ')
        records = dict(model.read_records())
        delivered = recording.delivered(digest)
        for region, intervals in delivered.items():
            if intervals != model.lists[region]:
                sys.exit(f'region {region}: the lists differ')
            if mesh_of(base, recording.records[digest], intervals) != mesh_of(model.base, records, intervals):
                sys.exit(f'region {region}: the meshes differ')
        print(f'{len(delivered)} of {base.regions} regions are equal')


main(*sys.argv[1:])
