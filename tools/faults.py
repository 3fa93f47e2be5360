#!/usr/bin/env python3
"""Kills bakes, fills disks, removes inputs, and checks what is left.

    tools/faults.py [--kills N] [--lumel PATH] [--scratch DIR]

Needs only python3. Kills between two renames also need strace, and the tests with a full disk and
an unwritable folder need root; without them, they are skipped with a message. Exits with 1 if any
of the following does not hold:

- files are complete, from the old bake or from the new; if both occur, `lumel report` says so;
- a failure gives one error, leaves no temporary files and changes nothing;
- the next bake works, and removes what a killed bake left.
"""

import argparse
import hashlib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import struct
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DRAFT = ["--quality", "draft", "--texels-per-unit", "6"]
TEMPORARY = ".lumel-tmp-"
MIXED = "these files do not match"


class Faults:
    def __init__(self, lumel, scratch):
        self.lumel, self.scratch = lumel, scratch
        self.wrong = 0

    # What is run.

    def command(self, scene, out, *options):
        return [self.lumel, "bake", str(scene), "-o", str(out), *DRAFT, *options]

    def bake(self, scene, out, *options, **how):
        return subprocess.run(self.command(scene, out, *options), capture_output=True, text=True, **how)

    def start(self, scene, out, *options):
        return subprocess.Popen(self.command(scene, out, *options), stderr=subprocess.PIPE, text=True)

    def report(self, out):
        return subprocess.run([self.lumel, "report", str(out), "-o", "-"], capture_output=True, text=True)

    def mixed(self, out):
        """Whether `lumel report` says that the folder has files from two bakes."""
        run = self.report(out)
        return MIXED in run.stderr or "was changed after the bake" in run.stderr

    # What is said.

    def check(self, what, good, found=""):
        if not good:
            self.wrong += 1
            print(f"  WRONG: {what}: {found}")

    def fails(self, what, run, code):
        errors = [l for l in run.stderr.splitlines() if l.startswith("error: ")]
        self.check(f"{what}: exit code {code} with one error", run.returncode == code and len(errors) == 1,
                   f"{run.returncode}: {run.stderr[-300:]}")

    def folder(self, name):
        path = self.scratch / name
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir(parents=True)
        return path


def files(folder):
    """Names and hashes of the files in a folder; of reports, without measured values."""
    out = {}
    for path in sorted(folder.iterdir()):
        data = path.read_bytes()
        if path.name.endswith(".report.json"):
            try:
                report = json.loads(data)
                report.pop("measured", None)
                data = json.dumps(report).encode()
            except ValueError:
                pass
        out[path.name] = hashlib.sha256(data).hexdigest()
    return out


def temporaries(folder):
    return [p.name for p in folder.iterdir() if p.name.startswith(TEMPORARY)]


def two_levels(f, name):
    """Two scenes with the same name, and the bake of each."""
    folder = f.folder(name)
    scenes = []
    for sub, asset in (("a", "cornell_box.glb"), ("b", "furnace_cube_50.glb")):
        (folder / sub).mkdir()
        scene = folder / sub / "level.glb"
        shutil.copy(ROOT / "assets" / asset, scene)
        f.bake(scene, folder / f"result_{sub}", "-q").check_returncode()
        scenes.append((scene, files(folder / f"result_{sub}")))
    return folder, scenes


def judge(f, what, out, old, new):
    """Checks that every file is from one bake or the other, and reports which, and whether a
    mixture is detected."""
    now = {k: v for k, v in files(out).items() if not k.startswith(TEMPORARY)}
    for name, value in now.items():
        f.check(f"{what}: {name} is whole", value in (old.get(name), new.get(name)))
    f.check(f"{what}: no file is lost", set(now) == set(old) == set(new), set(now))
    kind = "old" if now == old else "new" if now == new else "mixed"
    f.check(f"{what}: a mix is told of, and nothing else", f.mixed(out) == (kind == "mixed"), kind)
    return kind


def kills(f, count):
    folder, [(a, old), (b, new)] = two_levels(f, "kills")
    out = folder / "out"
    start = time.time()
    f.bake(b, folder / "timed", "-q")
    takes = time.time() - start
    seen, left = {}, 0
    for k in range(count):
        f.bake(a, out, "-q").check_returncode()
        victim = f.start(b, out, "-q")
        time.sleep(random.uniform(0, 1.05 * takes))
        victim.kill()
        victim.wait()
        kind = judge(f, f"kill {k}", out, old, new)
        seen[kind] = seen.get(kind, 0) + 1
        left += len(temporaries(out))
    f.bake(a, out, "-q").check_returncode()
    f.check("kills: the next bake tidies up", not temporaries(out), temporaries(out))
    print(f"{count} kills within {takes:.2f} s: {seen}, {left} temporaries left, all removed by the next bake")


def kills_between_renames(f):
    if not shutil.which("strace"):
        print("kills between renames: skipped, no strace")
        return
    folder, [(a, old), (b, new)] = two_levels(f, "renames")
    out = folder / "out"
    seen = []
    for k in range(1, len(new) + 2):
        f.bake(a, out, "-q").check_returncode()
        trace = ["strace", "-f", "-qq", "-o", "/dev/null", "-e", "trace=/^rename",
                 "-e", f"inject=/^rename:signal=KILL:when={k}"]
        subprocess.run(trace + f.command(b, out, "-q"), capture_output=True)
        seen.append(judge(f, f"kill at rename {k}", out, old, new))
        run = f.bake(b, out, "-q")
        f.check(f"after a kill at rename {k}: the next bake", run.returncode == 0 and files(out) == new, run.stderr)
    f.check("some kills fell between renames", "mixed" in seen, seen)
    print(f"kills at each of {len(new)} renames: {', '.join(seen)}")


def full_disk(f):
    scene = ROOT / "assets/cornell_box.glb"
    out = f.folder("limited")

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    run = f.bake(scene, out, "-q", preexec_fn=limit)
    f.fails("files of at most 20 kB", run, 2)
    f.check("files of at most 20 kB: nothing is left", not files(out), files(out))
    disk = f.folder("disk")
    mount = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=40k", "tmpfs", str(disk)], capture_output=True)
    if mount.returncode != 0:
        print("full disk: skipped, tmpfs cannot be mounted")
        return
    try:
        (disk / "own").write_text("the user's")
        run = f.bake(scene, disk, "-q")
        f.fails("full disk", run, 2)
        f.check("full disk: nothing is left or changed", list(files(disk)) == ["own"], files(disk))
    finally:
        subprocess.run(["umount", str(disk)], check=True)
    print("full disk: one error, nothing left")


def read_only_folder(f):
    lumel = f.lumel
    out = f.folder("readonly")
    out.chmod(0o555)
    scene = f.folder("open") / "c.glb"
    shutil.copy(ROOT / "assets/cornell_box.glb", scene)
    if os.geteuid() == 0:
        # Tests missing permissions as nobody, because root always has them; the paths, also the
        # program's, must be accessible to nobody.
        f.lumel = shutil.copy(f.lumel, scene.parent)
        how = {"user": 65534, "group": 65534, "extra_groups": []}
        for path in [scene.parent, *scene.parents]:
            if path.is_relative_to(f.scratch):
                path.chmod(0o755)
    else:
        how = {}
    out.chmod(0o555)
    run = f.bake(scene, out, "-q", **how)
    f.fails("read-only folder", run, 2)
    f.check("read-only folder: nothing is left", not files(out), files(out))
    f.lumel = lumel
    out.chmod(0o755)
    print("read-only folder: one error")


def linked_level(folder):
    """A level of one triangle with a separate buffer and image."""
    floats = [0, 0, 0, 1, 0, 0, 0, 0, -1]
    (folder / "c.bin").write_bytes(struct.pack("<9f", *floats))
    (folder / "p.png").write_bytes(bytes.fromhex("89504e470d0a1a0a") + b"as far as anybody knows")
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "images": [{"uri": "p.png"}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                       "min": [0, 0, -1], "max": [1, 0, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36, "uri": "c.bin"}],
    }
    scene = folder / "c.gltf"
    scene.write_text(json.dumps(document))
    return scene


def lost_inputs(f):
    # At 400 lumels per metre, this takes seconds, so that there is time between reading and
    # writing.
    options = ["--sky", "1", "--texels-per-unit", "400"]
    for name, code in (("p.png", 2), ("c.bin", 0)):
        folder = f.folder("lost")
        scene = linked_level(folder)
        out = folder / "out"
        command = [f.lumel, "bake", str(scene), "-o", str(out), "--quality", "draft", *options]
        run = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        line = run.stderr.readline()
        f.check("lost inputs: reading is over first", "ingest" in line, line)
        (folder / name).unlink()
        _, rest = run.communicate()
        f.check(f"{name} lost during the bake: exit code {code}", run.returncode == code, f"{run.returncode}: {rest[-300:]}")
        written = out.exists() and b'"uri":"p.png"' in (out / "c.glb").read_bytes()
        f.check(f"{name} lost during the bake: no URI to nothing", not written)
    print("inputs lost during the bake: the picture is one error, the buffer was read already")


def two_at_once(f, pairs):
    folder, [(a, of_a), (b, of_b)] = two_levels(f, "pairs")
    out = folder / "out"
    seen = {"a": 0, "b": 0}
    for k in range(pairs):
        both = [f.start(a, out, "-q"), f.start(b, out, "-q")]
        said = [run.communicate()[1] for run in both]
        f.check(f"pair {k}: both end well", all(run.returncode == 0 for run in both), said)
        now = files(out)
        f.check(f"pair {k}: the folder is one bake's", now in (of_a, of_b) and not f.mixed(out))
        seen["a" if now == of_a else "b"] += 1
    # One is stopped; the other's temporary files are its own.
    for k in range(pairs):
        other = f.start(a, out, "-q")
        stopped = f.start(b, out, "-q")
        time.sleep(random.uniform(0, 0.3))
        stopped.send_signal(signal.SIGINT)
        said = other.communicate()[1]
        stopped.communicate()
        f.check(f"stopped pair {k}: the other ends well", other.returncode == 0, said)
        f.check(f"stopped pair {k}: nothing is left", not temporaries(out), temporaries(out))
    print(f"{pairs} pairs at once in a folder: whole each time (last of them {seen}); {pairs} with one stopped")


def flipped_bits(f):
    folder, [(a, _), _] = two_levels(f, "flipped")
    out = folder / "out"
    f.bake(a, out, "-q").check_returncode()
    whole = files(out)
    for name in whole:
        data = bytearray((out / name).read_bytes())
        data[len(data) // 2] ^= 1
        (out / name).write_bytes(data)
        # A page that no longer decodes is a separate error.
        told = f.mixed(out) or f.report(out).returncode == 3
        f.check(f"a flipped bit in {name} is told of", told)
        run = f.bake(a, out, "-q", "--skip-if-unchanged")
        f.check(f"a flipped bit in {name}: baked again", run.returncode == 0 and files(out) == whole, run.stderr)
    print(f"a flipped bit in each of {len(whole)} results: told of, and baked again")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--lumel", default=os.environ.get("LUMEL", str(ROOT / "target/release/lumel")))
    parser.add_argument("--scratch", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args()
    random.seed(a.seed)
    with tempfile.TemporaryDirectory(dir=a.scratch) as scratch:
        f = Faults(str(Path(a.lumel).resolve()), Path(scratch))
        kills(f, a.kills)
        kills_between_renames(f)
        full_disk(f)
        read_only_folder(f)
        lost_inputs(f)
        two_at_once(f, max(3, a.kills // 10))
        flipped_bits(f)
        print("all as it should be" if f.wrong == 0 else f"{f.wrong} wrong")
        sys.exit(f.wrong != 0)


if __name__ == "__main__":
    main()
