#!/usr/bin/env python3
"""Decodes the mesh stream in a recording of `tactus record`, with the standard library of Python alone.

docs/reference/stream-format.md describes the format. This program uses no code of Tactus.

    python3 stream_reader.py SESSION.mcap [OUT [MODEL.spm]]

For each model of the session, writes OUT-DIGEST.ply: the mesh with all regions that the recording has completely.
MODEL.spm supplies a base mesh and regions that the recording does not have.
"""
import struct
import zlib

from spm_reader import (Base, BitReader, ByteReader, Mesh, RecordReader, numbers, read_intervals, read_regions,
                        read_sections, require, run)
from xxh3 import MASK32, xxh3

# Numbers of messages that are no region: FIRST_PAGE + page, or all pages.
FIRST_PAGE, ALL_PAGES = 1 << 31, (1 << 32) - 2


def read_mcap(path):
    """Yields (topic, encoded sample) for each message of an MCAP file. The file may be that of a killed recorder."""
    with open(path, 'rb') as file:
        data = memoryview(file.read())
    require(data[:8] == b'\x89MCAP0\r\n', 'found no MCAP file')
    schemas, topics = {}, {}

    def text(reader):
        return bytes(reader.take(reader.raw('I'))).decode()

    def messages(view):
        at = 0
        while len(view) - at >= 9:
            opcode, length = struct.unpack_from('<BQ', view, at)
            if length > len(view) - at - 9:
                return
            reader = ByteReader(view[at + 9:at + 9 + length])
            at += 9 + length
            if opcode == 0x03:
                number, name = reader.raw('H'), text(reader)
                schemas[number] = (name, text(reader))
            elif opcode == 0x04:
                number, schema, topic, encoding = *reader.raw('HH'), text(reader), text(reader)
                require(schemas.get(schema, ('', ''))[1] == 'omgidl' and encoding == 'cdr',
                        f'topic {topic}: found messages that are not CDR with a schema of OMG IDL')
                topics[number] = topic
            elif opcode == 0x05:
                channel, _, _, _ = reader.raw('HIQQ')
                require(channel in topics, 'found a message before its channel')
                yield topics[channel], reader.data[reader.at:]
            elif opcode == 0x06:
                _, _, size, crc = reader.raw('QQQI')
                require(text(reader) == '', 'found a compressed chunk')
                content = reader.take(reader.raw('Q'))
                require(len(content) == size and crc in (0, zlib.crc32(content)), 'found a broken chunk')
                yield from messages(content)

    yield from messages(data[8:])


class CdrReader(ByteReader):
    """Reads the fields of a sample. CDR aligns each number to its size, counted from the end of the encapsulation."""

    def __init__(self, sample):
        kind = int.from_bytes(sample[:2], 'big')
        require(kind in (0, 1), f'found encapsulation {kind}, expected 0 or 1: plain CDR')
        self.order = '><'[kind]
        super().__init__(sample[4:])

    def number(self, form):
        self.at += -self.at % struct.calcsize('<' + form)
        return self.raw(form)

    def string(self):
        return bytes(self.take(self.number('I')))[:-1].decode()


class Recording:
    """The mesh stream of a recording: for each digest, the base mesh and the records of all messages.

    names     digest -> set of object names
    bases     digest -> Base
    table     digest -> {region: entry of read_regions}, from every page
    regions   digest -> {region: list of intervals}, from every complete message
    records   digest -> {number: Record}, from every complete message
    demands   number of demands
    """

    def __init__(self, path, models=()):
        self.names, self.bases, self.table, self.regions, self.records, self.demands = {}, {}, {}, {}, {}, 0
        for sections in models:
            base = Base(sections[0])
            self.bases[base.digest] = base
            self.table[base.digest] = dict(enumerate(read_regions(ByteReader(sections[1]), base.regions)))
        digests, partials, messages = {}, {}, []
        for topic, sample in read_mcap(path):
            if topic == 'tactus_catalogue':
                reader = CdrReader(sample)
                for form in 'QQQQq':  # participant, object_id, stamp
                    reader.number(form)
                reader.string()  # host
                name = reader.string()
                self.names.setdefault(reader.number('Q'), set()).add(name)
            elif topic == 'tactus_demand':
                demand = read_demand(sample)
                self.demands += 1
                digests[demand['stream']] = demand['digest']
            elif topic in ('tactus_base', 'tactus_records'):
                messages += read_chunk(sample, partials)
        for stream, region, message in messages:
            if region is None:
                base = Base(message)
                self.bases.setdefault(base.digest, base)
                digests[stream] = base.digest
        for stream, region, message in messages:
            digest = digests.get(stream)
            if region is not None and digest in self.bases:
                if region == ALL_PAGES:
                    reader = ByteReader(message)
                    while reader.at < len(message):
                        self.add_page(self.bases[digest], None, bytes(reader.take(reader.varint())))
                elif region >= FIRST_PAGE:
                    self.add_page(self.bases[digest], region - FIRST_PAGE, message)
                else:
                    self.add_region(self.bases[digest], region, message)
        self.digests = set(digests.values())

    def add_page(self, base, expected_page, message):
        reader = ByteReader(message)
        page, first, count = (reader.varint() for _ in range(3))
        require(page < 1 << 30 and expected_page in (None, page), 'a message has another page than its pieces')
        origin = [8 * sum((page >> 3 * bit + axis & 1) << bit for bit in range(10)) for axis in range(3)]
        regions = read_regions(reader, count, origin)
        require(reader.at == len(message) and first + count <= base.regions, 'a page has wrong counts')
        self.table.setdefault(base.digest, {}).update(enumerate(regions, first))

    def add_region(self, base, expected_region, message):
        bits = BitReader(message)
        region = bits.get(32)
        require(region == expected_region < base.regions, 'a message has another region than its pieces')
        intervals = read_intervals(base, bits, base.records)
        listed = numbers(intervals)
        positions = read_intervals(base, bits, len(listed))
        records, reader, before = self.records.setdefault(base.digest, {}), RecordReader(base, bits), None
        for first, count in positions:
            for i in range(first, first + count):
                number = listed[i]
                # Intervals of positions do not end where the list skips numbers, but intervals of records do.
                record = reader.read(number, i == first or number != before + 1)
                records.setdefault(number, record)
                before = number
        require(bits.end - bits.at < 8, 'found bytes after the last record')
        self.regions.setdefault(base.digest, {})[region] = intervals

    def delivered(self, digest):
        """The regions of which every record is in the recording."""
        records = self.records.get(digest, {})
        return {region: intervals for region, intervals in self.regions.get(digest, {}).items()
                if all(number in records for number in numbers(intervals))}

    def mesh(self, digest, regions):
        """The base mesh with the records of these regions, which are a closed set."""
        mesh = Mesh(self.bases[digest])
        for number in sorted({number for region in regions for number in numbers(self.regions[digest][region])}):
            mesh.apply(number, self.records[digest][number])
        for region in regions:
            entry = self.table.get(digest, {}).get(region)  # None: its page came before the recording began
            require(entry is None or mesh.checksum(self.regions[digest][region]) == entry[8],
                    f'region {region} has a wrong checksum')
        return mesh


def read_demand(sample):
    reader, demand = CdrReader(sample), {}
    for name, form in (('participant', 'Q'), ('object_id', 'Q'), ('session', 'Q'), ('incarnation', 'Q'),
                       ('time_ns', 'q'), ('digest', 'Q'), ('serving_host', 'Q'), ('epoch', 'I'), ('need_base', '?'),
                       ('have', 'list'), ('wanted', 'list'), ('stream', 'I'), ('received', 'I'), ('newest', 'I'),
                       ('gaps', 'list'), ('credit', 'I'), ('arrivals', 'I'), ('one_way_us', 'I')):
        if form == 'list':
            demand[name] = [(reader.number('I'), reader.number('I')) for _ in range(reader.number('I'))]
        else:
            demand[name] = reader.number(form)
    return demand


def read_chunk(sample, partials):
    """Adds the pieces of a chunk to `partials`. Yields (stream, region or None, message) for complete messages."""
    reader = CdrReader(sample)
    stream, _, _, _, size = (reader.number('I') for _ in range(5))
    pieces = ByteReader(reader.take(size))
    while pieces.at < size:
        region, index, count, length = (pieces.varint() for _ in range(4))
        checksum, payload = pieces.raw('I'), bytes(pieces.take(length))
        require(0 < region <= 1 << 32 and index < count and length > 0, 'found a bad piece')
        key = (stream, region)
        partial = partials.get(key)
        # A host that plans a message again may cut it in other places.
        if partial is None or partial[:2] != (checksum, count) or len(partial[2].get(index, payload)) != length:
            partial = partials[key] = (checksum, count, {})
        partial[2][index] = payload
        if len(partial[2]) < count:
            continue
        del partials[key]
        message = b''.join(partial[2][i] for i in range(count))
        if xxh3(message) & MASK32 == checksum:
            yield stream, None if region == 1 << 32 else region - 1, message


def main(path, out=None, model=None):
    models = []
    if model:
        with open(model, 'rb') as file:
            models.append(read_sections(file.read()))
    recording = Recording(path, models)
    print(f'{recording.demands} demands')
    for digest in sorted(recording.digests):
        name = ', '.join(sorted(recording.names.get(digest, {'unknown'})))
        if digest not in recording.bases:
            print(f'{name}, digest {digest:016x}: the recording has no base mesh')
            continue
        regions = recording.delivered(digest)
        mesh = recording.mesh(digest, regions)
        print(f'{name}, digest {digest:016x}: {len(regions)} of {mesh.base.regions} regions, '
              f'{len(mesh.applied)} of {mesh.base.records} records, {mesh}')
        if out:
            mesh.write_ply(f'{out}-{digest:016x}.ply')


if __name__ == '__main__':
    run(main, __doc__, 3)
