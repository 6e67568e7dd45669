"""The part of a shared library (ELF) that is loaded: without debug information, symbol table and section headers.

``zig objcopy`` would do it but is not implemented for ELF (ziglang 0.17), and ``strip`` need not be installed.  All
that is wanted is to cut the file behind its last segment: dynamic linkers look at segments only (System V ABI,
chapter 5).
"""

from __future__ import annotations

import struct

_IDENTITY = b"\x7fELF\x02\x01"  # 64 bits, little-endian
_HEADER = struct.Struct("<16sHHIQQQIHHHHHH")
_SEGMENT = struct.Struct("<IIQQQQQQ")


def cut_unloaded(content: bytes) -> bytes:
    """The library cut behind its last segment; anything that is not a complete ELF file of 64 bits as it is."""
    if not content.startswith(_IDENTITY) or len(content) < _HEADER.size:
        return content
    header = list(_HEADER.unpack_from(content))
    table, size, count = header[5], header[9], header[10]
    if size != _SEGMENT.size or not count or table + size * count > len(content):
        return content
    end = table + size * count
    for k in range(count):
        _, _, offset, _, _, in_file, _, _ = _SEGMENT.unpack_from(content, table + k * size)
        end = max(end, offset + in_file)
    if end > len(content):
        return content
    header[6] = header[12] = header[13] = 0  # place and number of section headers, the one with their names
    return _HEADER.pack(*header) + content[_HEADER.size : end]
