"""Shared by the measurement scripts: locations, running programs with limits, reading outputs.

Environment: LUMEL          the lumel binary (default ../target/release/lumel)
             LUMEL_SCENES   folder of other people's levels (default ../../shared/scenes, relative to
                            this folder); without them the scripts run on assets/ alone
             LUMEL_REF      cache of references (default /tmp/lumel-ref)
             LUMEL_NPM      folder whose node_modules has gltf-validator (default /opt/lumel-npm)
"""
import hashlib
import json
import os
import re
import resource
import struct
import subprocess
import sys
import tempfile
import textwrap
import threading
import time

HERE = os.path.dirname(os.path.abspath(__file__))


def _env(name, default):
    return os.path.abspath(os.path.join(HERE, os.environ[name] if os.path.isabs(os.environ.get(name, "")) else
                                        os.path.join(os.getcwd(), os.environ[name]) if name in os.environ else default))


# The notebooks: prose, with program-written tables/, data/ and images/ next to it.
LAB = os.path.join(HERE, "..", "lab")
LUMEL = _env("LUMEL", "../target/release/lumel")
SCENES = _env("LUMEL_SCENES", "../../shared/scenes")
REF = _env("LUMEL_REF", "/tmp/lumel-ref")


def write_tables(lab, page, parts):
    """Writes LAB/tables/PAGE.md from parts (heading: Markdown). Headings without a part keep
    their text."""
    path = os.path.join(lab, "tables", page + ".md")
    old = open(path, encoding="utf-8").read() if os.path.exists(path) else ""
    sections = dict(s.split("\n", 1) for s in re.split(r"^## ", old, flags=re.M)[1:])
    sections.update(parts)
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", encoding="utf-8") as f:
        f.write("# Tables of [%s.md](../%s.md)\n\nWritten by a program; edits here are lost. "
                "The page says which, and on what machine.\n" % (page, page))
        for name, text in sections.items():
            lines = [textwrap.fill(s, 100, break_long_words=False, break_on_hyphens=False) if s[:1].isalpha() else s
                     for s in text.strip().split("\n")]
            f.write("\n## %s\n\n%s\n" % (name, "\n".join(lines)))


def run(args, timeout=None, memory=None, cwd=None):
    """Runs a program; -> dict(code, out, err, seconds, peak_mb, timed_out).

    `code` is negative for a signal. `memory` (bytes) limits the address space. `peak_mb` is the
    peak resident size of that process, read from /proc every 5 ms, so it is a lower bound for
    very short processes.
    """
    def limit():
        if memory:
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    t0 = time.perf_counter()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        p = subprocess.Popen(args, stdout=out, stderr=err, stdin=subprocess.DEVNULL, preexec_fn=limit if memory else None, cwd=cwd)
        peak, done = [0.0], threading.Event()

        def watch():
            while not done.wait(0.005):
                try:
                    for line in open("/proc/%d/status" % p.pid):
                        if line.startswith("VmHWM"):
                            peak[0] = max(peak[0], int(line.split()[1]) / 1024)
                except OSError:
                    return
        w = threading.Thread(target=watch, daemon=True)
        w.start()
        timed_out = False
        try:
            p.wait(timeout)
        except subprocess.TimeoutExpired:
            timed_out = True
            p.kill()
            p.wait()
        seconds = time.perf_counter() - t0
        done.set()
        w.join()
        out.seek(0), err.seek(0)
        return dict(code=p.returncode, out=out.read().decode(errors="replace"), err=err.read().decode(errors="replace"),
                    seconds=seconds, peak_mb=peak[0], timed_out=timed_out)


def tool(name, *args, timeout=None):
    """Runs a script of this folder with this Python; -> its last line of JSON (or {}).
    Raises on failure."""
    r = run([sys.executable, os.path.join(HERE, name), *map(str, args)], timeout)
    if r["code"] != 0:
        raise SystemExit("%s failed (%d):\n%s" % (name, r["code"], (r["err"] or r["out"])[-2000:]))
    for line in reversed(r["out"].splitlines()):
        if line.startswith("{"):
            return json.loads(line)
    return {}


def digest(*paths_or_text):
    """Short hash of the contents of files (by path) and of plain text."""
    h = hashlib.sha256()
    for x in paths_or_text:
        x = str(x)
        h.update(open(x, "rb").read() if os.path.isfile(x) else x.encode())
        h.update(b"\0")
    return h.hexdigest()[:16]


def exr_channels(path):
    """{name: float64 [row, column]} of an EXR, row 0 at the top"""
    import numpy as np
    import OpenEXR
    with OpenEXR.File(path, separate_channels=True) as f:
        return {name: np.asarray(c.pixels, np.float64) for name, c in f.channels().items()}


def read_exr(path):
    """RGB of an EXR, [row, column, 3]"""
    import numpy as np
    channels = exr_channels(path)
    return np.stack([channels[c] for c in "RGB"], -1)


def write_exr(path, image):
    """image: [row, column, 3]"""
    import numpy as np
    import OpenEXR
    channels = {c: np.ascontiguousarray(image[..., i], np.float32) for i, c in enumerate("RGB")}
    header = dict(compression=OpenEXR.ZIP_COMPRESSION, type=OpenEXR.scanlineimage)
    with OpenEXR.File(header, channels) as f:
        f.write(path)


def exr_size(path):
    """(width, height) of an EXR's data window, from its header."""
    with open(path, "rb") as f:
        data = f.read(1 << 16)
    if data[:4] != b"\x76\x2f\x31\x01":
        raise ValueError("not an EXR: " + path)
    i = 8
    while data[i]:
        j = data.index(b"\0", i)
        name = data[i:j]
        k = data.index(b"\0", j + 1)
        size, = struct.unpack_from("<i", data, k + 1)
        if name == b"dataWindow":
            x0, y0, x1, y1 = struct.unpack_from("<4i", data, k + 5)
            return x1 - x0 + 1, y1 - y0 + 1
        i = k + 5 + size
    raise ValueError("no dataWindow: " + path)


def read_glb(path):
    """-> (json, bin) of a .glb"""
    data = open(path, "rb").read()
    magic, _, total = struct.unpack_from("<4sII", data)
    if magic != b"glTF":
        raise ValueError("not a glb: " + path)
    js, bin_, at = None, b"", 12
    while at + 8 <= min(total, len(data)):
        n, kind = struct.unpack_from("<I4s", data, at)
        chunk = data[at + 8: at + 8 + n]
        if kind == b"JSON":
            js = json.loads(chunk)
        elif kind == b"BIN\0":
            bin_ = chunk
        at += 8 + n
    return js, bin_


def write_glb(path, js, bin_):
    text = json.dumps(js, ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    bin_ = bytes(bin_) + b"\0" * (-len(bin_) % 4)
    with open(path, "wb") as f:
        f.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(bin_)))
        f.write(struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(bin_), b"BIN\0") + bin_)


def outputs(directory):
    """-> the files of a bake in a folder: dict(glb, vertex, report, manifest, pages)"""
    names = sorted(os.listdir(directory))
    pick = lambda end, skip=(): next((os.path.join(directory, n) for n in names if n.endswith(end) and not n.endswith(skip)), None)  # noqa: E731
    return dict(glb=pick(".glb", (".vertex.glb", ".flat.glb")), vertex=pick(".vertex.glb"), report=pick(".report.json"),
                manifest=pick(".lightmap.json"), pages=[os.path.join(directory, n) for n in names if n.endswith(".exr")])


# Settings for comparisons with means over whole texels, which Cycles and the references compute:
# hidden parts count, and borders stay as gathered. Charts are not cut by their light, so that all
# presets have the same lumels.
COMPARABLE = ("--hidden", "mean", "--no-stitch", "--no-cut-charts")


def bake(scene, directory, *options, timeout=None, memory=None):
    """Runs `lumel bake`; -> run()'s dict with `report` (parsed, or None) and outputs()"""
    os.makedirs(directory, exist_ok=True)
    r = run([LUMEL, "bake", scene, "-o", directory, "-q", *map(str, options)], timeout, memory)
    r.update(outputs(directory))
    r["report_json"] = json.load(open(r["report"])) if r["report"] else None
    return r


def phases(report):
    """-> {phase: seconds} of a report"""
    return {p["phase"]: p["seconds"] for p in (report or {}).get("measured", {}).get("phases", [])}
