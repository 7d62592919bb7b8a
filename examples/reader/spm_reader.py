#!/usr/bin/env python3
"""Decodes an .spm file to the finest mesh, with the standard library of Python alone.

docs/reference/spm-format.md describes the format. This program uses no code of Tactus.

    python3 spm_reader.py MODEL.spm [OUT.ply]
"""
import array
import struct
import sys

from xxh3 import MASK32, MASK64, u32, xxh3

NONE = 0xFFFFFFFF
BLOCK = 65536  # bytes of codes or lists with a checksum of their own


class FormatError(Exception):
    """The bytes are damaged, or of another version."""


def require(condition, text):
    if not condition:
        raise FormatError(text)


# ---- bytes and bits


def unzigzag(value):
    return value >> 1 ^ -(value & 1)


class ByteReader:
    """Reads raw values and varints."""
    order = '<'

    def __init__(self, data):
        self.data, self.at = data, 0

    def raw(self, form):
        form = self.order + form
        size = struct.calcsize(form)
        require(len(self.data) - self.at >= size, 'truncated')
        values = struct.unpack_from(form, self.data, self.at)
        self.at += size
        return values if len(values) > 1 else values[0]

    def varint(self):
        value = shift = 0
        while True:
            byte = self.raw('B')
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
            shift += 7
            require(shift < 64, 'found a varint of more than ten bytes')

    def take(self, size):
        require(0 <= size <= len(self.data) - self.at, 'truncated')
        self.at += size
        return self.data[self.at - size:self.at]


class BitReader:
    """Reads bits, the lowest bit of each byte first."""

    def __init__(self, data):
        self.data, self.at, self.end = bytes(data) + bytes(8), 0, 8 * len(data)

    def get(self, count):
        byte = self.at >> 3
        value = int.from_bytes(self.data[byte:byte + 8], 'little') >> (self.at & 7) & (1 << count) - 1
        self.at += count
        require(self.at <= self.end, 'truncated bits')
        return value

    def length_prefixed(self):
        return self.get(min(self.get(6), 56))


class PrefixCode:
    """A canonical prefix code: a list from the next bits to (symbol, length)."""

    def __init__(self, bits, symbols):
        lengths = []
        while len(lengths) < symbols:
            lengths.append(bits.get(4))
            if lengths[-1] == 0:
                lengths += [0] * bits.get(4)
        longest = max(lengths)
        require(len(lengths) == symbols and longest <= 11, 'found no prefix code')
        self.mask, self.table = (1 << longest) - 1, [None] * (1 << longest)
        word = 0  # the first bit of a word is the highest bit of this number
        for length in range(1, longest + 1):
            word <<= 1
            for symbol in range(symbols):
                if lengths[symbol] != length:
                    continue
                require(word >> length == 0, 'found no prefix code')
                first = int(f'{word:0{length}b}'[::-1], 2)
                for entry in range(first, 1 << longest, 1 << length):
                    self.table[entry] = (symbol, length)
                word += 1

    def symbol(self, bits):
        byte = bits.at >> 3
        window = int.from_bytes(bits.data[byte:byte + 3], 'little') >> (bits.at & 7)
        entry = self.table[window & self.mask]
        require(entry is not None, 'found bits that are no word of a prefix code')
        bits.at += entry[1]
        require(bits.at <= bits.end, 'truncated bits')
        return entry[0]

    def number(self, bits):
        return finish_number(bits, self.symbol(bits))


def finish_number(bits, symbol):
    if symbol < 16:
        return symbol
    low_bits = (symbol - 16) // 2 + 3
    return (2 | symbol & 1) << low_bits | bits.get(low_bits)


# ---- base mesh

COUNTS = ('vertices', 'faces', 'base_vertices', 'base_faces', 'records', 'parts', 'regions', 'max_level')
FIELDS = {'radius': 256, 'corner': 3, 'anchor': 106, 'anchor_first': 74, 'deformed': 74, 'interval_distance': 74,
          'interval_length': 74, 'shape': 1009, 'shape_inner': 1009, 'born_first': 74, 'born_first_inner': 74,
          'born_next': 74, 'born_next_inner': 74, 'tangential': 74, 'tangential_inner': 74, 'normal': 74,
          'normal_inner': 74}


class Base:
    """A base mesh message: summary, base mesh, and prefix codes."""

    def __init__(self, data):
        self.data = bytes(data)
        reader = ByteReader(self.data)
        version = reader.raw('B')
        require(version == 8, f'base mesh: found encoding version {version}, expected 8')
        self.digest = reader.raw('Q')
        for name in COUNTS:
            setattr(self, name, reader.varint())
        require(self.base_vertices + self.base_faces <= len(data), 'base mesh: its counts are too large')
        require(self.faces < 1 << 30, 'base mesh: it has too many faces')
        self.bounds_min, self.bounds_max, self.grid = reader.raw('3f'), reader.raw('3f'), reader.raw('4d')
        self.metres_per_unit, self.deviation, self.step = reader.raw('3d')
        require(self.vertices == self.base_vertices + self.records, 'base mesh: its counts do not fit')
        deviation = struct.pack('<f', self.deviation)
        self.max_radius = u32(deviation, 0) >> 19
        require(struct.unpack('<f', deviation)[0] == self.deviation and u32(deviation, 0) & 0x7FFFF == 0 and
                self.max_radius < 0xFF0, 'base mesh: its deviation is no radius')

        self.positions = array.array('f')
        codes = [0, 0, 0]
        for _ in range(self.base_vertices):
            if self.step == 0:
                self.positions.extend(reader.raw('3f'))
                continue
            for axis in range(3):
                codes[axis] = codes[axis] + unzigzag(reader.varint()) & MASK32
                self.positions.append(self.decode(axis, codes[axis]))
        self.radii = [reader.raw('H') for _ in range(self.base_vertices)]
        require(max(self.radii, default=0) <= self.max_radius, 'base mesh: a radius is above the deviation')
        self.base = []  # (face, is finest, three corners)
        face = corner = 0
        for _ in range(self.base_faces):
            code = reader.varint()
            face += unzigzag(code >> 1)
            corners = []
            for _ in range(3):
                corner += unzigzag(reader.varint())
                corners.append(corner)
            require(0 <= face < self.faces and all(0 <= c < self.base_vertices for c in corners), 'base mesh: bad face')
            self.base.append((face, code & 1, corners))
        bits = BitReader(reader.take(reader.varint()))
        self.codes = {name: PrefixCode(bits, symbols) for name, symbols in FIELDS.items()}
        require(reader.at == len(self.data), 'base mesh: found bytes after its end')

    # Position codes (spm-format.md, "Position codes").
    def encode(self, axis, coordinate):
        coordinate = min(max(coordinate, self.bounds_min[axis]), self.bounds_max[axis])
        if self.step > 0:
            return int((coordinate - self.bounds_min[axis]) / self.step + 0.5)
        bits = u32(struct.pack('<f', coordinate), 0)
        return bits ^ MASK32 if bits >> 31 else bits | 1 << 31

    def decode(self, axis, code):
        if self.step > 0:
            return struct.unpack('<f', struct.pack('<f', self.bounds_min[axis] + code * self.step))[0]
        bits = code ^ 1 << 31 if code >> 31 else code ^ MASK32
        return struct.unpack('<f', struct.pack('<I', bits))[0]


# ---- records

SWING = -1  # instead of a deformed face: the next face around the parent
IN_RING, BY_ID, LAST_IN_RING = 0, 1, -1
MAX_LINKED_DEFORMED, MAX_LINKED_BORN = 32, 4  # a record with more faces links none of its born faces


class Record:
    """A decoded code. A part is (deformed, born). A deformed face is (face or SWING, corner or None, is finest), a born
    face (face, order, is finest, IN_RING or BY_ID, position or id of the third corner)."""
    __slots__ = ('radius', 'parent', 'parts', 'residuals')


def first_shape(deformed):
    return (1 << (deformed + 1)) - 4


class RecordReader:
    """Reads the codes of records. Needs the mesh for nothing: the codes name faces by id or by rules."""

    def __init__(self, base, bits):
        self.base, self.bits, self.anchor, self.recent = base, bits, 0, []

    def read(self, record, begins_interval):
        codes, bits, recent = self.base.codes, self.bits, self.recent
        if begins_interval:
            recent.clear()
            self.anchor += unzigzag(codes['anchor_first'].number(bits))
        else:
            symbol = codes['anchor'].symbol(bits)
            if symbol < 32:
                require(symbol < len(recent), 'an anchor refers to no recent face')
                self.anchor = recent[-1 - symbol]
            else:
                self.anchor += unzigzag(finish_number(bits, symbol - 32))
        require(0 <= self.anchor < self.base.faces, 'an anchor is no face of the model')

        result = Record()
        below = codes['radius'].symbol(bits)
        if below == 255:
            below = bits.length_prefixed()
        require(below <= self.base.max_radius, 'a radius is above the deviation')
        result.radius = 0 if below == 0 else self.base.max_radius + 1 - below
        inner = '_inner' if result.radius else ''
        result.parent = None
        shape = codes['shape' + inner].symbol(bits)
        if shape == 1008:
            self.explicit_faces(result, self.base.base_vertices + record, inner)
        else:
            self.usual_faces(result, shape, inner)
        recent.append(self.anchor)
        recent.extend(face[0] for face in reversed(result.parts[0][1]))
        tangential, normal = codes['tangential' + inner], codes['normal' + inner]
        result.residuals = (unzigzag(tangential.number(bits)), unzigzag(tangential.number(bits)),
                            unzigzag(normal.number(bits)))
        return result

    def face_after(self, field, face):
        face += unzigzag(self.base.codes[field].number(self.bits))
        require(0 <= face < self.base.faces, 'a face is no face of the model')
        return face

    def usual_faces(self, result, shape, inner):
        if shape < 504:
            ends, scale, flags = (0, 1), 2, shape
        else:
            ends, scale, flags = ((0,), 1, shape - 504) if shape < 756 else ((1,), 1, shape - 756)
        deformed = 1
        while scale * first_shape(deformed + 1) <= flags:
            deformed += 1
        flags -= scale * first_shape(deformed)
        corner = self.base.codes['corner'].symbol(self.bits)
        born, face = [], self.anchor
        for i, end in enumerate(ends):
            face = self.face_after(('born_first', 'born_next')[i] + inner, face)
            born.append((face, end, flags & 1, IN_RING, LAST_IN_RING if end else 1))
            flags >>= 1
        fan = [(SWING if i else self.anchor, None if i else corner, flags >> i & 1) for i in range(deformed)]
        result.parts = [(fan, born)]

    def explicit_faces(self, result, u, inner):
        bits, result.parts = self.bits, []
        face = None  # the last face that the code has named
        any_deformed = False
        more = 1
        while more:
            born_count, deformed_count, more = bits.get(2), bits.get(4), bits.get(1)
            require(born_count <= 2 and 0 < born_count + deformed_count and deformed_count <= 9, 'a part has bad counts')
            corner = None
            if not result.parts and deformed_count:
                corner = bits.get(2)
            elif not result.parts:
                result.parent = u - bits.length_prefixed()
                require(0 <= result.parent < u, 'a parent is no earlier vertex')
            deformed, born = [], []
            for _ in range(deformed_count):
                swings = any_deformed and bits.get(1)
                if not swings:
                    face = self.anchor if face is None else self.face_after('deformed', face)
                deformed.append((SWING if swings else face, corner, bits.get(1)))
                corner, any_deformed = None, True
            for _ in range(born_count):
                face = self.anchor if face is None else self.face_after('born_next' + inner, face)
                is_finest, order, in_ring, x = bits.get(1), bits.get(1), bits.get(1), bits.length_prefixed()
                require(x < 64 if in_ring else 0 < x <= u, 'a born face has a bad corner')
                born.append((face, order, is_finest, IN_RING if in_ring else BY_ID, x if in_ring else u - x))
            result.parts.append((deformed, born))


def read_intervals(base, bits, limit):
    """Returns ascending (first, count) below `limit`."""
    intervals, end = [], 0
    for _ in range(bits.length_prefixed()):
        first = end + base.codes['interval_distance'].number(bits)
        count = base.codes['interval_length'].number(bits) + 1
        require((first > end or end == 0) and first + count <= limit, 'an interval is out of order')
        intervals.append((first, count))
        end = first + count
    return intervals


def numbers(intervals):
    return [number for first, count in intervals for number in range(first, first + count)]


# ---- mesh


class Mesh:
    """The mesh after the records applied so far: positions by vertex id, and a corner table.

    Corner c of face f has the index 3 f + c. `opposite` has the corner across the edge opposite to a corner, or -1.
    `applied` has the content of each applied record: parent, radius code, parts, checksum, level.
    `changed_by` has for each face the last record that bore or deformed it, or -1.
    """

    def __init__(self, base):
        self.base = base
        self.positions = array.array('f', base.positions)
        self.positions.extend(array.array('f', bytes(12)) * base.records)
        self.corners = array.array('i', [-1]) * (3 * base.faces)
        self.opposite = array.array('q', [-1]) * (3 * base.faces)
        self.present = bytearray(b'\1') * base.base_vertices + bytearray(base.records)
        self.is_finest = bytearray(base.faces)
        self.changed_by = array.array('i', [-1]) * base.faces
        self.applied = {}
        edges = {}
        for face, is_finest, corners in base.base:
            require(self.corners[3 * face] < 0, 'a base face has the id of another')
            self.is_finest[face] = is_finest
            for c in range(3):
                self.corners[3 * face + c] = corners[c]
                a, b = corners[(c + 1) % 3], corners[(c + 2) % 3]
                edges.setdefault((min(a, b), max(a, b)), []).append((3 * face + c, a < b))
        for sides in edges.values():
            if len(sides) == 2 and sides[0][1] != sides[1][1]:
                self.link(sides[0][0], sides[1][0])

    def link(self, a, b):
        if a >= 0:
            self.opposite[a] = b
        if b >= 0:
            self.opposite[b] = a

    def apply(self, number, record):
        """Applies a record. All records on which it depends must have been applied."""
        base, corners, opposite = self.base, self.corners, self.opposite
        u = base.base_vertices + number
        require(not self.present[u], f'record {number} is applied already')
        t = record.parent
        ring = [] if t is None else [t]
        all_deformed, all_born, stored = [], [], []
        at = -1  # the corner of the parent in the last deformed face
        around, changed = set(), set()  # vertices around u, and the records that last changed the deformed faces
        for deformed, born in record.parts:
            stored_deformed, stored_born = [], []
            for face, corner, is_finest in deformed:
                if face == SWING:
                    at = opposite[at + 1 if at % 3 < 2 else at - 2] if at >= 0 else -1
                    require(at >= 0, f'record {number}: no face follows around its parent')
                    face = at // 3
                first = 3 * face
                require(corners[first] >= 0, f'record {number} deforms a face that does not exist')
                if corner is None:
                    require(t in corners[first:first + 3], f'record {number} deforms a face without its parent')
                    corner = corners[first:first + 3].index(t)
                elif t is None:
                    t = corners[first + corner]
                    ring.append(t)
                at = first + corner
                others = corners[first + (corner + 1) % 3], corners[first + (corner + 2) % 3]
                require(u not in others, f'record {number} deforms a face twice')
                require(not self.is_finest[face], f'record {number} deforms a face after its finest version')
                around.update(others)
                changed.add(self.changed_by[face])
                self.changed_by[face] = number
                for other in others:
                    if other not in ring and len(ring) < 64:
                        ring.append(other)
                corners[at] = u
                self.is_finest[face] = is_finest
                all_deformed.append(at)
                stored_deformed.append((face << 2 | corner, is_finest))
            require(t is not None and self.present[t], f'record {number} has no parent')
            for face, order, is_finest, kind, x in born:
                if kind == IN_RING:
                    require(x < len(ring) and len(ring) > 1, f'record {number} refers to no vertex of its ring')
                    x = ring[x]
                elif x not in ring and len(ring) < 64:
                    ring.append(x)
                require(self.present[x] and x != t, f'record {number} has a bad third corner')
                require(corners[3 * face] < 0, f'record {number} bears a face that exists')
                corners[3 * face:3 * face + 3] = array.array('i', (u, x, t) if order else (u, t, x))
                self.is_finest[face], self.changed_by[face] = is_finest, number
                around.add(x)
                all_born.append((3 * face, 3 * face + 1 + order, 3 * face + 2 - order, order == 0))
                stored_born.append((face << 2 | order << 1 | is_finest, x))
            if not stored:
                self.place(u, ring, record.residuals)
            stored.append((stored_born, stored_deformed))
        self.link_split(all_deformed, all_born)
        self.present[u] = 1
        around.add(t)
        needed = changed | {v - base.base_vertices for v in around if v >= base.base_vertices}
        level = 1 + max((self.applied[i][4] for i in needed if i >= 0), default=0)
        self.applied[number] = (t, record.radius, stored, checksum_of(u, ring), level)

    def link_split(self, deformed, born):
        if len(deformed) > MAX_LINKED_DEFORMED or len(born) > MAX_LINKED_BORN:
            return
        corners, opposite = self.corners, self.opposite
        for at_u, at_t, at_x, t_follows_u in born:
            x, sides = corners[at_x], []
            for d in deformed:
                following = d + 1 if d % 3 < 2 else d - 2
                preceding = d - 1 if d % 3 else d + 2
                if corners[following if t_follows_u else preceding] == x:
                    sides.append(preceding if t_follows_u else following)
            if len(sides) == 1:
                self.link(at_u, opposite[sides[0]])
                self.link(at_t, sides[0])
        if len(born) == 2 and born[0][3] != born[1][3]:
            self.link(born[0][2], born[1][2])

    def place(self, u, ring, residuals):
        """Computes the position of u. The order of the operations is part of the format."""
        base, p = self.base, self.positions
        tx, ty, tz = p[3 * ring[0]:3 * ring[0] + 3]
        first = before = (0.0, 0.0, 0.0)
        sx = sy = sz = nx = ny = nz = 0.0
        for v in ring[1:]:
            x, y, z = p[3 * v] - tx, p[3 * v + 1] - ty, p[3 * v + 2] - tz
            bx, by, bz = before
            before = (x, y, z)
            if v == ring[1]:
                first = before
            sx, sy, sz = sx + x, sy + y, sz + z
            nx, ny, nz = nx + (by * z - bz * y), ny + (bz * x - bx * z), nz + (bx * y - by * x)
        t, total, normal, count = (tx, ty, tz), (sx, sy, sz), (nx, ny, nz), len(ring)
        expected, third = [0.0, 0.0, 0.0], 0
        for k in range(3):
            mean = total[k] / count
            expected[k] = t[k] + (mean - 0.25 * mean - 0.14 * ((first[k] + before[k]) / 2 - mean))
            if abs(normal[k]) > abs(normal[third]):
                third = k
        a, b = (third + 1) % 3, (third + 2) % 3
        slope = [-n / normal[third] if normal[third] != 0 else 0.0 for n in normal]
        for axis, residual in ((a, residuals[0]), (b, residuals[1]), (third, residuals[2])):
            predicted = expected[axis]
            if axis == third:
                predicted = (predicted + slope[a] * (p[3 * u + a] - expected[a]) +
                             slope[b] * (p[3 * u + b] - expected[b]))
            value = base.decode(axis, base.encode(axis, predicted) + residual & MASK32)
            require(base.bounds_min[axis] <= value <= base.bounds_max[axis], 'a position is out of the bounds')
            p[3 * u + axis] = value

    def checksum(self, intervals):
        return sum(self.applied[number][3] for number in numbers(intervals)) & MASK32

    def __str__(self):
        return f'{sum(self.present)} vertices, {len(self.triangles())} faces'

    def triangles(self):
        return [tuple(self.corners[i:i + 3]) for i in range(0, len(self.corners), 3) if self.corners[i] >= 0]

    def write_ply(self, path):
        """Writes the mesh with its vertices by id and its faces by id. Vertices and faces that do not exist are left
        out."""
        number = array.array('i', [-1]) * len(self.present)
        vertices = [v for v in range(len(self.present)) if self.present[v]]
        for i, v in enumerate(vertices):
            number[v] = i
        triangles = self.triangles()
        with open(path, 'wb') as file:
            file.write(b'ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\n'
                       b'property float y\nproperty float z\nelement face %d\n'
                       b'property list uchar int vertex_indices\nend_header\n' % (len(vertices), len(triangles)))
            file.write(b''.join(struct.pack('<3f', *self.positions[3 * v:3 * v + 3]) for v in vertices))
            file.write(b''.join(struct.pack('<B3i', 3, *(number[v] for v in corners)) for corners in triangles))


def checksum_of(u, ring):
    total = 0
    for v in ring:
        pair = u << 32 | v
        total += (pair ^ pair >> 29) * 0x9E3779B97F4A7C15
    return (total & MASK64) >> 32


# ---- regions

def read_regions(reader, count, origin=(0, 0, 0)):
    """Reads regions without their lists: (x, y, z, depth, occupied, records, parts, faces, checksum) of each.

    `origin` is the cell of depth 0 to which the cells are relative.
    """
    require(count * 19 <= len(reader.data) - reader.at, 'regions: they do not fit')
    regions = []
    for _ in range(count):
        x, y, z, depth = (reader.varint() for _ in range(4))
        require(depth <= 8, 'regions: bad depth')
        cell = [c + (first << depth) for c, first in zip((x, y, z), origin)]
        require(max(cell) <= 0xFFFF, 'regions: bad cell')
        occupied, records = reader.raw('Q'), reader.varint()
        parts = records + reader.varint()
        regions.append((*cell, depth, occupied, records, parts, reader.varint(), reader.raw('I')))
    return regions


# ---- .spm files


class Model:
    """A decoded .spm file: `base`, `lists` (intervals by region), `mesh` (the finest mesh) and `statistics` (JSON)."""

    def __init__(self, path):
        with open(path, 'rb') as file:
            data = file.read()
        self.sections = read_sections(data)
        self.statistics = bytes(self.sections[5]).decode()
        base = self.base = Base(self.sections[0])
        reader = ByteReader(self.sections[1])
        self.regions = read_regions(reader, base.regions)
        require(reader.at == len(reader.data), 'regions: found bytes after the last region')
        require(base.records <= base.parts <= len(self.sections[2]) and base.faces <= base.base_faces + 2 * base.parts,
                'the counts are too large for the codes')
        sizes = ByteReader(self.sections[4])
        self.block_bits = [sizes.varint() for _ in range((base.records + 127) // 128)]
        list_bits = [sizes.varint() for _ in range(base.regions)]
        require(sizes.at == len(sizes.data), 'sizes: found bytes after the last size')
        self.mesh = Mesh(base)
        for number, record in self.read_records():
            self.mesh.apply(number, record)
        applied = self.mesh.applied
        require(sum(len(record[2]) for record in applied.values()) == base.parts, 'wrong number of parts')
        require(max((record[4] for record in applied.values()), default=0) == base.max_level, 'wrong largest level')

        bits, start, self.lists = BitReader(self.sections[3]), 0, []
        for region, size in enumerate(list_bits):
            self.lists.append(read_intervals(base, bits, base.records))
            start += size
            require(bits.at == start, 'a list does not end where its size states')
            listed = numbers(self.lists[-1])
            _, _, _, _, _, records, parts, faces, checksum = self.regions[region]
            require((records, parts) == (len(listed), sum(len(applied[number][2]) for number in listed)) and
                    0 < faces <= base.faces, 'a region has wrong counts')
            require(self.mesh.checksum(self.lists[-1]) == checksum, 'a list has a wrong checksum')
        require(bits.end - bits.at < 8, 'found bytes after the last list')
        require(all(self.mesh.is_finest), 'a face does not reach its finest version')
        require(self.digest() == base.digest, 'the digest differs from that of the decoded model')

    def read_records(self):
        """Yields (number, Record) for each record of the model."""
        bits, start = BitReader(self.sections[2]), 0
        reader = RecordReader(self.base, bits)
        for number in range(self.base.records):
            if number % 128 == 0:
                require(bits.at == start, 'a block does not begin where the previous one ends')
                start += self.block_bits[number // 128]
                reader.anchor = 0
            yield number, reader.read(number, number % 128 == 0)
        require(bits.at == start and bits.end - bits.at < 8, 'the codes do not end with the last record')

    def digest(self):
        """Recomputes the digest from the decoded model (spm-format.md, "Digest")."""
        base, mesh = self.base, self.mesh
        out = [struct.pack('<Q8I', 0, *(getattr(base, name) for name in COUNTS)),
               struct.pack('<6f', *base.bounds_min, *base.bounds_max),
               struct.pack('<7d', *base.grid, base.metres_per_unit, base.deviation, base.step),
               struct.pack(f'<{len(mesh.positions)}f', *mesh.positions),
               struct.pack(f'<{len(base.radii)}H', *base.radii)]
        out += [struct.pack('<5I', face, is_finest, *corners) for face, is_finest, corners in base.base]
        first_parts, later_parts = [], []
        for number in range(base.records):
            t, radius, stored, _, _ = mesh.applied[number]
            for i, (born, deformed) in enumerate(stored):
                following = NONE if i + 1 == len(stored) else base.records + len(later_parts) + (i > 0)
                flags = sum(is_finest << i for i, (_, is_finest) in enumerate(deformed))
                part = struct.pack('<2I2H', t, following, len(born) | len(deformed) << 2 | flags << 6, radius)
                part += struct.pack('<4I', *[b[0] for b in born] + [0] * (2 - len(born)),
                                    *[b[1] for b in born] + [0] * (2 - len(born)))
                part += struct.pack('<9I', *[d[0] for d in deformed] + [0] * (9 - len(deformed)))
                (later_parts if i else first_parts).append(part)
        out += first_parts + later_parts
        interval = 0
        for region, (x, y, z, depth, occupied, *counts, checksum) in enumerate(self.regions):
            count = len(self.lists[region])
            out.append(struct.pack('<4HQ6I', x, y, z, depth, occupied, interval, count, *counts, checksum))
            interval += count
        out += [struct.pack('<2I', *i) for intervals in self.lists for i in intervals]
        return xxh3(b''.join(out))


def read_sections(data):
    """Returns the contents of the sections: base mesh, regions, codes, lists, sizes, statistics, checksums."""
    require(len(data) >= 288 and data[:8] == b'tactSPM\n', 'found no .spm file')
    version, sections, size, checksum = struct.unpack_from('<2I2Q', data, 8)
    require(version == 9, f'found file version {version}, expected 9')
    require(sections == 7, f'found {sections} sections, expected 7')
    require(size == len(data), f'found {len(data)} bytes, expected {size}')
    require(xxh3(data[:24] + bytes(8) + data[32:288]) == checksum, 'the header has a wrong checksum')
    contents = []
    for i in range(7):
        kind, _, offset, size, checksum = struct.unpack_from('<2I3Q', data, 64 + 32 * i)
        require(kind == i + 1 and offset % 64 == 0 and offset + size <= len(data), f'section {i + 1} has a bad entry')
        contents.append(memoryview(data)[offset:offset + size])
        require(xxh3(contents[-1]) == checksum, f'section {i + 1} has a wrong checksum')
    blocks = [section[at:at + BLOCK] for section in contents[2:4] for at in range(0, len(section), BLOCK)]
    require(bytes(contents[6]) == b''.join(struct.pack('<Q', xxh3(block)) for block in blocks),
            'section 7 has wrong checksums of blocks')
    return contents


def run(main, usage, max_arguments):
    """Runs `main` with the arguments of the command line. A wrong input ends the program with a message."""
    if not 1 <= len(sys.argv) - 1 <= max_arguments:
        sys.exit(usage)
    try:
        main(*sys.argv[1:])
    except (FormatError, OSError, OverflowError, UnicodeDecodeError) as error:
        sys.exit(f'{sys.argv[0]}: {error}')


def main(path, ply=None):
    model = Model(path)
    print(f'digest {model.base.digest:016x}: {model.mesh}, {model.base.records} records, {model.base.regions} regions')
    print(model.statistics)
    if ply:
        model.mesh.write_ply(ply)


if __name__ == '__main__':
    run(main, __doc__, 2)
