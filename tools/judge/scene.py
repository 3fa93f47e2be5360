"""Reads a glTF level into plain numpy arrays in world space, with its cameras and its sky.

load(path) -> Scene; metres, Y up, triangles counter-clockwise seen from the front, also under nodes
that mirror.  Read: node transforms, instances and EXT_mesh_gpu_instancing, strided, sparse and
normalised accessors, strips and fans, textures (PNG, JPEG) with KHR_texture_transform, COLOR_0,
MASK, BLEND, KHR_materials_transmission, emissive strength, punctual lights with the
`radius` and `angle` of extras.lumel, cameras, and `sky` and `[[sun]]` of LEVEL.lumel.toml.
What the model lacks and would change the picture raises Unsupported: skies from files, IES lamps,
compressed meshes.  Nodes and materials with `exclude` are left out; `occluder` materials are black.
"""
import base64
import io
import json
import os
import re
import struct
import tomllib
import urllib.parse
from dataclasses import dataclass, field

import numpy as np

DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu")


class Unsupported(Exception):
    """The level has something that the judge's light model lacks."""


@dataclass
class Material:
    """base: linear RGBA; emissive: radiance; *_texture: None or Texture"""
    base: np.ndarray
    emissive: np.ndarray
    base_texture: object = None
    emissive_texture: object = None
    transmission_texture: object = None
    double_sided: bool = False
    alpha_mode: str = "OPAQUE"
    cutoff: float = 0.5
    transmission: float = 0.0
    limit: float = 0.98
    excluded: bool = False

    def textures(self):
        return self.base_texture, self.emissive_texture, self.transmission_texture


@dataclass
class Texture:
    image: int              # of glTF; -1 - number where values are plain data, not sRGB colours
    coordinates: int
    wrap: tuple
    nearest: bool
    matrix: np.ndarray      # [2, 3]: uv of the picture from uv of the vertex


@dataclass
class Lamp:
    """intensity: candela, or lux for suns; direction: that in which its light travels"""
    kind: str
    intensity: np.ndarray
    position: np.ndarray
    direction: np.ndarray
    radius: float = 0.0     # metres, of points and spots
    angle: float = 0.0      # diameter of a sun's disc, degrees
    inner: float = 0.0
    outer: float = np.pi / 4
    range: float = 0.0


@dataclass
class Camera:
    name: str
    matrix: np.ndarray      # [4, 4], looks along its -Z
    yfov: float
    aspect: float


@dataclass
class Scene:
    corners: np.ndarray     # [T, 3, 3]
    normals: np.ndarray     # [T, 3, 3], unit; the face's where the file has none
    curved: np.ndarray      # [T]: whether the normals describe a round surface (lab/smooth.md)
    uv: list                # of [T, 3, 2], TEXCOORD_0 and 1
    colours: np.ndarray     # [T, 3, 4]
    material: np.ndarray    # [T]
    node: np.ndarray        # [T], index of the glTF's node
    instance: np.ndarray    # [T], number within EXT_mesh_gpu_instancing, else 0
    materials: list
    images: dict            # Texture.image -> [H, W, 4] float32, linear
    lamps: list
    cameras: list
    sky: np.ndarray
    names: list             # of each node
    extras: list            # of each node
    meta: dict = field(default_factory=dict)


class Document:
    def __init__(self, path):
        self.folder = os.path.dirname(os.path.abspath(path))
        raw = open(path, "rb").read()
        self.binary = None
        if raw[:4] != b"glTF":
            self.js = json.loads(raw)
        else:
            at = 12
            while at + 8 <= len(raw):
                size, kind = struct.unpack_from("<I4s", raw, at)
                if kind == b"JSON":
                    self.js = json.loads(raw[at + 8:at + 8 + size])
                elif kind == b"BIN\0" and self.binary is None:
                    self.binary = raw[at + 8:at + 8 + size]
                at += 8 + size
        for name in self.js.get("extensionsRequired", []):
            if name in COMPRESSED:
                raise Unsupported(name)
        self.cache = {}

    def uri(self, uri):
        if uri.startswith("data:"):
            return base64.b64decode(uri.split(",", 1)[1])
        return open(os.path.join(self.folder, urllib.parse.unquote(uri)), "rb").read()

    def picture(self, index):
        """the bytes of an image's file"""
        image = self.js["images"][index]
        return self.view(image["bufferView"])[0] if "bufferView" in image else self.uri(image["uri"])

    def view(self, index):
        view = self.js["bufferViews"][index]
        number = view["buffer"]
        if number not in self.cache:
            buffer = self.js["buffers"][number]
            self.cache[number] = self.uri(buffer["uri"]) if "uri" in buffer else self.binary
        at = view.get("byteOffset", 0)
        return self.cache[number][at:at + view["byteLength"]], view.get("byteStride", 0)

    def block(self, view, offset, dtype, count, width):
        data, stride = self.view(view)
        stride = stride or dtype.itemsize * width
        shape = np.lib.stride_tricks.as_strided
        rows = np.frombuffer(data, np.uint8, offset=offset)
        rows = shape(rows, (count, dtype.itemsize * width), (stride, 1))
        return np.ascontiguousarray(rows).view(dtype).reshape(count, width)

    def accessor(self, index):
        a = self.js["accessors"][index]
        dtype, width = np.dtype(DTYPES[a["componentType"]]), WIDTHS[a["type"]]
        out = np.zeros((a["count"], width), dtype)
        if "bufferView" in a and a["count"]:
            out = self.block(a["bufferView"], a.get("byteOffset", 0), dtype, a["count"], width)
        if "sparse" in a:
            s = a["sparse"]
            i, v = s["indices"], s["values"]
            kind = np.dtype(DTYPES[i["componentType"]])
            where = self.block(i["bufferView"], i.get("byteOffset", 0), kind, s["count"], 1)[:, 0]
            out = out.copy()
            out[where] = self.block(v["bufferView"], v.get("byteOffset", 0), dtype, s["count"],
                                    width)
        out = out.astype(np.float64) if dtype.kind == "f" or a.get("normalized") else out
        if a.get("normalized"):
            out = np.maximum(out / np.iinfo(dtype).max, -1)
        return out


def turn(q):
    x, y, z, w = np.asarray(q, float) / max(np.linalg.norm(q), 1e-30)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def placed(translation=(0, 0, 0), rotation=(0, 0, 0, 1), scale=(1, 1, 1)):
    m = np.eye(4)
    m[:3, :3] = turn(rotation) * np.asarray(scale, float)
    m[:3, 3] = translation
    return m


def local(node):
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    return placed(**{k: node[k] for k in ("translation", "rotation", "scale") if k in node})


def to_linear(srgb):
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def texture(js, ref, data=False):
    if ref is None:
        return None
    t = js["textures"][ref["index"]]
    sampler = js["samplers"][t["sampler"]] if "sampler" in t else {}
    move = ref.get("extensions", {}).get("KHR_texture_transform", {})
    (ox, oy), (sx, sy) = move.get("offset", [0, 0]), move.get("scale", [1, 1])
    c, s = np.cos(move.get("rotation", 0)), np.sin(move.get("rotation", 0))
    return Texture(-1 - t["source"] if data else t["source"], move.get("texCoord", ref.get("texCoord", 0)),
                   (sampler.get("wrapS", 10497), sampler.get("wrapT", 10497)),
                   sampler.get("magFilter") == 9728,
                   np.array([[c * sx, s * sy, ox], [-s * sx, c * sy, oy]]))


def lower_level(node):
    """A level shows one LOD of a thing at a time; the pictures show the first."""
    return (hint(node).get("lod", {}).get("level", 0) > 0
            or re.search(r"_LOD[1-9]\d*$", node.get("name") or "") is not None)


def hint(thing):
    """extras.lumel of a node, a material, ..."""
    extras = thing.get("extras")
    found = extras.get("lumel") if isinstance(extras, dict) else None
    return found if isinstance(found, dict) else {}


def materials(js, limit):
    out = []
    for m in js.get("materials", []) + [{}]:
        pbr, ext, said = m.get("pbrMetallicRoughness", {}), m.get("extensions", {}), hint(m)
        strength = ext.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        emissive = np.array(m.get("emissiveFactor", [0, 0, 0]), float) * strength
        glass = ext.get("KHR_materials_transmission", {})
        through = glass.get("transmissionFactor", 0.0)
        out.append(Material(
            np.array(pbr.get("baseColorFactor", [1, 1, 1, 1]), float),
            emissive * said.get("emitScale", 1.0),
            texture(js, pbr.get("baseColorTexture")), texture(js, m.get("emissiveTexture")),
            texture(js, glass.get("transmissionTexture"), True) if through > 0 else None,
            m.get("doubleSided", False), m.get("alphaMode", "OPAQUE"), m.get("alphaCutoff", 0.5),
            through, min(limit, said.get("maxReflectance", 1.0)), bool(said.get("exclude"))))
        if said.get("occluder"):
            out[-1].emissive, out[-1].limit = np.zeros(3), 0.0
    return out


def pictures(doc, used):
    from PIL import Image
    out = {}
    for i in used:
        data = doc.picture(i if i >= 0 else -1 - i)
        a = np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"), np.float32) / 255
        if i >= 0:
            a = np.concatenate([to_linear(a[..., :3]).astype(np.float32), a[..., 3:]], 2)
        out[i] = a
    return out


def lamp(js, node, m):
    d = js["extensions"]["KHR_lights_punctual"]["lights"][
        node["extensions"]["KHR_lights_punctual"]["light"]]
    said = {**hint(d), **hint(node)}
    if "ies" in said:
        raise Unsupported("a lamp with an IES profile")
    spot, along = d.get("spot", {}), m[:3, :3] @ np.array([0, 0, -1.0])
    return Lamp(d["type"], np.array(d.get("color", [1, 1, 1]), float) * d.get("intensity", 1.0),
                m[:3, 3].copy(), along / np.linalg.norm(along), float(said.get("radius", 0)),
                float(said.get("angle", 0)), spot.get("innerConeAngle", 0.0),
                spot.get("outerConeAngle", np.pi / 4), float(d.get("range") or 0))


def settings(path):
    """what LEVEL.lumel.toml beside the level says"""
    name = os.path.splitext(path)[0] + ".lumel.toml"
    return tomllib.load(open(name, "rb")) if os.path.exists(name) else {}


def colour(value):
    """a number, [r, g, b], "r,g,b" or "#rrggbb" (sRGB), as lumel takes colours"""
    if isinstance(value, str):
        if value.startswith("#"):
            return to_linear(np.array([int(value[i:i + 2], 16) for i in (1, 3, 5)]) / 255)
        try:
            value = [float(x) for x in value.split(",")]
        except ValueError:
            raise Unsupported("a sky from a file: " + value) from None
    return np.broadcast_to(np.asarray(value, float), 3).copy()


def round_faces(face, normals, vertices):
    """lab/smooth.md: faces whose normals are bent, none of whose corners is a smoothed edge"""
    cosine = (normals * face[:, None]).sum(2)
    bent = (cosine < 0.999962).any(1)
    hard = np.zeros(vertices.max() + 1 if len(vertices) else 0, bool)
    hard[vertices[cosine < 0.766044]] = True
    return bent & ~hard[vertices].any(1)


def primitive(doc, p):
    """-> corners' positions, normals or None, uvs, colours, their vertices [n, 3]"""
    at, mode = p["attributes"], p.get("mode", 4)
    if mode < 4 or "POSITION" not in at:
        return None
    points = doc.accessor(at["POSITION"]).astype(float)
    order = (doc.accessor(p["indices"])[:, 0].astype(np.int64) if "indices" in p
             else np.arange(len(points)))
    if mode == 4:
        f = order[:len(order) // 3 * 3].reshape(-1, 3)
    elif mode == 5:
        f = np.stack([order[:-2], order[1:-1], order[2:]], 1)
        f[1::2] = f[1::2][:, [1, 0, 2]]
    else:
        f = np.stack([np.full(len(order) - 2, order[0]), order[1:-1], order[2:]], 1)
    get = lambda key: doc.accessor(at[key]).astype(float) if key in at else None  # noqa: E731
    colours = get("COLOR_0")
    if colours is not None and colours.shape[1] == 3:
        colours = np.concatenate([colours, np.ones((len(colours), 1))], 1)
    return points, get("NORMAL"), [get("TEXCOORD_0"), get("TEXCOORD_1")], colours, f


def load(path, images=True):
    doc = Document(path)
    js, toml = doc.js, settings(path)
    parts, lamps, cameras, cache = [], [], [], {}
    mats = materials(js, toml.get("max-reflectance", 0.98))

    def add(number, copy, mesh, m):
        mirrored = np.linalg.det(m[:3, :3]) < 0
        cofactor = np.stack([np.cross(m[:3, 1], m[:3, 2]), np.cross(m[:3, 2], m[:3, 0]),
                             np.cross(m[:3, 0], m[:3, 1])], 1) * (-1 if mirrored else 1)
        for i, p in enumerate(js["meshes"][mesh]["primitives"]):
            if (mesh, i) not in cache:
                cache[mesh, i] = primitive(doc, p)
            which = p.get("material", len(mats) - 1)
            if cache[mesh, i] is None or mats[which].excluded:
                continue
            points, normals, uvs, colours, f = cache[mesh, i]
            f = f[:, [0, 2, 1]] if mirrored else f
            corners = (points @ m[:3, :3].T + m[:3, 3])[f]
            face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            size = np.linalg.norm(face, axis=1)
            keep = size > 0
            f, corners, face = f[keep], corners[keep], face[keep] / size[keep, None]
            n = np.repeat(face[:, None], 3, 1)
            curved = np.zeros(len(f), bool)
            if normals is not None and len(f):
                n = (normals @ cofactor.T)[f]
                length = np.linalg.norm(n, axis=2, keepdims=True)
                n = np.where(length > 0, n / np.maximum(length, 1e-300), face[:, None])
                curved = round_faces(face, n, f)
            parts.append(dict(
                corners=corners, normals=n, curved=curved,
                uv0=uvs[0][f] if uvs[0] is not None else np.zeros((len(f), 3, 2)),
                uv1=uvs[1][f] if uvs[1] is not None else np.full((len(f), 3, 2), np.nan),
                colours=colours[f] if colours is not None else np.ones((len(f), 3, 4)),
                material=np.full(len(f), which), node=np.full(len(f), number),
                instance=np.full(len(f), copy)))

    def walk(number, parent):
        node = js["nodes"][number]
        if hint(node).get("exclude") or lower_level(node):
            return
        m, ext = parent @ local(node), node.get("extensions", {})
        if "mesh" in node and "EXT_mesh_gpu_instancing" in ext:
            at = ext["EXT_mesh_gpu_instancing"]["attributes"]
            rows = {k.lower(): doc.accessor(v) for k, v in at.items() if k[0] != "_"}
            for k in range(len(next(iter(rows.values())))):
                add(number, k, node["mesh"], m @ placed(**{a: v[k] for a, v in rows.items()}))
        elif "mesh" in node:
            add(number, 0, node["mesh"], m)
        if "KHR_lights_punctual" in ext:
            lamps.append(lamp(js, node, m))
        if "camera" in node:
            c = js["cameras"][node["camera"]].get("perspective")
            if c:
                name = node.get("name") or "camera%d" % len(cameras)
                cameras.append(Camera(name, m, c["yfov"], c.get("aspectRatio", 1.5)))
        for child in node.get("children", []):
            walk(child, m)

    nodes = js.get("nodes", [])
    children = {c for n in nodes for c in n.get("children", [])}
    roots = (js["scenes"][toml.get("scene", js.get("scene", 0))].get("nodes", [])
             if js.get("scenes") else [i for i in range(len(nodes)) if i not in children])
    for r in roots:
        walk(r, np.eye(4))
    if not parts:
        raise Unsupported("no triangles")
    joined = {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}
    for s in toml.get("sun", []):
        d = np.array(s["direction"], float)
        lamps.append(Lamp("directional", np.full(3, float(s["lux"])), np.zeros(3),
                          d / np.linalg.norm(d), angle=float(s.get("degrees", 0))))
    used = {t.image for i in np.unique(joined["material"])
            for t in mats[i].textures() if t}
    sky = colour(toml.get("sky", 0)) * toml.get("sky-intensity", 1.0)
    uv = [joined.pop("uv0"), joined.pop("uv1")]
    return Scene(uv=uv, materials=mats, images=pictures(doc, used) if images else {}, lamps=lamps,
                 cameras=cameras, sky=sky, names=[n.get("name", "") for n in nodes],
                 extras=[n.get("extras") or {} for n in nodes], **joined)
