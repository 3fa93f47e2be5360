"""The classic studies: a baseline of 1000 and 5760 patches, Lumel, and a path-traced reference, as figures and pictures.

Usage : python classic_studies.py [--lab PROGRAM] [--out DIR] [--docs DIR] [--cases NAME,…] [--count 1500] [--spp 8192]
              [--pixel-spp 128] [--no-solvers] [-- further options of `lumel bake`]
Steps : 1 `lumel-lab studies` writes each case as .glb and the baseline's radiosity as .csv; `lumel-lab solvers` its tables;
        2 `lumel bake` bakes each .glb at its default settings;
        3 --count points are drawn by area from the surfaces that do not emit, and truth.py computes their irradiance (back
          faces black, unlimited bounces); 4 the same for the pixels of one picture, with fewer samples;
        5 every method's irradiance at those points and pixels, and its error.
Output: DOCS/images/studies/NAME.png (pictures) and NAME.error.png (signed error of each), DOCS/images/studies/errors.csv (figures),
        and the tables, DOCS/tables/studies.md.  Solver tables: OUT/solvers*.csv.
Errors: of the luminance of irradiance E, over points with E > 0.001 mean: relRMSE = sqrt(mean(((x − ref) / (ref + 0.01 mean ref))²)),
        p50 and p95 of its absolute value, bias = mean(x) / mean(ref) − 1.
Needs : LUMEL (the lumel binary), numpy, Mitsuba, Pillow.
        References are cached under LUMEL_REF by the hash of scene and settings.
"""
import argparse
import csv
import json
import os
import sys
import time

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import common
import lumels
from judge import scene as scenes
from judge.view import taps
from truth import LUMINANCE as LUM, MODEL

WIDTH, HEIGHT, LABEL, COLUMNS = 294, 189, 18, 3


class Patches:
    """A table of lumel-lab with lookups of surface points: axis-parallel rectangles on planes"""

    def __init__(self, path):
        with open(path, newline="") as f:
            rows = list(csv.reader(f))
        head = rows[0]
        self.surface = np.array([r[0] for r in rows[1:]])
        v = np.array([[float(x) for x in r[1:]] for r in rows[1:]])
        col = {name: i - 1 for i, name in enumerate(head)}
        take = lambda *names: v[:, [col[n] for n in names]]     # noqa: E731
        rgb = lambda p: take(p + "_r", p + "_g", p + "_b")      # noqa: E731
        self.normal = take("nx", "ny", "nz")
        self.corners = np.stack([take("x%d" % k, "y%d" % k, "z%d" % k) for k in range(4)], 1)
        self.exitance, self.rho, self.radiosity = rgb("M"), rgb("rho"), rgb("B")
        self.vertex = np.stack([rgb("V%d" % k) for k in range(4)], 1)
        self.faces = []
        axis = np.abs(self.normal).argmax(1)
        plane = np.round(self.corners[np.arange(len(v)), 0, axis], 6)
        keys = np.stack([axis, np.sign(self.normal[np.arange(len(v)), axis]), plane], 1)
        for k in np.unique(keys, axis=0):
            ids = np.nonzero((keys == k).all(1))[0]
            a, others = int(k[0]), [i for i in range(3) if i != int(k[0])]
            low, high = self.corners[ids].min(1)[:, others], self.corners[ids].max(1)[:, others]
            lines = [np.unique(np.round(np.concatenate([low[:, i], high[:, i]]), 6)) for i in range(2)]
            cell = np.full((len(lines[0]) - 1, len(lines[1]) - 1), -1)
            # All patches come from one lattice, so each is one cell between the lines of its plane.
            at = [np.searchsorted(lines[i], 0.5 * (low[:, i] + high[:, i])) - 1 for i in range(2)]
            cell[at[0], at[1]] = ids
            self.faces.append((a, k[1], k[2], others, lines, cell))

    def find(self, p, face):
        """patch of each point in the plane of a face; -1 off its patches"""
        _, _, _, others, lines, cell = face
        i = [np.searchsorted(lines[k], p[:, others[k]], side="right") - 1 for k in range(2)]
        ok = (i[0] >= 0) & (i[1] >= 0) & (i[0] < cell.shape[0]) & (i[1] < cell.shape[1])
        out = np.full(len(p), -1)
        out[ok] = cell[i[0][ok], i[1][ok]]
        return out

    def locate(self, p, n):
        """patch of each surface point with normal n, or -1"""
        out = np.full(len(p), -1)
        for face in self.faces:
            a, sign, plane = face[:3]
            here = np.nonzero((n[:, a] * sign > 0.99) & (np.abs(p[:, a] - plane) < 1e-5))[0]
            out[here] = self.find(p[here], face)
        return out

    def cast(self, eye, d):
        """first patch seen from the front along each ray -> (patch or -1, point)"""
        best, patch = np.full(len(d), np.inf), np.full(len(d), -1)
        for face in self.faces:
            a, sign, plane = face[:3]
            with np.errstate(divide="ignore", invalid="ignore"):
                t = (plane - eye[a]) / d[:, a]
            ok = np.nonzero((d[:, a] * sign < 0) & (t > 0) & (t < best))[0]
            p = eye + d[ok] * t[ok, None]
            p[:, a] = plane
            hit = self.find(p, face)
            ok, hit = ok[hit >= 0], hit[hit >= 0]
            best[ok], patch[ok] = t[ok], hit
        seen = patch >= 0
        point = np.zeros_like(d)
        point[seen] = eye + d[seen] * best[seen, None]
        point[seen, np.abs(self.normal[patch[seen]]).argmax(1)] = self.corners[patch[seen], 0, np.abs(self.normal[patch[seen]]).argmax(1)]
        return patch, point

    def blend(self, patch, p):
        """radiosity, interpolated bilinearly between the corners (Gouraud)"""
        c = self.corners[patch]
        e1, e2, d = c[:, 1] - c[:, 0], c[:, 3] - c[:, 0], p - c[:, 0]
        s = ((d * e1).sum(1) / (e1 * e1).sum(1))[:, None]
        t = ((d * e2).sum(1) / (e2 * e2).sum(1))[:, None]
        v = self.vertex[patch]
        return (1 - s) * (1 - t) * v[:, 0] + s * (1 - t) * v[:, 1] + s * t * v[:, 2] + (1 - s) * t * v[:, 3]


class Lightmap:
    """Lumel's result as an engine reads it: the baked glTF's triangles, their second UV set, the EXR"""

    def __init__(self, glb):
        self.scene = scenes.load(glb, images=False)
        self.place = self.scene.extras[self.scene.node[0]]["lightmap"]
        self.image = common.read_exr(os.path.join(os.path.dirname(glb), self.place["uri"]))
        self.normal = lumels.unit(lumels.face_normals(self.scene.corners))

    def irradiance(self, patches, patch, p):
        """E at points whose patch in the coarse table is known: two triangles of the glTF lie on each"""
        owner = patches.locate(self.scene.corners.mean(1), self.normal)
        order = np.argsort(owner, kind="stable")
        if not (owner[order].reshape(-1, 2) == np.arange(len(patches.corners))[:, None]).all():
            raise SystemExit("the baked scene has other triangles than the room")
        pair = order.reshape(-1, 2)[patch]
        best, uv = np.full(len(p), -np.inf), np.zeros((len(p), 2))
        for k in range(2):
            t = self.scene.corners[pair[:, k]]
            e1, e2, d = t[:, 1] - t[:, 0], t[:, 2] - t[:, 0], p - t[:, 0]
            d11, d12, d22 = (e1 * e1).sum(1), (e1 * e2).sum(1), (e2 * e2).sum(1)
            p1, p2 = (d * e1).sum(1), (d * e2).sum(1)
            det = d11 * d22 - d12 * d12
            v, w = (d22 * p1 - d12 * p2) / det, (d11 * p2 - d12 * p1) / det
            b = np.stack([1 - v - w, v, w], 1)
            here = b.min(1) > best
            at = (self.scene.uv[self.place.get("texCoord", 1)][pair[:, k]] * b[..., None]).sum(1)
            uv[here], best[here] = at[here], b.min(1)[here]
        uv = uv * np.array(self.place.get("scale", [1, 1])) + np.array(self.place.get("offset", [0, 0]))
        texel, weight = taps(self.image.shape, uv)
        value = (self.image.reshape(-1, 3)[texel] * weight[..., None]).sum(1)
        return value * self.place.get("scaleToIrradiance", np.pi)


def camera_rays(camera):
    eye, target = np.array(camera["eye"], float), np.array(camera["target"], float)
    f = (target - eye) / np.linalg.norm(target - eye)
    r = np.cross(f, [0.0, 1.0, 0.0])
    r /= np.linalg.norm(r)
    up = np.cross(r, f)
    h = np.tan(np.radians(camera["fov"]) / 2)
    x = ((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1) * h * camera["aspect"]
    y = (1 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 2) * h
    d = f + x[None, :, None] * r + y[:, None, None] * up
    return eye, (d / np.linalg.norm(d, axis=2, keepdims=True)).reshape(-1, 3)


def truth(scene, position, normal, work, spp):
    """irradiance and standard error at points, from the cache or from truth.py"""
    key = common.digest(scene, position.tobytes().hex(), normal.tobytes().hex(), spp, MODEL)
    kept = os.path.join(common.REF, "study-%s.npz" % key)
    if not os.path.exists(kept):
        os.makedirs(common.REF, exist_ok=True)
        points, out = work + ".points.npz", work + ".truth.npz"
        np.savez(points, position=position, normal=normal)
        common.tool("truth.py", scene, points, out, "--paths", spp, timeout=600)
        os.replace(out, kept)
    z = np.load(kept)
    return z["irradiance"], z["stderr_y"]


def errors(x, ref, se):
    x, ref = x @ LUM, ref @ LUM
    m = ref.mean()
    lit = ref > 1e-3 * m
    d = ((x - ref) / (ref + 0.01 * m))[lit]
    p50, p95 = np.percentile(np.abs(d), [50, 95])
    own = np.sqrt(np.mean((se[lit] / (ref[lit] + 0.01 * m)) ** 2))
    return dict(relRMSE=np.sqrt(np.mean(d * d)), p50=p50, p95=p95, bias=x.mean() / ref.mean() - 1, own=own, points=int(lit.sum()))


def encode(x):
    x = np.clip(x, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def signed_colors(e):
    """relative error in steps of 5 %, −50 % to +50 %, as blue, white, red"""
    e = np.round(np.clip(e, -0.5, 0.5) * 20)[:, None] / 10
    return np.where(e < 0, 1 + e * np.array([0.8, 0.55, 0.15]), 1 - e * np.array([0.2, 0.7, 0.85]))


def tile(colors, seen):
    out = np.full((WIDTH * HEIGHT, 3), 0.12)
    out[seen] = colors
    return (out.reshape(HEIGHT, WIDTH, 3) * 255 + 0.5).astype(np.uint8)


def font(size):
    try:
        return ImageFont.load_default(size=size)
    except TypeError:       # before Pillow 10.1
        return ImageFont.load_default()


def legend():
    """the colour scale of errors, labelled at its ends"""
    out = Image.fromarray(tile(signed_colors(np.tile(np.linspace(-0.5, 0.5, WIDTH), HEIGHT)), np.arange(WIDTH * HEIGHT)))
    draw = ImageDraw.Draw(out)
    for x, text in ((4, "-50 %"), (WIDTH // 2 - 8, "0"), (WIDTH - 42, "+50 %")):
        draw.text((x, HEIGHT // 2), text, fill=(0, 0, 0), font=font(13))
    return np.array(out)


def sheet(path, tiles):
    """(label, picture) in rows of three"""
    rows = -(-len(tiles) // COLUMNS)
    img = Image.new("RGB", (COLUMNS * (WIDTH + 2) - 2, rows * (HEIGHT + LABEL)), (255, 255, 255))
    draw = ImageDraw.Draw(img)
    for k, (label, picture) in enumerate(tiles):
        x, y = k % COLUMNS * (WIDTH + 2), k // COLUMNS * (HEIGHT + LABEL)
        draw.text((x + 3, y + 1), label, fill=(0, 0, 0), font=font(13))
        img.paste(Image.fromarray(picture), (x, y + LABEL))
    img.save(path, optimize=True)


def percent(x):
    return ("%.2f %%" if abs(x) < 0.0995 else "%.1f %%" if abs(x) < 0.995 else "%.0f %%") % (100 * x)


def signed(x):
    text = percent(abs(x))
    return text if float(text[:-2]) == 0 else ("+" if x > 0 else "−") + text


def run_case(case, a, camera):
    """-> rows (label, errors), and writes the picture"""
    scene, work = os.path.join(a.out, case["glb"]), os.path.join(a.out, case["name"])
    runs = [(r, Patches(os.path.join(a.out, r["file"]))) for r in case["runs"]]
    coarse = next(p for r, p in runs if r["patches"] == 1000)
    common_run = common.bake(scene, work + ".bake", *a.further)
    if common_run["code"] != 0:
        raise SystemExit("lumel bake failed: " + common_run["err"])
    drawn = lumels.points(scenes.load(scene, images=False), a.count)
    position, normal = drawn["position"], drawn["normal"]
    ref, se = truth(scene, position, normal, work, a.spp)
    lightmap = Lightmap(common_run["glb"])

    eye, d = camera_rays(camera)
    pixel, hit = coarse.cast(eye, d)
    seen = np.nonzero(pixel >= 0)[0]
    pixel, hit = pixel[seen], hit[seen]
    pixel_ref, _ = truth(scene, hit, coarse.normal[pixel], work + ".pixel", a.pixel_spp)
    rho, glow = coarse.rho[pixel], coarse.exitance[pixel]
    dark = glow.sum(1) == 0
    want = glow + rho * pixel_ref
    scale = 0.25 / (want[dark] @ LUM).mean()
    mean = (pixel_ref[dark] @ LUM).mean()

    def column(label, b):
        """one picture: b is the radiosity of each pixel; the error is that of irradiance on surfaces that do not emit"""
        error = ((b - want) / rho) @ LUM / (pixel_ref @ LUM + 0.01 * mean)
        return label, tile(encode(b * scale), seen), tile(np.where(dark[:, None], signed_colors(error), 0.5), seen)

    rows, columns = [], []
    where = coarse.locate(position, normal)
    if (where < 0).any():
        raise SystemExit("%d points lie on no patch" % (where < 0).sum())
    many = len({r["iterations"] for r, _ in runs}) > 1
    for r, p in runs:
        at = p.locate(position, normal)
        label = "%d" % r["patches"] + (", %d iterations" % r["iterations"] if many else "") + (", with occlusion" if r["occlusion"] else "")
        if not many:
            rows.append((label + ", flat", errors(p.radiosity[at] / p.rho[at], ref, se)))
        rows.append((label + ", interpolated", errors(p.blend(at, position) / p.rho[at], ref, se)))
        if r["occlusion"]:
            continue
        at = p.locate(hit, coarse.normal[pixel])
        if many:
            if r["patches"] == 5760:
                columns.append(column("%d, %d iterations" % (r["patches"], r["iterations"]), p.blend(at, hit)))
        else:
            columns.append(column("%d, flat" % r["patches"], p.radiosity[at]))
            columns.append(column("%d, interpolated" % r["patches"], p.blend(at, hit)))
    rows.append(("Lumel", errors(lightmap.irradiance(coarse, where, position), ref, se)))
    columns.append(column("Lumel", glow + rho * lightmap.irradiance(coarse, pixel, hit)))
    columns.append(("truth (path traced)", tile(encode(want * scale), seen), legend()))
    picture = os.path.join(a.docs, "images", "studies", case["name"])
    sheet(picture + ".png", [(label, shown) for label, shown, _ in columns])
    sheet(picture + ".error.png", [(label, error) for label, _, error in columns[:-1]] + [("colours", columns[-1][2])])
    return rows, common_run["seconds"]


def markdown(rows):
    out = ["| | relRMSE | p50 | p95 | bias |", "|---|---|---|---|---|"]
    for label, e in rows:
        out.append("| %s | %s | %s | %s | %s |" % (label, percent(e["relRMSE"]), percent(e["p50"]), percent(e["p95"]), signed(e["bias"])))
    out.append("| the truth's own noise | %s | | | |" % percent(rows[-1][1]["own"]))
    return "\n".join(out)


def row_table(meshes):
    out = ["| patches | row sums without occlusion: least, mean, most | largest eigenvalue of F | with occlusion: least, mean, most | largest eigenvalue |", "|---|---|---|---|---|"]
    for m in meshes:
        f = lambda x: "%.3f, %.3f, %.3f | %.3f" % (x["row_sum"]["min"], x["row_sum"]["mean"], x["row_sum"]["max"], x["eigenvalue"])     # noqa: E731
        out.append("| %d | %s | %s |" % (m["patches"], f(m["open"]), f(m["occluded"])))
    return "\n".join(out)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--lab", default=os.path.join(common.HERE, "../target/release/lumel-lab"))
    ap.add_argument("--out", default="/tmp/lumel-studies")
    ap.add_argument("--docs", default=common.LAB)
    ap.add_argument("--cases", help="only these, by name")
    ap.add_argument("--count", type=int, default=1500)
    ap.add_argument("--spp", type=int, default=8192)
    ap.add_argument("--pixel-spp", type=int, default=128)
    ap.add_argument("--no-solvers", action="store_true")
    argv, further = sys.argv[1:], []
    if "--" in argv:
        i = argv.index("--")
        argv, further = argv[:i], argv[i + 1:]
    a = ap.parse_args(argv)
    a.further = further
    start = time.perf_counter()
    os.makedirs(a.out, exist_ok=True)
    os.makedirs(os.path.join(a.docs, "images", "studies"), exist_ok=True)
    parts = {}
    r = common.run([a.lab, "studies", "--out", a.out])
    if r["code"] != 0:
        raise SystemExit("lumel-lab studies failed: " + r["err"])
    study = json.load(open(os.path.join(a.out, "study.json")))
    parts["rows"] = row_table(study["meshes"])
    if not a.no_solvers:
        r = common.run([a.lab, "solvers", "--out", a.out])
        if r["code"] != 0:
            raise SystemExit("lumel-lab solvers failed: " + r["err"])
        parts["solvers"] = r["out"]
    only = a.cases.split(",") if a.cases else None
    lines, baked = {}, []
    for case in study["cases"]:
        if only and case["name"] not in only:
            continue
        rows, seconds = run_case(case, a, study["camera"])
        baked.append(seconds)
        parts[case["name"]] = markdown(rows)
        lines[case["name"]] = []
        for label, e in rows:
            lines[case["name"]].append('%s,"%s",%.6g,%.6g,%.6g,%.6g,%.6g,%d' % (case["name"], label, e["relRMSE"], e["p50"], e["p95"], e["bias"], e["own"], e["points"]))
        print("%s: done after %.0f s" % (case["name"], time.perf_counter() - start), flush=True)
    record = os.path.join(a.docs, "images", "studies", "errors.csv")
    if os.path.exists(record):          # Lines of cases that were not run stay.
        with open(record, encoding="utf-8") as f:
            for line in f.read().splitlines()[1:]:
                name = line.split(",")[0]
                if only and name not in only:
                    lines.setdefault(name, []).append(line)
    with open(record, "w", encoding="utf-8") as f:
        f.write("case,method,relRMSE,p50,p95,bias,truth_noise,points\n")
        for case in study["cases"]:
            f.writelines(line + "\n" for line in lines.get(case["name"], []))
    if not only:
        parts["time"] = "Whole run %.0f s; a bake by Lumel took %.1f to %.1f s (load average %.1f)." % (
            time.perf_counter() - start, min(baked), max(baked), os.getloadavg()[0])
    common.write_tables(a.docs, "studies", parts)


if __name__ == "__main__":
    main()
