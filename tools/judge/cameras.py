"""Copies a level with views of one's choice, so that it can be judged like a generated one."""
import os

import numpy as np

import common

from . import scene as scenes


def matrix(eye, target):
    """[4, 4] of a camera that looks along its -Z, Y up"""
    back = eye - target
    back /= np.linalg.norm(back)
    # Straight up or down, any direction may be right.
    up = [0.0, 1.0, 0.0] if abs(back[1]) < 0.999 else [0.0, 0.0, 1.0]
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    m = np.eye(4)
    m[:3, :3] = np.stack([right, np.cross(back, right), back], 1)
    m[:3, 3] = eye
    return m


def numbers(text):
    return np.array([float(x) for x in text.split(",")])


def packed(path):
    """-> (JSON, bytes) of a glTF, its buffers and pictures in one buffer"""
    doc = scenes.Document(path)
    js, starts, data = doc.js, [], b""
    for b in js.get("buffers", []):
        part = doc.uri(b["uri"]) if "uri" in b else doc.binary
        starts.append(len(data))
        data += part + b"\0" * (-len(part) % 4)
    for v in js.get("bufferViews", []):
        v["byteOffset"] = v.get("byteOffset", 0) + starts[v["buffer"]]
        v["buffer"] = 0
    for image in js.get("images", []):
        if "uri" not in image:
            continue
        uri = image.pop("uri")
        part = doc.uri(uri)
        image.setdefault("mimeType", "image/png" if part[:4] == b"\x89PNG" else "image/jpeg")
        views = js.setdefault("bufferViews", [])
        image["bufferView"] = len(views)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(part)})
        data += part + b"\0" * (-len(part) % 4)
    js["buffers"] = [{"byteLength": len(data)}]
    return js, data


def place(level, folder, views, fov, sky, sun):
    """Writes NAME_0.glb and NAME_0.lumel.toml. views: "EYE:TARGET", each x,y,z in metres.
    Cameras that the level has are removed."""
    js, data = packed(level)
    for n in js["nodes"]:
        n.pop("camera", None)
    js["cameras"] = [{"type": "perspective",
                      "perspective": {"yfov": np.radians(fov), "aspectRatio": 1.5, "znear": 0.01}}]
    root = js["scenes"][js.get("scene", 0)].setdefault("nodes", [])
    for i, view in enumerate(views):
        m = matrix(*(numbers(x) for x in view.split(":")))
        root.append(len(js["nodes"]))
        js["nodes"].append({"name": "view%d" % i, "camera": 0, "matrix": m.T.ravel().tolist()})
    name = os.path.splitext(os.path.basename(level))[0] + "_0"
    os.makedirs(folder, exist_ok=True)
    common.write_glb(os.path.join(folder, name + ".glb"), js, data)
    with open(os.path.join(folder, name + ".lumel.toml"), "w") as f:
        if sky:
            f.write("sky = [%s]\n" % sky)
        if sun:
            x = numbers(sun)
            f.write("[[sun]]\ndirection = [%g, %g, %g]\nlux = %g\n" % tuple(x[:4]))
            if len(x) > 4:
                f.write("degrees = %g\n" % x[4])
