#!/usr/bin/env python3
"""Bakes valid, broken, huge and absurd levels with random options, several at a time.

    tools/hostile_mix.py [--minutes N] [--jobs N] [--seed N] [--lumel PATH] [--memory MIB]
                         [--seconds N] [DIR…]

Needs only python3 and a release build. Levels are those of assets/, of each DIR, height fields of
random size, and damaged copies of all. Every bake gets `--memory`. Exits with 1 unless each ends
with a documented code within `--seconds` of processor time, gives exactly one error if it fails,
needs at most a tenth more memory than allowed, changes no input, and leaves no temporary file and,
if it fails, no output. What went wrong is kept, and its command printed.
"""

import argparse
import collections
import concurrent.futures
import hashlib
import json
import os
import random
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Wall time per second of processor time allowed: other programs may have the machine.
PATIENCE = 20
CODES = {0, 1, 2, 3, 4, 5}
OPTIONS = [
    "--quality=draft", "--quality=quick", "--texels-per-unit=4", "--texels-per-unit=0.001", "--texels-per-unit=1e9",
    "--texels-per-unit=-1", "--max-page=64", "--max-page=8192", "--max-page=1", "--padding=0",
    "--padding=4000", "--sky=1", "--sky=1e30", "--sky=nan", "--sky=/dev/zero", "--sky=missing.exr", "--light=*=1e9",
    "--layers=direct,indirect,error", "--layers=direct,indirect,radiosity,error,coverage,ao,sun_mask",
    "--layers=nothing", "--directional=sh1", "--directional=dominant", "--ext=moz", "--no-stitch", "--strict",
    "--no-vertex-colors", "--threads=1", "--threads=0", "--error=0.3", "--error=-1", "--max-image=1K", "--json",
    "--ktx2=bc6h", "--ktx2=rgb9e5", "--png=rgbm", "--unwrapper=xatlas", "--unwrapper=box", "--probes=2",
    "--probes=1e-9", "--group=a=*", "--group=a=sun", "--page-by=*", "--value=radiosity", "--sun=0,-1,0,1000",
    "--mode=shadowmask", "--mode=indirect", "--mixed=*", "--vertex-error=0.1", "--vertex-error=1e-6", "--dry-run",
    "--nonsense", "--preview=p.png", "--block-align=7", "--block-charts", "--ambient-floor=0.1", "--cull-unseen",
    "--no-split-sides", "--hidden=mean", "--uv=keep", "--max-reflectance=1", "--ao-multiply=1", "--in-turn",
]


def height_field(n, rng):
    """An n × n grid of cells with noise, as a .glb."""
    points = b"".join(struct.pack("<3f", x, rng.random(), z) for z in range(n + 1) for x in range(n + 1))
    corners = bytearray()
    for z in range(n):
        for x in range(n):
            a = z * (n + 1) + x
            corners += struct.pack("<6I", a, a + n + 1, a + 1, a + 1, a + n + 1, a + n + 2)
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": (n + 1) ** 2, "type": "VEC3", "min": [0, 0, 0], "max": [n, 1, n]},
            {"bufferView": 1, "componentType": 5125, "count": 6 * n * n, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(points)},
                        {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)}],
        "buffers": [{"byteLength": len(points) + len(corners)}],
    }
    return glb(document, points + bytes(corners))


def glb(document, binary):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def damaged(data, rng):
    """Numbers of the document replaced by absurd ones, or bytes changed."""
    data = bytearray(data)
    if rng.random() < 0.5 and data[:4] == b"glTF":
        size = struct.unpack_from("<I", data, 12)[0]
        try:
            document = json.loads(data[20:20 + size])
            places = [(c, k) for c in walk(document) for k in (c if isinstance(c, dict) else range(len(c)))]
            for _ in range(rng.randint(1, 3) if places else 0):
                where, key = rng.choice(places)
                where[key] = rng.choice([0, -1, 1, 2**31, 2**53, 1e38, 1e-38, None, [], {}, "x", True, [0, 0, 0]])
            return glb(document, bytes(data[28 + size:]))
        except (ValueError, RecursionError):
            pass
    for _ in range(rng.randint(1, 20) if data else 0):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data[:rng.randrange(len(data) + 1)] if rng.random() < 0.2 else data)


def walk(value):
    if isinstance(value, (dict, list)) and value:
        yield value
        for inner in value.values() if isinstance(value, dict) else value:
            yield from walk(inner)


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


class Mix:
    def __init__(self, lumel, memory, seconds, seeds, scratch):
        self.lumel, self.memory, self.seconds = lumel, memory, seconds
        self.seeds, self.scratch = seeds, scratch

    def one(self, number, seed):
        rng = random.Random(f"{seed} {number}")
        folder = self.scratch / str(number)
        folder.mkdir()
        kind = rng.random()
        if kind < 0.25:
            scene = folder / "field.glb"
            scene.write_bytes(height_field(rng.choice([1, 30, 200, 400, 550, 700]), rng))
        else:
            source = rng.choice(self.seeds)
            if kind < 0.5 or source.suffix == ".gltf":
                scene = source
            else:
                scene = folder / source.name
                scene.write_bytes(damaged(source.read_bytes(), rng))
        options = rng.sample(OPTIONS, rng.randint(0, 5))
        out = folder / "out"
        command = [self.lumel, "bake", str(scene), "-o", str(out), "-q", "--no-config", f"--memory={self.memory}M"]
        if not any(o.startswith(("--quality", "--error")) for o in options):
            command.append("--quality=draft")
        command += options
        before = digest(scene)
        start = time.monotonic()
        with open(folder / "err", "wb") as err:
            child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=err, stdin=subprocess.DEVNULL, cwd=folder)
            code, seconds, peak = self.wait(child, start)
        said = (folder / "err").read_text(errors="replace")
        left = [p.name for p in folder.rglob("*") if p.is_file() and p.name not in ("err", scene.name, "p.png")]
        wrong = []
        if code not in CODES:
            wrong.append(f"code {code}")
        if code in (1, 2, 3, 4) and sum(l.startswith("error") for l in said.splitlines()) != 1:
            wrong.append("not one error")
        if code in (1, 2, 3, 4) and left:
            wrong.append(f"left {left[:3]}")
        if any(".lumel-" in name for name in left):
            wrong.append("temporary file")
        if seconds > self.seconds:
            wrong.append(f"{seconds:.0f} s")
        if peak > 1.1 * self.memory:
            wrong.append(f"{peak:.0f} MiB")
        if digest(scene) != before:
            wrong.append("the input changed")
        if not wrong:
            shutil.rmtree(folder)
        return code, seconds, peak, wrong, " ".join(command), said[-300:]

    def wait(self, child, start):
        """Exit code, processor seconds and peak in MiB; a child that takes too long is killed."""
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                child.returncode = os.waitstatus_to_exitcode(status)
                return child.returncode, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
            if time.monotonic() - start > PATIENCE * self.seconds:
                child.kill()
                _, _, usage = os.wait4(child.pid, 0)
                child.returncode = -9
                return "timeout", usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
            time.sleep(0.02)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("folders", nargs="*", type=Path)
    ap.add_argument("--minutes", type=float, default=10)
    ap.add_argument("--jobs", type=int, default=2)
    ap.add_argument("--seed", type=int, default=1)
    ap.add_argument("--memory", type=int, default=1024, help="MiB")
    ap.add_argument("--seconds", type=float, default=120, help="of processor time per bake")
    ap.add_argument("--lumel", default=str(ROOT / "target/release/lumel"))
    a = ap.parse_args()
    seeds = sorted((ROOT / "assets").glob("*.glb"))
    for folder in a.folders:
        seeds += sorted(p for p in folder.rglob("*") if p.suffix in (".glb", ".gltf") and p.stat().st_size < 5e6)
    scratch = Path(tempfile.mkdtemp(prefix="lumel-mix-"))
    mix = Mix(str(Path(a.lumel).resolve()), a.memory, a.seconds, seeds, scratch)
    # A crash must not fill the disk.
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    end = time.monotonic() + 60 * a.minutes
    codes, wrongs, number = collections.Counter(), 0, 0
    longest, largest = (0, ""), (0, "")
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        running = set()
        while running or time.monotonic() < end:
            while len(running) < a.jobs and time.monotonic() < end:
                running.add(pool.submit(mix.one, number, a.seed))
                number += 1
            done, running = concurrent.futures.wait(running, return_when=concurrent.futures.FIRST_COMPLETED)
            for code, seconds, peak, wrong, command, said in (d.result() for d in done):
                codes[code] += 1
                longest, largest = max(longest, (seconds, command)), max(largest, (peak, command))
                if wrong:
                    wrongs += 1
                    print(f"WRONG: {', '.join(wrong)}: {command}\n{said}", flush=True)
    print(f"{number} bakes, by exit code: {dict(sorted(codes.items(), key=str))}")
    print(f"longest {longest[0]:.1f} s of processor time: {longest[1]}\nlargest {largest[0]:.0f} MiB: {largest[1]}")
    if not wrongs:
        shutil.rmtree(scratch)
    sys.exit(1 if wrongs else 0)


if __name__ == "__main__":
    main()
