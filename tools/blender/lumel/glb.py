"""Reads, extends and writes binary glTF files, without Blender."""

import json
import struct

MAGIC, JSON_CHUNK, BIN_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
FLOAT, U16, TRIANGLES = 5126, 5123, 4


class Glb:
    """A .glb in memory: `json` is its document, `blob` the contents of buffer 0."""

    def __init__(self, path):
        with open(path, "rb") as f:
            data = f.read()
        magic, _, length = struct.unpack_from("<III", data, 0)
        if magic != MAGIC or length > len(data):
            raise ValueError(f"{path}: found no binary glTF, expected one")
        size, _ = struct.unpack_from("<II", data, 12)
        self.json = json.loads(data[20 : 20 + size])
        self.blob = bytearray(data[28 + size : length])

    def write(self, path):
        if self.blob:
            self.json.setdefault("buffers", [{}])[0]["byteLength"] = len(self.blob)
        text = json.dumps(self.json, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        blob = bytes(self.blob) + b"\0" * (-len(self.blob) % 4)
        chunks = struct.pack("<II", len(text), JSON_CHUNK) + text
        if blob:
            chunks += struct.pack("<II", len(blob), BIN_CHUNK) + blob
        with open(path, "wb") as f:
            f.write(struct.pack("<III", MAGIC, 2, 12 + len(chunks)) + chunks)

    def add(self, kind, item):
        """Appends `item` to the list `kind` of the document; returns its index."""
        items = self.json.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def _accessor(self, data, component, kind, count, **more):
        self.blob += b"\0" * (-len(self.blob) % 4)
        view = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)}
        self.blob += data
        view = self.add("bufferViews", view)
        return self.add(
            "accessors",
            {"bufferView": view, "componentType": component, "count": count, "type": kind, **more},
        )

    def add_fan(self, name, points, material):
        """Adds a convex polygon as a node of the scene; counter-clockwise as seen from its
        front."""
        points = [struct.unpack("<3f", struct.pack("<3f", *p)) for p in points]
        low = [min(p[i] for p in points) for i in range(3)]
        high = [max(p[i] for p in points) for i in range(3)]
        flat = b"".join(struct.pack("<3f", *p) for p in points)
        position = self._accessor(flat, FLOAT, "VEC3", len(points), min=low, max=high)
        corners = [c for i in range(1, len(points) - 1) for c in (0, i, i + 1)]
        indices = self._accessor(
            struct.pack(f"<{len(corners)}H", *corners), U16, "SCALAR", len(corners)
        )
        primitive = {"attributes": {"POSITION": position}, "indices": indices}
        primitive |= {"material": material, "mode": TRIANGLES}
        mesh = self.add("meshes", {"name": name, "primitives": [primitive]})
        node = self.add("nodes", {"name": name, "mesh": mesh})
        scene = self.json["scenes"][self.json.get("scene", 0)]
        scene.setdefault("nodes", []).append(node)
        return self.json["nodes"][node]

    def use_extension(self, name):
        used = self.json.setdefault("extensionsUsed", [])
        if name not in used:
            used.append(name)


def lumel_extras(item, **values):
    """Adds values to `extras.lumel` of a glTF object, and keeps those that its author wrote."""
    lumel = item.setdefault("extras", {}).setdefault("lumel", {})
    for key, value in values.items():
        lumel.setdefault(key, value)
