"""XXH3-64 with seed 0 and the default secret, as the specification of xxHash defines it."""
import struct

MASK32, MASK64 = (1 << 32) - 1, (1 << 64) - 1
SECRET = bytes.fromhex(
    'b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671fcb79e64eccc0e578825ad07dccff7221'
    'b8084674f743248ee03590e6813a264c3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8'
    'a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364eac5ac8334d3ebc3c581a0fffa1363eb'
    '170ddd51b7f0da49d316552629d4689e2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e')
P32 = (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D)
P64 = (0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5)


def u64(data, at):
    return int.from_bytes(data[at:at + 8], 'little')


def u32(data, at):
    return int.from_bytes(data[at:at + 4], 'little')


def avalanche(h):
    h = ((h ^ h >> 37) * 0x165667919E3779F9) & MASK64
    return h ^ h >> 32


def fold(a, b):
    product = a * b
    return (product ^ product >> 64) & MASK64


def mix16(data, at, secret_at):
    return fold(u64(data, at) ^ u64(SECRET, secret_at), u64(data, at + 8) ^ u64(SECRET, secret_at + 8))


def xxh3(data):
    n = len(data)
    if n <= 16:
        return xxh3_short(data, n)
    if n <= 128:
        h = n * P64[0]
        for i in range((n - 1) // 32, -1, -1):
            h += mix16(data, 16 * i, 32 * i) + mix16(data, n - 16 * (i + 1), 32 * i + 16)
        return avalanche(h & MASK64)
    if n <= 240:
        h = avalanche((n * P64[0] + sum(mix16(data, 16 * i, 16 * i) for i in range(8))) & MASK64)
        h += sum(mix16(data, 16 * i, 16 * (i - 8) + 3) for i in range(8, n // 16)) + mix16(data, n - 16, 119)
        return avalanche(h & MASK64)
    return xxh3_long(data, n)


def xxh3_short(data, n):
    if n > 8:
        low = u64(data, 0) ^ u64(SECRET, 24) ^ u64(SECRET, 32)
        high = u64(data, n - 8) ^ u64(SECRET, 40) ^ u64(SECRET, 48)
        return avalanche((n + int.from_bytes(low.to_bytes(8, 'little'), 'big') + high + fold(low, high)) & MASK64)
    if n >= 4:
        h = ((u32(data, n - 4) + (u32(data, 0) << 32)) ^ u64(SECRET, 8) ^ u64(SECRET, 16)) & MASK64
        h ^= (h << 49 | h >> 15) & MASK64 ^ (h << 24 | h >> 40) & MASK64
        h = h * 0x9FB21C651E98DF25 & MASK64
        h = (h ^ (h >> 35) + n) * 0x9FB21C651E98DF25 & MASK64
        return h ^ h >> 28
    if n > 0:
        h = (data[0] << 16 | data[n >> 1] << 24 | data[n - 1] | n << 8) ^ u32(SECRET, 0) ^ u32(SECRET, 4)
    else:
        h = u64(SECRET, 56) ^ u64(SECRET, 64)
    h = (h ^ h >> 33) * P64[1] & MASK64
    h = (h ^ h >> 29) * P64[2] & MASK64
    return h ^ h >> 32


def xxh3_long(data, n):
    keys = [struct.unpack_from('<8Q', SECRET, 8 * i) for i in range(16)]
    scramble_key = struct.unpack_from('<8Q', SECRET, 128)
    acc = [P32[2], P64[0], P64[1], P64[2], P64[3], P32[1], P64[4], P32[0]]

    def add(at, key):
        stripe = struct.unpack_from('<8Q', data, at)
        for i in range(8):
            k = stripe[i] ^ key[i]
            acc[i ^ 1] += stripe[i]
            acc[i] += (k & MASK32) * (k >> 32)

    stripes, blocks = (n - 1) // 64, (n - 1) // 1024
    for stripe in range(stripes):
        add(64 * stripe, keys[stripe % 16])
        if stripe % 16 == 15 and stripe // 16 < blocks:
            for i in range(8):
                a = acc[i] & MASK64
                acc[i] = (a ^ a >> 47 ^ scramble_key[i]) * P32[0] & MASK64
    add(n - 64, struct.unpack_from('<8Q', SECRET, 121))
    h = n * P64[0]
    for i in range(4):
        h += fold(acc[2 * i] & MASK64 ^ u64(SECRET, 11 + 16 * i), acc[2 * i + 1] & MASK64 ^ u64(SECRET, 19 + 16 * i))
    return avalanche(h & MASK64)
