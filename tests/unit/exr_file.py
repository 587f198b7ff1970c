"""A writer of plain OpenEXR files (scan lines, uncompressed, 32-bit float), for tests. Standard library only."""
import struct


def _attribute(name, kind, data):
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data


def exr_bytes(width, height, channels, metadata=None):
    """`channels`: {name: width * height floats, rows from top to bottom}; `metadata`: {name: text}."""
    names = sorted(channels)
    listed = b"".join(n.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, 1, 1) for n in names) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = struct.pack("<ii", 20000630, 2)
    header += _attribute("channels", "chlist", listed) + _attribute("compression", "compression", b"\0")
    header += _attribute("dataWindow", "box2i", window) + _attribute("displayWindow", "box2i", window)
    header += _attribute("lineOrder", "lineOrder", b"\0")
    header += _attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    header += _attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0))
    header += _attribute("screenWindowWidth", "float", struct.pack("<f", 1))
    for key, text in (metadata or {}).items():
        header += _attribute(key, "string", text.encode())
    header += b"\0"
    line = 8 + 4 * width * len(names)
    offsets = struct.pack(f"<{height}Q", *(len(header) + 8 * height + line * y for y in range(height)))
    body = bytearray()
    for y in range(height):
        body += struct.pack("<ii", y, line - 8)
        for n in names:
            body += struct.pack(f"<{width}f", *channels[n][y * width:(y + 1) * width])
    return header + offsets + bytes(body)


def rgb(pixels):
    """{name: values} of a list of (r, g, b)."""
    return {name: [p[i] for p in pixels] for i, name in enumerate("RGB")}
