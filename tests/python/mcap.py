"""Writes MCAP files and CDR samples by their specifications, without code of Tactus."""

import struct

MAGIC = b"\x89MCAP0\r\n"


def text(value):
    return struct.pack("<I", len(value)) + value.encode()


def record(opcode, content):
    return struct.pack("<BQ", opcode, len(content)) + content


def mcap(channels, messages, ended=True):
    """channels: {id: (topic, type, encoding of the schema, IDL)}; messages: [(channel, sequence, time, sample)]."""
    file = MAGIC + record(1, text("") + text("test"))
    for number, (topic, name, encoding, idl) in channels.items():
        file += record(3, struct.pack("<H", number) + text(name) + text(encoding) + text(idl))
        file += record(4, struct.pack("<HH", number, number) + text(topic) + text("cdr") + struct.pack("<I", 0))
    for channel, sequence, time, sample in messages:
        file += record(5, struct.pack("<HIQQ", channel, sequence, time, time) + sample)
    if ended:
        file += record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC
    return file


class Cdr:
    """A sample in plain CDR: each number is aligned to its size, relative to the end of the encapsulation."""

    def __init__(self, big_endian=False):
        self.order = ">" if big_endian else "<"
        self.bytes = b""

    def add(self, formats, *values):
        for letter, value in zip(formats, values, strict=True):
            size = struct.calcsize("<" + letter)
            self.bytes += bytes(-len(self.bytes) % size) + struct.pack(self.order + letter, value)
        return self

    def text(self, value):
        encoded = value.encode() + b"\0"
        self.add("I", len(encoded))
        self.bytes += encoded
        return self

    def sample(self):
        return (b"\0\0\0\0" if self.order == ">" else b"\0\1\0\0") + self.bytes
