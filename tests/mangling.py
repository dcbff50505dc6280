"""Files made wrong on purpose, each in a way that its format knows: what robots, disks and people do, and worse.

Every function takes sound content and a generator of random numbers, and gives back content that is not quite sound.
The same generator gives the same content.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable

Mangle = Callable[[bytes, random.Random], bytes]

NUMBERS = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-45,
    1e-300,
    1e38,
    -1e38,
    1e256,
    -1e308,
    3e9,
    1e17,
    0.5,
    1e-9,
    float("nan"),
    float("inf"),
    float("-inf"),
)
WHOLE = (
    0,
    1,
    2,
    3,
    7,
    127,
    128,
    255,
    256,
    65535,
    65536,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**40,
    2**63 - 1,
    2**63,
    2**64 - 1,
)
WORDS = (
    b"nan",
    b"-nan",
    b"inf",
    b"-inf",
    b"1e400",
    b"-1e308",
    b"0",
    b"-0",
    b"-1",
    b"1e17",
    b"99999999999999999999999999",
    b"",
    b"#",
    b"O",
    b"L",
    b"x",
    b"\xff\xfe",
    b"\x00",
    b"1_000",
    b"0x10",
    b"1,5",
    b"FLASER",
    b"ODOM",
    b"PARAM",
    b"'",
    b'"',
    b"[",
    b"]",
    b"{",
    b"}",
    b"&a",
    b"*a",
    b"!!python/object:os.system",
    b"- - -",
    b"2024-13-45",
    b"~",
    b"true",
    b"no",
    b"\x1b[31m",
    "\u202e".encode(),
    b"../../x",
    b"/etc/passwd",
    b"%s%n",
    b"<script>",
    b"1" * 500,
    b".",
    b"e",
    b"-.inf",
)
INTERESTING = (
    b"\x00",
    b"\xff",
    b"\x7f",
    b"\x80",
    b"\x01",
    b"\n",
    b" ",
    b"\x00\x00\x00\x00",
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\x7f",
)


def of_bytes(data: bytes, rng: random.Random) -> bytes:
    """Bytes flipped, replaced, left out, put in, doubled, cut off: what a disk or a transfer does."""
    content = bytearray(data)
    for _ in range(1 + int(rng.expovariate(0.6))):
        if not content:
            break
        at, how = rng.randrange(len(content)), rng.randrange(8)
        if how == 0:
            content[at] ^= 1 << rng.randrange(8)
        elif how == 1:
            word = rng.choice(INTERESTING)
            content[at : at + len(word)] = word
        elif how == 2:
            number = rng.choice(WHOLE)
            size = rng.choice((2, 4, 8))
            content[at : at + size] = (number % (1 << (8 * size))).to_bytes(size, rng.choice(("little", "big")))
        elif how == 3:
            content[at : at + 8] = struct.pack("<d", rng.choice(NUMBERS))
        elif how == 4:
            del content[at : at + 1 + int(rng.expovariate(0.05))]
        elif how == 5:
            content[at:at] = bytes(rng.randrange(256) for _ in range(rng.randrange(1, 20)))
        elif how == 6:
            other = rng.randrange(len(content))
            content[at:at] = content[other : other + rng.randrange(1, 200)]
        else:
            del content[at:]
    return bytes(content)


def of_lines(data: bytes, rng: random.Random) -> bytes:
    """Words and lines of a text replaced, left out, doubled, swapped, joined, cut: what editors and people do."""
    lines = data.split(b"\n")
    for _ in range(1 + int(rng.expovariate(0.5))):
        if not lines:
            break
        at, how = rng.randrange(len(lines)), rng.randrange(9)
        words = lines[at].split(b" ")
        if how <= 3:
            words[rng.randrange(len(words))] = rng.choice(WORDS)
            lines[at] = b" ".join(words)
        elif how == 4:
            del words[rng.randrange(len(words))]
            lines[at] = b" ".join(words)
        elif how == 5:
            lines.insert(rng.randrange(len(lines) + 1), lines[at])
        elif how == 6:
            other = rng.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
        elif how == 7:
            del lines[at]
        else:
            lines[at] = of_bytes(lines[at], rng)
    return b"\n".join(lines)


def of_yaml(data: bytes, rng: random.Random) -> bytes:
    """Values of a YAML replaced, keys renamed and left out, lines moved, and what `of_lines` does."""
    if rng.random() < 0.3:
        return of_lines(data, rng)
    lines = data.split(b"\n")
    for _ in range(1 + int(rng.expovariate(0.8))):
        at = rng.randrange(len(lines))
        key, colon, value = lines[at].partition(b":")
        how = rng.randrange(6)
        if how <= 2 and colon:
            wrong = rng.choice((b" ", b" [", b" - ", b" {a: ")) + rng.choice(WORDS)
            lines[at] = key + colon + rng.choice((wrong, b" " + repr(rng.choice(NUMBERS + WHOLE)).encode(), b""))
        elif how == 3 and b"[" in value:
            items = value.strip(b" []").split(b",")
            items[rng.randrange(len(items))] = rng.choice((*WORDS, b".nan", b".inf", b"1e999"))
            lines[at] = key + b": [" + b",".join(items) + b"]"
        elif how == 4:
            lines[at] = rng.choice((b"", b"\t", b"  ", b"? ", b"<<: ")) + lines[at]
        else:
            del lines[at]
            lines = lines or [b""]
    return b"\n".join(lines)


def of_message(data: bytes, rng: random.Random) -> bytes:
    """Fields of a CDR message replaced: numbers of four and eight bytes where such stand, lengths, and names."""
    content = bytearray(data)
    for _ in range(1 + int(rng.expovariate(0.7))):
        if len(content) < 12:
            return of_bytes(bytes(content), rng)
        how = rng.randrange(6)
        at = 4 + 4 * rng.randrange(max(1, (len(content) - 4) // 4))
        if how == 0:
            content[at : at + 4] = struct.pack("<f", min(max(rng.choice(NUMBERS), -3e38), 3e38))
        elif how == 1:
            content[at : at + 8] = struct.pack("<d", rng.choice(NUMBERS))
        elif how == 2:
            content[at : at + 4] = struct.pack("<I", rng.choice(WHOLE) % 2**32)
        elif how == 3:
            content[4:12] = struct.pack("<iI", rng.choice((0, -1, 2**31 - 1, -(2**31), 17)), rng.choice((0, 2**32 - 1)))
        elif how == 4:
            del content[rng.randrange(len(content)) :]
        else:
            return of_bytes(bytes(content), rng)
    return bytes(content)


MCAP_MAGIC = 8


def records_of(data: bytes) -> list[tuple[int, bytes]]:
    """The records of an MCAP: (kind, content)."""
    found, at = [], MCAP_MAGIC
    while at + 9 <= len(data) - MCAP_MAGIC:
        kind, length = struct.unpack_from("<BQ", data, at)
        found.append((kind, data[at + 9 : at + 9 + length]))
        at += 9 + length
    return found


def of_mcap(data: bytes, rng: random.Random) -> bytes:
    """Records of an MCAP mangled, left out, doubled, swapped; their messages' fields replaced; or its bytes."""
    if rng.random() < 0.25:
        return of_bytes(data, rng)
    records = records_of(data)
    for _ in range(1 + int(rng.expovariate(0.7))):
        at = rng.randrange(len(records))
        kind, content = records[at]
        how = rng.randrange(8)
        if how <= 3:
            messages = [k for k, (what, _) in enumerate(records) if what == 5]  # op code of a message
            if messages:
                at = rng.choice(messages)
                kind, content = records[at]
                records[at] = (kind, content[:22] + of_message(content[22:], rng))
        elif how == 4:
            records[at] = (kind, of_bytes(content, rng))
        elif how == 5:
            del records[at]
        elif how == 6:
            records.insert(rng.randrange(len(records) + 1), records[at])
        else:
            other = rng.randrange(len(records))
            records[at], records[other] = records[other], records[at]
        if not records:
            break
    body = b"".join(struct.pack("<BQ", kind, len(content)) + content for kind, content in records)
    return data[:MCAP_MAGIC] + body + data[-MCAP_MAGIC:]


def of_bag(data: bytes, rng: random.Random) -> bytes:
    """Fields of a ROS 1 bag's headers replaced (their names stay findable), or its bytes."""
    if rng.random() < 0.5:
        return of_bytes(data, rng)
    fields = [
        b"op=",
        b"conn=",
        b"time=",
        b"topic=",
        b"type=",
        b"md5sum=",
        b"size=",
        b"count=",
        b"compression=",
        b"chunk_count=",
        b"conn_count=",
        b"index_pos=",
        b"chunk_pos=",
        b"ver=",
        b"start_time=",
        b"end_time=",
    ]
    content = bytearray(data)
    for _ in range(1 + int(rng.expovariate(0.7))):
        field = rng.choice(fields)
        places = [at for at in range(len(content)) if content.startswith(field, at)] if len(content) < 40_000 else []
        if not places:
            continue
        at = rng.choice(places) + len(field)
        if rng.random() < 0.3:
            at -= len(field) + 4  # the field's length
        size = rng.choice((1, 4, 8))
        content[at : at + size] = (rng.choice(WHOLE) % (1 << (8 * size))).to_bytes(size, "little")
    return bytes(content)


def of_image(data: bytes, rng: random.Random) -> bytes:
    """The header of an image, a PGM's numbers above all, or its bytes."""
    if data.startswith(b"P") and rng.random() < 0.5:
        head = data[:20].split(b"\n")
        head[rng.randrange(len(head))] = rng.choice(
            (*WORDS, b"20000 20000", b"1 1", b"0 0", b"65536", b"P4", b"P6", b"P2")
        )
        return b"\n".join(head) + data[20:]
    if rng.random() < 0.5:
        return of_bytes(data[:64], rng) + data[64:]
    return of_bytes(data, rng)
