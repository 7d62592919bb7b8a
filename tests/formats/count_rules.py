"""count_rules.py MODEL...: counts how often .spm files need the rules of docs/reference/spm-format.md that most meshes
do not need. Fails if no file needs a rule."""
import collections
import sys

import spm_reader

counts = collections.Counter()
rules = ('one born face at the first end', 'one born face at the last end', 'code deformed', 'several parts',
         'more than two parts', 'no deformed face', 'deformed faces only in a further part', 'third corner by id',
         *(f'order {order}' for order in range(2)), 'more than 32 deformed faces', 'more than 4 born faces',
         'a link that the limit of 32 prevents',
         'a link that the limit of 4 prevents', 'full ring', 'radius symbol 255', 'limited coordinate, lossless',
         'limited coordinate, compact')


class Base(spm_reader.Base):
    def encode(self, axis, coordinate):
        profile = 'compact' if self.step else 'lossless'
        inside = self.bounds_min[axis] <= coordinate <= self.bounds_max[axis]
        counts[f'limited coordinate, {profile}'] += not inside
        return super().encode(axis, coordinate)


class RecordReader(spm_reader.RecordReader):
    def read(self, record, begins_interval):
        result = super().read(record, begins_interval)
        counts['radius symbol 255'] += 0 < result.radius <= self.base.max_radius - 254
        deformed, born = (sum(len(part[i]) for part in result.parts) for i in range(2))
        counts['several parts'] += len(result.parts) > 1
        counts['more than two parts'] += len(result.parts) > 2
        counts['no deformed face'] += deformed == 0
        counts['deformed faces only in a further part'] += deformed > 0 and not result.parts[0][0]
        counts['more than 32 deformed faces'] += deformed > 32
        counts['more than 4 born faces'] += born > 4
        return result

    def usual_faces(self, result, shape, inner):
        counts['one born face at the first end'] += 504 <= shape < 756
        counts['one born face at the last end'] += 756 <= shape
        super().usual_faces(result, shape, inner)

    def explicit_faces(self, result, u, inner):
        super().explicit_faces(result, u, inner)
        for _, born in result.parts:
            for _, order, _, kind, _ in born:
                counts[f'order {order}'] += 1
                counts['third corner by id'] += kind == spm_reader.BY_ID

    def face_after(self, field, face):
        counts[f'code {field}'] += 1
        return super().face_after(field, face)


checksum_of = spm_reader.checksum_of


def counting_checksum_of(u, ring):
    counts['full ring'] += len(ring) == 64
    return checksum_of(u, ring)


spm_reader.Base, spm_reader.RecordReader, spm_reader.checksum_of = Base, RecordReader, counting_checksum_of


def needs(limit):
    """Whether a file cannot be decoded without a limit of the links."""
    value = getattr(spm_reader, limit)
    setattr(spm_reader, limit, sys.maxsize)
    try:
        spm_reader.Model(path)
    except spm_reader.FormatError:
        return True
    finally:
        setattr(spm_reader, limit, value)
    return False


for path in sys.argv[1:]:
    many_deformed, many_born = counts['more than 32 deformed faces'], counts['more than 4 born faces']
    spm_reader.Model(path)
    many_deformed, many_born = (counts['more than 32 deformed faces'] > many_deformed,
                                counts['more than 4 born faces'] > many_born)
    counts['a link that the limit of 32 prevents'] += many_deformed and needs('MAX_LINKED_DEFORMED')
    counts['a link that the limit of 4 prevents'] += many_born and needs('MAX_LINKED_BORN')
for rule in rules:
    print(f'{counts[rule]:6} {rule}')
if missing := [rule for rule in rules if not counts[rule]]:
    sys.exit(f'no model needs these rules: {missing}')
